"""Model files: import, error messages, installed examples, and outlines of unexecuted files.

May import: studies and everything below; no other module of cli.
To extend: add a property to `ModelFile` for each new kind of object that commands read from model
files.
"""
