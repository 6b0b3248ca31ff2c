"""Formulations: residuals and Jacobians of the equations of motion for integrators and statics.

May import: equations_of_motion and structure, symbolic, native; neither assembly nor starts.
Next: a first-order form is an entry of `FORMULATIONS`; another kind of equations is a new module.
"""
