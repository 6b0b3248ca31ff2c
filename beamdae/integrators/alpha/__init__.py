"""Generalized-alpha, HHT and Newmark methods: settings, starting values and step loops.

May import: equations, native, and plan, driver and compiled loops of integrators.
To extend: add a member of the family to `family`; change the steps of all members in `step_loop`.
"""
