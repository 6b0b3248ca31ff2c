"""The command line: commands, their options, and the files they read.

May import everything; whatever is slow to import is imported inside a command.
Next: a command is a function in a file of its own, made known in `commands`.
"""
