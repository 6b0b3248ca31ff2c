"""Mesh convergence of the hub beam.

`run.py` prints errors and orders over the number of elements.
To extend: add an element variant to `VARIANTS` in run.py.
"""
