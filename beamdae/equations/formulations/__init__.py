"""Formulations: residuals and Jacobians of the equations for integrators and statics.

May import: equations_of_motion, structure, symbolic, native, errors; neither assembly nor starts.
To extend: add a first-order form to `FORMULATIONS`, or a module for another kind of equations.
"""
