"""Radau IIA of order 5: settings, coefficients, stages, step loop and error weights.

May import: equations, native, results, errors, and the shared modules of integrators.
To extend: change the step size control in `step_loop`, and Newton's iteration in `stages`.
"""
