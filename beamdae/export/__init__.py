"""Functional mock-up units (FMUs): models as C source and binaries that need no Python.

May import: analysis and everything below it.
To extend: a term of the equations that steps need is added to the struct `Model` in `c/stepper.h`
and to `model_source`; a method is a file such as `c/alpha.c` that defines the functions
`method_...` of `c/instance.h`; what the steps cannot do is rejected in `fmu`.
"""
