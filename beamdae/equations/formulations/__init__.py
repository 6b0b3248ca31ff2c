"""Formulations: residuals and Jacobians of the equations for integrators and statics.

May import: equations_of_motion and structure, symbolic, native; neither assembly nor starts.
To extend: add a first-order form to `FORMULATIONS`, and a module for another kind of equations.
"""
