"""Presentation of results: tables for the terminal, figures, animations, pages for the browser.

May import: results, analysis and what lies below them. Nothing is simulated here.
Next: a table in `terminal`, a figure in `pictures`, a symbol in `scene`, a panel in `page`.
"""
