"""Bodies: the ground, rigid bodies with their shapes, and particles. Beams are in `beams`.

May import: `part` and `attachments` of `parts`, symbolic, errors.
To extend: subclass `Part` with coordinates, inertia in `forces` and points as `Attachment`s.
"""
