"""Tables and texts for the terminal.

May import: results, analysis and what lies below them; rich.
Next: a new table is a function of `text_tables`; its layout is in `responsive_table`.
"""
