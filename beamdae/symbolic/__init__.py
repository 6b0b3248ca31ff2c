"""Local statements in CasADi symbols, kernels derived from them, and sparse sums of kernels.

May import: native, linear, errors. Knows no mechanics.
Next: a derivative that follows from a statement goes beside the others, in `force_kernel` or
`constraint_kernel`.
"""
