"""Periodic motions by shooting: Floquet multipliers, and response curves by continuation.

May import: simulation, integrators, results, equations and lower layers; no other analysis.
To extend: add bifurcation analysis of periodic motions next to periodic_continuation.
"""
