"""Results of runs and analyses: solution, section forces, equilibria, files.

May import: equations and the layers below; drawing code only through `displays.load_views`.
To extend: add quantities of a run as methods of `Solution`.
"""
