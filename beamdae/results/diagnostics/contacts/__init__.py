"""Warnings about contacts, impacts and friction.

May import: as `results.diagnostics`.
To extend: add a module for a new check and add it to `results.run_checks`.
"""
