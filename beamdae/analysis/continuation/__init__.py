"""Continuation: curves of solutions of equations with one parameter, and their critical points.

May import equations and linear algebra. The engine knows nothing of mechanics.
"""
