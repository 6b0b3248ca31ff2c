"""Range of validity of the strains in a floating frame, the basis of `Solution.validity`.

`run.py` prints the tables, `statics.py` solves the cantilevers and their references.
Next: a load is an entry of `LOADS` in run.py.
"""
