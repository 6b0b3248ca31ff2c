"""Accuracy of the adaptive integrators over rtol: cases and references.

`run.py` prints errors over rtol. To extend: add a `ToleranceCase` to cases.py, and compute its
reference with `run.py --references --case NAME`.
"""
