"""Section forces N, Q, M of beams: loads along a beam, their balance, stresses and safety.

May import: results.run_data and results.displays, beams, equations, symbolic.
Next: a quantity derived from N, Q and M is a method of `SectionForces`.
"""
