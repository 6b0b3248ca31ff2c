"""Diagnostics of results: energy balance, residual, drift, start, singularities, strains.

May import: results.trajectory, results.columns, results.section_forces.balance, equations and the
layers below; nothing else of results.
To extend: add a module for a new check and include its warnings in `results.run_data`.
"""
