"""Faults of the environment: full disks, limits of users, dying processes.

`machine.py` lists them in FAULTS and SLOW; the docstring of a fault states the required behavior.
"""
