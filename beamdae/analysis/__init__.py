"""Analyses other than time integration: equilibria, natural modes, periodic motions.

May import: simulation and everything below it; never report, studies or cli.
Next: a new kind of analysis becomes a folder next to statics/.
"""
