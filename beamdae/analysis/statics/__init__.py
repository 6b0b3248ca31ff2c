"""Static equilibria: load stepping, path continuation, critical points and stability.

May import: eigenproblems, simulation and lower layers; no other analysis.
To extend: add a path control to path_controls, and a way to start a path to path_tracing.
"""
