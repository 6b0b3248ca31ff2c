"""Range of validity of the strains in a floating frame, the basis of `Solution.validity`.

`run.py` prints the tables, and `statics.py` solves the cantilevers and their references.
To extend: add a load to `LOADS` in run.py.
"""
