"""Derivatives of runs, periodic motions, equilibria and modes with respect to parameters.

May import: analysis.statics, linear_dynamics, eigenproblems and periodic; simulation and lower
layers.
"""
