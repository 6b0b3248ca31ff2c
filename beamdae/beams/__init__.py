"""Beams: sections, meshes on curves, kinematics of their points, loads and damping of beams.

May import: parts, curves, symbolic. Independent of equations and time stepping.
Next: a kinematics subclasses `Kinematics` and `Element` in its own folder (see `floating_frame`).
"""
