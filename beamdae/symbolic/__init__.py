"""Local statements in CasADi symbols, and the kernels that are derived from them.

May import: native, linear, read_only, bounded_cache, errors. No mechanics here.
To extend: add a derivative of statements to `force_kernel` or `constraint_kernel`. Functions are
evaluated in `compiled`, sums of kernels in `sums`.
"""
