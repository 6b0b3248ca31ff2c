"""Errors of results, measured by one repetition with everything refined together.

It uses all analyses; commands and studies use it, and `until` repeats analyses until their errors
are small. The next analysis gets a module that repeats it with the mechanism of `refinement` and
compares both in its module.
"""
