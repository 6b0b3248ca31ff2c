"""Joints: constraints between attachments, drivers, gears, rolling contacts and skates.

May import: `part`, `attachments` and `laws` of `parts`, symbolic, errors.
To extend: subclass `Joint` and define its gap function, in the module of its family.
"""
