"""Files of results: CSV tables with JSON metadata, saved runs and checkpoints.

May import: results, but results.solution only in `continued_runs` and inside functions; equations
and the layers below.
To extend: add a module for a new file format, write its files with `files.atomic_write`, read them
with `reader`, and state the rules of its fields with `schema`.
"""
