"""Events: detection on the dense output, impacts, and parts switched on and off.

May import: equations, parts, results, errors, and `method`, `run_plan` and `step_history` of
integrators.
To extend: add the module of a new event action next to `impacts`, and apply it in `switching`.
"""
