"""Scenes: the lines and symbols that show a mechanism in drawings, animations, modes and pages.

May import: results and what lies below them; no matplotlib.
Next: a new symbol is a function in one of the `*_symbols` modules and an entry in `symbols`.
"""
