"""Linear systems whose sparsity pattern is fixed: orderings, pivots, factorizations.

May import: errors.
To extend: add factorizations to `factorizations`, and loops over the entries of factors that
compiled code calls to `elimination`.
"""
