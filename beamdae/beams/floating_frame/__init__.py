"""Floating-frame formulation of Pan & Liu (2012): kinematics, element and formulas.

May import: symbolic, parts, curves, and modules of `beams` such as mesh and kinematics.
To extend: add another strain measure as a case of `element.strain_points`.
"""
