"""Events: detection on the dense output, impacts, and parts switched on and off.

May import: equations, parts, results, and the plan and step history of integrators.
Next: another action of an event goes beside `impacts` and is applied in `switching`.
"""
