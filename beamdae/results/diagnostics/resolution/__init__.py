"""Warnings about motions and forces that time steps, tolerances or output rows do not resolve.

May import: as `results.diagnostics`.
To extend: add a module for a new check and add it to `results.run_checks`.
"""
