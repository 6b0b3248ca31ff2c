"""Published and closed-form cases for integrators and analyses.

Tests and boards of the scoreboard run the cases. To extend: add a `PublishedCase` or a
`ReferenceCase` to the tuple of cases in the module of its kind.
"""
