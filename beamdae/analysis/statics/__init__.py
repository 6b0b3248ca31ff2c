"""Static equilibria: load stepping, path continuation, critical points and stability.

May import: simulation, integrators, results, equations and lower layers; no other analysis.
Next: a new control of the path goes into path_controls, a new start of a path into path_tracing.
"""
