"""Geometrically exact formulation of Reissner (1972) and Simo (1985).

May import: the modules of `beams` above it in the pipeline (mesh, sections, kinematics, strains).
Next: another interpolation of positions or section angles is a new element type here.
"""
