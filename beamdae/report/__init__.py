"""What people look at: tables for the terminal, pictures, a page for the browser.

May import: results. Draws tables and plain data, runs nothing.
Next: a table in `terminal`, a picture in `pictures`, a panel in `page`.
"""
