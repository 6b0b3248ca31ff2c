"""Diagnostics of a run: energy balance, residual, drift, start, singular positions, strains.

May import: results.trajectory and results.event_records, equations.
To extend: add a module for a new check and include its warnings in `results.run_data`.
"""
