"""Static equilibria: load stepping, path continuation, critical points and stability.

May import: continuation, eigenproblems, simulation and lower layers; no other analysis.
"""
