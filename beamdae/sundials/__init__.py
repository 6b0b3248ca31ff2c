"""IDA of SUNDIALS through its C interface, in the libraries linked by scikit-sundae.

Imports no other package of beamdae. Residual and Jacobian are addresses of C functions.
To extend: for another statistic of IDA, add its C function to `library`, a field to
`solver.IdaStatistics`, and the name of the function and the type of its value to
`solver._GETTERS`.
"""
