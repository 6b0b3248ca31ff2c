"""Execution of studies: single cases, executors, progress and whole studies.

May import: the modules and the store of studies, report, simulation and everything below.
To extend: add an executor to `executors`, or a recorded value of a run to `case_run`.
"""
