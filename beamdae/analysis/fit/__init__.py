"""Fits of model parameters to measured columns, with exact Jacobians.

May import: analysis.sensitivities, simulation and lower layers; higher layers by `deferred`.
To extend: add a form of data to `data`, or an unknown property of sensors to `sensors` and
`problem`.
"""
