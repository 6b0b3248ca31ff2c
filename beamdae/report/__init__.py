"""Presentation of results: terminal tables, figures, animations and HTML pages.

May import: analysis and lower layers. Reports do not run simulations.
To extend: add tables to `tables`, figures to `pictures`, symbols to `scene`, panels to `page`.
"""
