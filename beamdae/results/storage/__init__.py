"""Files of results: CSV tables with JSON metadata, saved runs and checkpoints.

May import: results.run_data and below; `continued_runs` also results.solution.
To extend: add a module for a new file format and write its files with `files.atomic_write`.
"""
