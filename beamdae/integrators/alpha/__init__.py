"""Generalized-alpha, HHT and Newmark methods: settings, starting values and step loops.

May import: equations, symbolic, native, results, errors, the shared modules of integrators, and
`radau` for pilot runs.
To extend: add a member of the family to `family`; change their steps in `core/alpha.c`.
"""
