"""Forces: loads, springs and dampers, contact, friction, and user-written laws.

May import: `part`, `attachments`, `laws` and `joints` (for friction) of `parts`, symbolic, errors.
To extend: subclass `ForceElement` for a force between two points, otherwise `Part`.
"""
