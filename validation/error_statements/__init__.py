"""Stated errors beside true ones: runs that are too coarse in one respect, and accurate runs.

`cases.py` lists the cases, `mechanisms.py` draws mechanisms from seeds, `statements.py` reads what
beamdae states, and `references.py` computes the stored references.
"""
