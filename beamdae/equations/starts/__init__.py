"""Starts: consistent initial conditions, redundant constraints, mobility and equilibrium.

May import: equations_of_motion, structure, measures and formulations, linear; not assembly.
Next: what evaluates one state goes to state_evaluator, what solves for a state to its own module.
"""
