"""Range of validity of the strains in a floating frame, the basis of `Solution.validity`.

`run.py` prints the tables, `statics.py` solves the cantilevers and their references, and
`mechanisms.py` compares the estimates of 78 mechanisms with exact strains.
To extend: add a load to `LOADS` in run.py, or a case to `HELD_OUT` in mechanisms.py.
"""
