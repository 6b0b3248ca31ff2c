"""Hostile files: valid files with mutated content and correct checksums, read and used.

May import: beamdae and robustness.judge. To extend: add a kind to `kinds`, a change to `mutations`.
"""
