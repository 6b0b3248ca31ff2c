"""The command line: the application, options, output and signals that all commands share.

May import: everything; modules that are slow to import are imported inside functions.
Next: a command is a function in a module of `commands` and one line in `app`.
"""
