"""Files of results: CSV tables with JSON metadata, saved runs and checkpoints.

May import: results.run_data and below; `continued_runs` also results.solution.
Next: a new file format is a module here, written by `files.atomic_write`.
"""
