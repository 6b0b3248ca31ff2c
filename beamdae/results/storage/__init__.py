"""Files of results: CSV tables with JSON metadata, saved runs and checkpoints.

May import: results.run_data and below; `continued_runs` also results.solution.
To extend: add a module for a new file format, write its files with `files.atomic_write`, read them
with `reader`, and state the rules of its fields with `schema`.
"""
