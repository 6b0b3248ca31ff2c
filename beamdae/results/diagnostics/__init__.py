"""Diagnostics of a run: energy balance, residual and drift, start, singular positions, strains.

May import: results.trajectory and results.event_records, equations.
Next: a new check of runs is a module here; `results.run_data` lists its warnings.
"""
