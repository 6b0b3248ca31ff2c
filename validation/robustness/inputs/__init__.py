"""Bad inputs: values in place of arguments, unphysical models, model files, command lines.

`catalog.py` collects them; `sandbox.py` has the small mechanism that they are tried on.
Next: a working call of a new public name in `*_calls.py`, a value in `bad_values.py`.
"""
