"""IDA of SUNDIALS through its C interface, in the libraries that scikit-sundae brings along.

May import: errors. Knows no equations: residual and Jacobian are addresses of C functions.
Next: another statistic of IDA needs its function in `prototypes` and a field in
`solver.IdaStatistics`.
"""
