"""Bad inputs: values in place of arguments, unphysical models, model files, command lines.

`catalog.py` collects the inputs, and `sandbox.py` defines the small mechanism for their trials.
To extend: add a working call of a new public name to `*_calls.py`, or a value to `bad_values.py`.
"""
