"""The command-line application `beamdae`."""

from __future__ import annotations

import logging
import os
import sys
import warnings
from functools import cache
from importlib import import_module
from typing import Annotated, Any

import typer

from beamdae.cli import signals, streams
from beamdae.cli.command_wrapper import EXIT_CODES, Command, Commands, wrap_command

# Commands by the group in which the help shows them.
_GROUPS = {
    "Models": ("new", "examples", "list", "draw", "view", "check"),
    "Runs": ("run", "sweep", "compare"),
    "Statics and vibrations": ("static", "buckling", "modes", "bode", "periodic", "response"),
    "Parameters and export": ("fit", "optimize", "export"),
}
_GROUP_OF_COMMAND = {name: group for group, names in _GROUPS.items() for name in names}
# Modules in `cli.commands` that do not have the name of their command. Their functions are
# `<name>_command`.
_MODULES = {"new": "examples"}


@cache
def create_app(*names: str) -> typer.Typer:
    """Return the application with the commands `names`; without names, with all commands."""
    app = typer.Typer(
        name="beamdae",
        cls=Commands,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        epilog=EXIT_CODES,
        context_settings={"help_option_names": ["--help", "-h"]},
    )
    app.callback()(_beamdae)
    for name in names or _GROUP_OF_COMMAND:
        module = import_module(f"beamdae.cli.commands.{_MODULES.get(name, name)}")
        command = wrap_command(name, getattr(module, f"{name}_command"))
        app.command(name, cls=Command, rich_help_panel=_GROUP_OF_COMMAND[name])(command)
    return app


def __getattr__(name: str) -> Any:
    if name == "app":
        return create_app()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def main() -> int:
    """Run the command line and return its exit code, even after signals and stream errors."""
    code = 0
    try:
        streams.secure_streams()
        _configure_warnings()
        # Importing all commands takes longer than the start of a command.
        names = (name for name in sys.argv[1:2] if name in _GROUP_OF_COMMAND)
        create_app(*names)(prog_name="beamdae")
    except SystemExit as problem:
        code = problem.code if isinstance(problem.code, int) else int(problem.code is not None)
    except KeyboardInterrupt:
        code = signals.exit_code()
    signals.ignore_signals()
    if signals.is_interrupted():
        code = signals.exit_code()
    return streams.flush_output(code)


def _configure_warnings() -> None:
    # Non-finite values are reported by messages of beamdae.
    warnings.filterwarnings("ignore", category=RuntimeWarning, module="beamdae|numpy|pandas")
    # Without a font cache, matplotlib works but logs many lines.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        # The XDG specification ignores relative paths; matplotlib would create the folder in the
        # working folder.
        if not os.path.isabs(os.environ.get(name, "/")):
            del os.environ[name]


def _print_version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        typer.echo(f"beamdae {version('beamdae')}")
        raise typer.Exit


def _beamdae(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Simulate planar mechanisms with curved, flexible beams.

    Begin with `beamdae new my_model.py` or `beamdae run example:four_bar`.
    """
