"""Scenes: lines and symbols that represent a mechanism in drawings, animations and pages.

May import: results and the layers below; not matplotlib.
To extend: add a function for a new symbol to a `*_symbols` module and list it in `symbols.py`.
"""
