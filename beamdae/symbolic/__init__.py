"""Symbols and numbers: local statements, sparse sums of them, compiled functions, factorizations.

May import: errors. Knows no mechanics.
Next: a derivative that follows from a statement, beside the others in `statements`.
"""
