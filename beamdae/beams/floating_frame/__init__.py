"""Floating-frame formulation of Pan & Liu (2012): kinematics, element and formulas.

May import: the modules of `beams` that it builds on (mesh, sections, kinematics, strains).
To extend: add another strain measure as a case of `element.strain_points`.
"""
