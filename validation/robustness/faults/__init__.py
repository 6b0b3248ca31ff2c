"""Faults of the environment: damaged files, full disks, signals, dying processes.

Each module lists its faults in FAULTS and SLOW; the docstring of a fault states what is right.
Next: a fault in the module of its theme, or a theme in `catalog.py`.
"""
