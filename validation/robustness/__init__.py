"""Robustness trials: bad inputs, random mechanisms, faults of the environment and other classes.

`run.py` runs the trials, and `judge.py` states which outcomes are accepted.
To extend: add a module with a `TrialClass` and its place to `trial_class.CLASSES`.
"""
