"""Accuracy of the adaptive integrators over rtol: cases, references and tables.

`run.py` prints the tables; results/ contains the tables, and references/ the stored references.
To extend: add a `ToleranceCase` to cases.py, and compute its reference with
`run.py --references --case NAME`.
"""
