"""The commands, one module each: its options, its help text and what it runs.

May import: everything; modules that are slow to import are imported inside the command.
Next: a command is a module here with a function `<name>_command`, registered in `cli.app`.
"""
