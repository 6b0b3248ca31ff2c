"""Starts: consistent initial conditions, redundant constraints, mobility and equilibrium.

May import: equations_of_motion, structure, measures and formulations, linear; not assembly.
To extend: add evaluations of one state to `state_evaluator`, and a module for each method that
solves for a state.
"""
