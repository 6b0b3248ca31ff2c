"""Figures and animations: drawings, modes, plots of columns, section diagrams, GIF and MP4 files.

May import: scene, page, results, analysis; matplotlib, inside functions, because it imports slowly.
Next: a new kind of plot is a module; palette, panels and legends are in `figures`.
"""
