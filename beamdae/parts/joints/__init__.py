"""Joints: constraints between attachments, drivers, gears, rolling contacts and skates.

May import: the modules of parts above `joints`, symbolic.
Next: a joint is a subclass of `Joint` with its gap function, in the file of its family.
"""
