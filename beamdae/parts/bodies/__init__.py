"""Bodies: the ground, rigid bodies with their shapes, and particles. Beams are in `beams`.

May import: `part`, `attachments` and `laws` of `parts`, symbolic.
To extend: subclass `Part` with coordinates, inertia in `forces` and points as `Attachment`s.
"""
