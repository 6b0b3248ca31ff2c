"""Forces: loads, springs and dampers, contact, friction, and user-written laws.

May import: the modules of parts above `forces`, `parts.joints` for friction in joints, symbolic.
To extend: subclass `ForceElement` for a force between two points, otherwise `Part`.
"""
