"""Studies and sweeps: many runs in parallel, stored results, errors against references.

May import: report, simulation and everything below.
To extend: add a column of the case table to `run_values`, a figure to `study_page`, or an
executor to `executors`.
"""
