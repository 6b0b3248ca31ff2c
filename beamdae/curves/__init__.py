"""Plane curves parametrized by arc length: point, tangent angle, curvature.

May import: errors. Curves are evaluated with numpy and scipy, without CasADi.
To extend: add a frozen dataclass with the members of `plane_curves.PlaneCurve`.
"""
