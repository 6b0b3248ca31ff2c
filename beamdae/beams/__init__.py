"""Beams: sections, meshes on curves, kinematics, loads and damping.

May import: parts, curves, symbolic, memory, errors. Independent of equations and time stepping.
To extend: add a formulation as a folder with subclasses of `Kinematics` and `Element`.
"""
