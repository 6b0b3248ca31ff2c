"""IDA of SUNDIALS: settings, error weights, callbacks and two interfaces to the library.

May import: sundials, native, and error control, plan and driver of integrators.
To extend: add functions that IDA calls to `callbacks`, and options of IDA to `stepper`.
"""
