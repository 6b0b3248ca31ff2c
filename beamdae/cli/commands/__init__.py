"""Commands of the CLI; each module defines one command with its options and help text.

May import: everything; modules that are slow to import are imported inside the command.
To extend: write `<name>_command` in a new module and register it in `cli.app`.
"""
