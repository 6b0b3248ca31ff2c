"""IDA of SUNDIALS: settings, error weights, callbacks and the two ways to call the library.

May import: sundials, native, and error control, plan and driver of integrators.
Next: what IDA calls goes into `callbacks`; what it is set to goes into `stepper`.
"""
