"""IDA of SUNDIALS through its C interface, in the libraries linked by scikit-sundae.

Imports no other package of beamdae. Residual and Jacobian are addresses of C functions.
To extend: for another number of IDA, add its C function to `library` and a property to
`solver.IdaSolver`.
"""
