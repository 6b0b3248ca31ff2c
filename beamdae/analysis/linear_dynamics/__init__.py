"""Linearization about a state, and what follows from it: natural modes, Campbell diagrams, models.

May import: statics (states on a load path), simulation and lower layers; not periodic.
Next: a new eigenvalue solver or a new result of linearized equations becomes a module here.
"""
