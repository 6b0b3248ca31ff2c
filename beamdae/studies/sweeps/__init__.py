"""Sweeps: runs of one model over parameter values, with responses, plots and a page.

May import: the other modules and folders of studies, report and everything below.
To extend: add a measure of a column to `run_values.MEASURES`, or a plot to `response_plots`.
"""
