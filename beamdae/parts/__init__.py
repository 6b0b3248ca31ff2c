"""Parts of a mechanism: bodies, joints, forces, laws of time, observables and events.

May import: curves, symbolic. Parts are stated in local symbols, without global coordinates.
Next: a joint goes to `joints`, a force to `forces`, a body to `bodies`; each is one class.
"""
