"""Linearization about a state, natural modes, Campbell diagrams and state-space models.

May import: statics (states on a load path), simulation and lower layers; not periodic.
To extend: add a module for a new eigenvalue solver or a new result of the linearized equations.
"""
