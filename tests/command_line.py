"""Run the command `beamdae` in the process of the test."""

from typer.testing import CliRunner

from beamdae.cli.app import app


def invoke(*arguments, env=None):
    """Return the result of the command with these arguments: exit code, output and errors."""
    return CliRunner().invoke(app, [str(x) for x in arguments], env=env)


def succeed(*arguments, env=None):
    """Return the result of the command with these arguments, whose exit code is zero."""
    result = invoke(*arguments, env=env)
    assert result.exit_code == 0, result.output
    return result
