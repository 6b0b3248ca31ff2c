"""Accuracy of the adaptive integrators over rtol: cases, references and tables.

`run.py` prints the tables; results/ and references/ store them.
Next: a case is a `ToleranceCase` in cases.py; `run.py --references --case NAME` computes its
reference.
"""
