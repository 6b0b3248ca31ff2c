"""Diagnostics of results: energy balance, residual, drift, start and singular positions.

May import: results.trajectory, results.columns, results.section_forces.balance, equations and the
layers below; nothing else of results.
To extend: add a module for a new check and list its function in `results.run_checks`. Checks of
contacts, of meshes, and of time steps and output rows are in the folders.
"""
