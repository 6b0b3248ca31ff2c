"""Beams: sections, meshes on curves, the kinematics of their points, damping.

May import: parts, curves, symbolic. Knows nothing of equations or time stepping.
Next: a kinematics is one file that subclasses `Kinematics` and `Element` (see `floating_frame`).
"""
