"""Execution of studies: runs of single cases, executors, progress, and the whole study.

May import: the modules and the store of studies, report, simulation and everything below.
Next: another executor beside those in `executors`, a recorded value of a run in `case_run`.
"""
