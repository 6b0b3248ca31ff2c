"""Critical loads of columns, frames, rings and arches over slenderness and mesh.

The references do not use beamdae: `frame_stability.py` (stability functions), `column_dynamics.py`
(characteristic equations), `rings.py` and `shooting.py` (Reissner's equations). The
scoreboard runs all cases. To extend: add a row to cases.csv.
"""
