"""Beams: sections, meshes on curves, kinematics, loads and damping.

May import: parts, curves, symbolic and the layers below. Independent of equations and integrators.
To extend: add a formulation as a module with subclasses of `FormulationKinematics` and `Element`,
and register its name in `beam.py`.
"""
