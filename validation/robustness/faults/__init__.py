"""Faults of the environment: full disks, limits of users, dying processes.

`catalog.py` lists them in FAULTS and SLOW; the docstring of a fault states the required behavior.
"""
