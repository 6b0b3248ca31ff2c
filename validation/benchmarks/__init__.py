"""Published and closed-form cases for integrators and analyses.

`run.py` compares all of them and writes summary.csv; the tests use the same cases.
Next: a case is a `PublishedCase`, `StaticCase`, `ModeCase`, `PathCase` or `PeriodicCase` in the
tuple of its module.
"""
