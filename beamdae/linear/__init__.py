"""Linear systems whose sparsity pattern is fixed: orderings, pivots, factorizations.

May import: bounded_cache.
To extend: add factorizations to `factorizations`. Loops over the entries of factors, which compiled
code calls, belong in `elimination`.
"""
