"""Radau IIA of order 5: settings, coefficients, stages, step loop and error weights.

May import: equations, native, and error control, plan, driver and compiled loops of integrators.
Next: changes of the step size control go into `step_loop`, of Newton's iteration into `stages`.
"""
