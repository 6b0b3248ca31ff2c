"""Faults of the environment: damaged files, full disks, signals, dying processes.

Each theme module lists its faults in FAULTS and SLOW; the docstring of a fault states the required
behavior. To extend: add a fault to the module of its theme, or a theme to `catalog.THEMES`.
"""
