"""Geometrically exact formulation of Reissner (1972) and Simo (1985).

May import: symbolic, parts, read_only, and modules of `beams` such as sections and kinematics.
To extend: add another interpolation of positions or section angles as an element type here.
"""
