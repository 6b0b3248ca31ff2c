"""Optimization of model parameters under constraints, with exact gradients.

May import: analysis.sensitivities, gradients, statics, linear_dynamics and eigenproblems;
simulation and lower layers.
To extend: add a `Quantity` to `quantities` and the analysis that computes it to `analyses`.
"""
