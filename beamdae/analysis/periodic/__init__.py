"""Periodic motions by shooting, as a problem of the curve engine; Floquet multipliers; responses.

May import: analysis.continuation, simulation, integrators, results, equations and lower layers.
To extend: a kind of critical motion is a count of its multipliers in shooting.
"""
