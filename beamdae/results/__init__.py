"""Results of one run: trajectory, solution, energy ledger, shapes, files.

May import: equations, parts (to draw them), symbolic.
Next: what is measured of a run is a function in `equations.measures` and a table here.
"""
