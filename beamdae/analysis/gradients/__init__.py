"""Gradients of scalar objectives of runs by a discrete adjoint.

May import: analysis.sensitivities, simulation and lower layers.
"""
