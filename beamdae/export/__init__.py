"""Functional mock-up units (FMUs): models as C source and binaries that need no Python.

May import: analysis and everything below it.
To extend: an array or a sum that steps need is added to a structure in `c/tables.h` and to
`model_source`; a method is a file such as `c/alpha_steps.c` that calls a loop of the core and
defines the functions `method_...` of `c/instance.h`; what the steps cannot do is rejected in `fmu`.
"""
