"""Generalized-alpha, HHT and Newmark: settings, the family and its start, and its step loops.

May import: equations, native, and plan, driver and compiled loops of integrators.
Next: another member of the family goes into `family`; what every step does into `step_loop`.
"""
