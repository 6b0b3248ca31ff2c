"""IDA of SUNDIALS: settings, error weights and two interfaces to the library.

May import: equations, linear, native, sundials, results, memory, errors, and the shared modules of
integrators.
To extend: add functions that IDA calls to `core/ida.c`, and options of IDA to `stepper`.
"""
