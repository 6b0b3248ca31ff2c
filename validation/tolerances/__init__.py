"""Accuracy of the adaptive integrators over rtol: cases and references.

`run.py` prints errors over rtol. To extend: add a row to cases.csv, and compute its
reference with `run.py --references --case NAME`.
"""
