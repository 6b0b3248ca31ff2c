"""Results: trajectory, solution, diagnostics, section forces, saved runs. They hold data only.

May import: equations, beams, parts, symbolic. Drawing goes through `displays.load_views`.
Next: a quantity of a run is a method of `Solution`; a check of runs is a module in `diagnostics`.
"""
