"""Errors of results, measured by one repetition with everything refined together.

It uses all analyses; commands and studies use it. The next analysis gets a module that repeats it
with the mechanism of `refinement` and compares both with `values`.
"""
