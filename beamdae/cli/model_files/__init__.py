"""Model files: import, error messages, installed examples, and outlines read without execution.

May import: studies, model_functions and what is below them; nothing else of cli.
Next: another kind of object that commands take from a model file is a property of `ModelFile`.
"""
