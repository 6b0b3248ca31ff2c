"""Floating-frame formulation of Pan & Liu (2012): kinematics, element and formulas.

May import: the modules of `beams` above it in the pipeline (mesh, sections, kinematics, strains).
Next: another strain measure is a case of `element.strain_points`.
"""
