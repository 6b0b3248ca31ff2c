"""Tables and texts for the terminal.

May import: report.text, analysis and lower layers; rich.
To extend: add a function to `text_tables` for a new table; `responsive_table` handles the layout.
"""
