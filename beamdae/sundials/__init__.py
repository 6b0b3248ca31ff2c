"""SUNDIALS' IDA by its C interface, in the libraries that scikit-sundae brings along.

May import: errors. Knows no equations: residual and Jacobian are addresses of C functions.
Next: a statistic of IDA, with its function in `prototypes` and its field in `solver.Statistics`.
"""
