"""Plane curves parametrized by arc length: point, tangent angle, curvature.

May import: errors. Plain numpy, no symbols.
To extend: add a frozen dataclass with the methods of `plane_curves.PlaneCurve`.
"""
