"""Radau IIA of order 5: settings, coefficients and error weights.

May import: equations, native, results, errors, and the shared modules of integrators.
To extend: change the step size control and Newton's iteration in `core/radau.c`.
"""
