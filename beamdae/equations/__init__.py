"""Equations of motion: assembled from statements, formulated for integrators, made consistent.

Here: the equations as data, their structure, energy balance, hash and failure diagnosis; assembly/
builds them, formulations/ derives residuals and Jacobians, starts/ consistent initial conditions.
May import: beams, parts, symbolic, native, linear, model_functions and below.
Next: a new form of the equations goes to formulations/; what it derives from a structure is
cached with `@cache_on_owner`.
"""
