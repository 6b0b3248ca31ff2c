"""Figures and animations: drawings, modes, plots of columns, section diagrams, GIF and MP4.

May import: scene, page, report.text, analysis and lower layers. Import matplotlib only inside
functions, because importing it is slow.
To extend: add a module for a new kind of plot; `figures` provides palette, panels and legends.
"""
