"""Tables and texts for the terminal.

May import: results, analysis and the layers below; rich.
To extend: add a function to `text_tables` for a new table; `responsive_table` handles the layout.
"""
