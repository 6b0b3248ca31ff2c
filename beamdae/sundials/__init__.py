"""IDA of SUNDIALS through its C interface, in the libraries that come with scikit-sundae.

May import: errors. Residual and Jacobian are addresses of C functions.
To extend: for another statistic of IDA, add its function to `prototypes`, a field to
`solver.IdaStatistics` and the type of its value to `solver._GETTERS`.
"""
