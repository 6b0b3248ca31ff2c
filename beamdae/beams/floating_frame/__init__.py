"""Floating-frame formulation of Pan & Liu (2012): kinematics and element.

May import: symbolic, parts, curves, read_only, errors, and modules of `beams` such as mesh.
To extend: add another strain measure as a case of `element.strain_at`.
"""
