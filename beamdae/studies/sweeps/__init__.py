"""Sweeps: one model run over values of its parameters, the table of responses, plots and page.

May import: the other folders and modules of studies, report, and everything below.
Next: a measure of a column in `responses.MEASURES`, a plot in `response_plots`.
"""
