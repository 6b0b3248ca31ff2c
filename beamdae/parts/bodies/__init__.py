"""Bodies: the ground, rigid bodies with their shapes, and particles; beams have their own package.

May import: the modules of parts above `bodies`, symbolic.
Next: a body is a `Part` with coordinates, its inertia as `forces` and points as `Attachment`.
"""
