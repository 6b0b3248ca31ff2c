"""The core in C: sums of kernels, linear systems, and the loops of integrators and analyses.

`core.h` defines the tables on which the functions of the core work. `tables` fills them from Python
objects and calls the functions, `library` finds or compiles the shared library, and
`linear_solver` holds the matrices that loops factorize, whose pivots Python chooses. Exported FMUs
contain the loops and the tables of one run.

May import: native, linear, errors. No mechanics here.
To extend: add a function of one structure to a C file and its prototype to `core.h`, and call it by
`Loop("function", object)`.
"""
