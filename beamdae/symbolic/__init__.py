"""Local statements in CasADi symbols, kernels derived from them, and sparse sums of kernels.

May import: native, linear, read_only, bounded_cache, errors. No mechanics here.
To extend: add a derivative of statements to `force_kernel` or `constraint_kernel`.
"""
