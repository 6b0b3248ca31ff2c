"""Warnings about elements of beams, and about strains beyond the range of their theory.

May import: as `results.diagnostics`.
To extend: add a module for a new check and add it to `results.run_checks`.
"""
