"""Model files: import, error messages, installed examples, and outlines of unexecuted files.

May import: studies, model_functions and everything below; no other folder of cli.
Next: another kind of object that commands take from a model file is a property of `ModelFile`.
"""
