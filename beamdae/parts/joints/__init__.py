"""Joints: constraints between attachments, drivers, gears, rolling contacts and skates.

May import: the modules of parts above `joints`, symbolic.
To extend: subclass `Joint` and define its gap function, in the module of its family.
"""
