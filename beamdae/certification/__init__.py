"""Runs and analyses that are refined until their estimated error is small enough.

May import: analysis, simulation, results and lower layers.
A further certified analysis: a function in `analyses`, with its result in `results`.
"""
