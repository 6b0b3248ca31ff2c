"""Convergence of the beam formulations.

`orders.py` measures orders of cantilevers, `mesh_convergence.py` those of the hub beam in motion,
and `exact_runs.py` errors of the strains in motion. To extend: add a formulation to `FORMULATIONS`
in orders.py and to `STRAINS` in exact_runs.py.
"""
