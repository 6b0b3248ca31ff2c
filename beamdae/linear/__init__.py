"""Linear systems whose sparsity pattern is fixed: orderings, pivots, factorizations.

May import: errors.
Next: another factorization goes into `factorizations`, loops over the entries of factors that
compiled code calls into `elimination`.
"""
