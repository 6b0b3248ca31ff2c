"""Equations of motion: data, assembly, formulations for integrators, and consistent starts.

Here: the equations as data, their structure, energy balance, hash and failure diagnosis; assembly/
builds them, formulations/ derives residuals and Jacobians, and starts/ computes consistent initial
conditions.
May import: parts, symbolic, model_functions, native, linear, memory, read_only, bounded_cache,
errors.
To extend: add a form of the equations to formulations/, and cache the plans of its sums, and other
data derived from a structure, with `@cache_on_owner`.
"""
