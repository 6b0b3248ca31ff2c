"""Published and closed-form cases for integrators and analyses.

`run.py` compares all cases and writes summary.csv; the tests use the same cases.
To extend: add a `PublishedCase`, `StaticCase`, `ModeCase`, `PathCase` or `PeriodicCase` to the
tuple of cases in the module of its kind.
"""
