"""Robustness: bad inputs, hostile files, random mechanisms, faults of the machine, interrupts.

Each module has functions that list names of trials and try one; `judge.py` states which outcomes
are accepted. The scoreboard runs samples of them.
"""
