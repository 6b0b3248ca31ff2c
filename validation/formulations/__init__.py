"""Convergence of the beam formulations.

`orders.py` measures orders on cantilevers, `exact_runs.py` errors of the strains in motion.
Next: a formulation is an entry of `FORMULATIONS` in orders.py and of `STRAINS` in exact_runs.py.
"""
