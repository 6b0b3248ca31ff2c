"""Commands of the CLI with their options and help texts, one or two per module.

May import: everything; modules that are slow to import are imported inside the command.
To extend: write `<name>_command` in a new module and register it in `cli.app`.
"""
