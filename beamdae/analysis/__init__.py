"""Analyses other than time integration: static equilibria, natural modes, periodic motions.

May import: simulation and everything below it; never report, studies or cli.
To extend: add a folder for a new kind of analysis next to statics/.
"""
