"""Robustness trials: bad inputs, random mechanisms and faults of the environment.

`run.py` runs the trials, and `judge.py` states which outcomes are accepted.
To extend: add a new kind of trial to `kinds` in run.py.
"""
