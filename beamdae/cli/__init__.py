"""Command-line interface: application, and shared options, output and signal handling.

May import: everything; modules that are slow to import are imported inside functions.
To extend: write a command in a new module of `commands` and register it in `app`.
"""
