"""Geometrically exact formulation of Reissner (1972) and Simo (1985).

May import: the modules of `beams` that it builds on (mesh, sections, kinematics, strains).
To extend: add another interpolation of positions or section angles as an element type here.
"""
