"""Section forces N, Q and M of beams, computed from the loads along the beam, and stresses.

May import: results.run_data and below, results.displays, beams, parts, equations, symbolic.
To extend: add a quantity derived from N, Q and M as a method of `SectionForces`.
"""
