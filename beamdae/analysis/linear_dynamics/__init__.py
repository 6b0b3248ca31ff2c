"""Linearization about a state, natural modes, Campbell diagrams and state-space models.

May import: eigenproblems, statics (states on a load path), simulation and lower layers.
To extend: add a module for a new result of the linearized equations.
"""
