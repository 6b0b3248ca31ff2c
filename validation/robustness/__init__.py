"""Robustness trials: bad inputs, random mechanisms and faults of the environment.

`run.py` runs them, `judge.py` states which outcomes are accepted. Next: a trial of a new kind.
"""
