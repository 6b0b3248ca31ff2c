"""Bodies: the ground, rigid bodies with their shapes, and particles. Beams are in `beams`.

May import: the modules of parts above `bodies`, symbolic.
To extend: subclass `Part` with coordinates, inertia in `forces` and points as `Attachment`s.
"""
