"""Scenes: the lines and symbols that show a mechanism in drawings, animations, modes and pages.

May import: results, analysis and what lies below them; matplotlib only in `artists`, `beam_colors`.
Next: the symbol of a new part goes into one of the `*_symbols` modules and the table in `symbols`.
"""
