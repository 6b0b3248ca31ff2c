"""Parts of a mechanism: bodies, joints, loads, laws of time, and what is observed of them.

May import: curves, symbolic. States mechanics in local symbols, knows no global coordinates.
Next: a joint in `joints` (a `Joint`), a load in `forces` (a `Part` that states `forces`).
"""
