"""Forces: loads, springs and dampers, contact, friction, and laws written by users.

May import: the modules of parts above `forces`, `parts.joints` for friction in joints, symbolic.
Next: a force between two points is a `ForceElement`, any other one a `Part` with `forces`.
"""
