"""Periodic motions by shooting: Floquet multipliers, and response curves by continuation.

May import: simulation, integrators, results, equations and lower layers; no other analysis.
Next: bifurcation analysis of periodic motions belongs here, next to periodic_continuation.
"""
