"""Checks of a run for what no refined run shows: mistakes of the model, and missed motions.

May import: results and the layers below; analyses only through `deferred`.
To extend: add a module with a function that yields sentences, and list it in `run_checks`.
"""
