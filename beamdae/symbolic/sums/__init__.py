"""Sums of kernels over many copies: plans, evaluation in vector lanes, and their derivatives.

May import: symbolic.compiled, symbolic.local_symbols, symbolic.sparse_operators,
symbolic.table_lookups, native, linear.
To extend: a derivative of all sums is a function that returns a `SumPlan`, as in `sum_derivatives`.
"""
