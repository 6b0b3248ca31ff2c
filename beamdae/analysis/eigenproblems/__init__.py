"""Eigenvalue solvers for natural modes and for the stability of equilibria.

May import: continuation, equations, linear and lower layers; no other analysis.
To extend: add a module for a new eigenvalue solver and choose it in `eigensolution`.
"""
