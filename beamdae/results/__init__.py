"""Results of runs: trajectory, solution, diagnostics, section forces and saved files.

May import: equations, beams, parts, symbolic; drawing code only through `displays.load_views`.
To extend: add quantities of a run as methods of `Solution`, and checks as modules in `diagnostics`.
"""
