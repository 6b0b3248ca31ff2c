"""Plane curves by arc length: point, tangent angle, curvature.

May import: errors. Plain numpy, no symbols.
Next: a curve is a frozen dataclass with the methods of `plane_curves.PlaneCurve`.
"""
