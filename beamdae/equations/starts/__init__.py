"""Starts: consistent initial conditions, redundant constraints, mobility and equilibrium.

May import: equations_of_motion, structure, measures, smooth_intervals, formulations, parts,
symbolic, linear, errors; not assembly.
To extend: add evaluations of one state to `state_evaluator`, and a module for each method that
solves for a state.
"""
