"""Mesh convergence of the hub beam.

`run.py` prints errors and orders over the number of elements.
Next: an element variant is an entry of `VARIANTS` in run.py.
"""
