"""Figures and animations: drawings, modes, plots of columns, section diagrams, GIF and MP4 files.

May import: scene, page, results, analysis; matplotlib only inside functions, as it imports slowly.
To extend: add a module for a new kind of plot; `figures` provides palette, panels and legends.
"""
