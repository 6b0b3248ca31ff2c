"""Section forces N, Q and M of beams, computed from the loads along the beam, and stresses.

May import: results.run_data, trajectory and displays; equations and the layers below.
To extend: add a quantity derived from N, Q and M as a method of `SectionForces`.
"""
