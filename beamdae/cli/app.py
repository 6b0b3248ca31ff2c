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

from beamdae.cli import completion, signals, streams
from beamdae.cli.command_wrapper import EXIT_CODES, Command, Commands, wrap_command
from beamdae.cli.output import record_warning
from beamdae.errors import BeamdaeWarning, KernelWarning

# Modules in `cli.commands`, and the functions `<name>_command` in them, by the name of the command.
_COMMAND_MODULES = {
    "run": "run",
    "compare": "compare",
    "sweep": "sweep",
    "check": "check",
    "draw": "draw",
    "view": "view",
    "static": "static",
    "buckling": "buckling",
    "modes": "modes",
    "periodic": "periodic",
    "response": "response",
    "fit": "fit",
    "optimize": "optimize",
    "export": "export",
    "list": "list",
    "examples": "examples",
    "new": "examples",
}


@cache
def create_app(*names: str) -> typer.Typer:
    """Return the application with the commands `names`; without names, with all commands."""
    app = typer.Typer(
        name="beamdae",
        cls=Commands,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        epilog=EXIT_CODES,
    )
    app.callback()(_beamdae)
    for name in names or _COMMAND_MODULES:
        module = import_module(f"beamdae.cli.commands.{_COMMAND_MODULES[name]}")
        command = getattr(module, f"{name}_command")
        app.command(name, cls=Command)(wrap_command(name, command))
    return app


def __getattr__(name: str) -> Any:
    if name == "app":
        return create_app()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def main() -> None:
    """Run the command line and exit with its exit code, even after signals and stream errors."""
    code = 0
    try:
        streams.secure_streams()
        _configure_warnings()
        with completion.rejoin_bash_words():
            # Importing all commands takes longer than the start of a command.
            create_app(*(name for name in sys.argv[1:2] if name in _COMMAND_MODULES))(
                prog_name="beamdae"
            )
    except SystemExit as problem:
        code = problem.code if isinstance(problem.code, int) else int(problem.code is not None)
    except KeyboardInterrupt:
        code = signals.exit_code()
    signals.ignore_signals()
    if signals.is_interrupted():
        code = signals.exit_code()
    sys.exit(streams.flush_output(code))


def _configure_warnings() -> None:
    # Non-finite values are reported by messages of beamdae.
    warnings.filterwarnings("ignore", category=RuntimeWarning, module="beamdae|numpy|pandas")
    warnings.formatwarning = _format_warning
    # Without a font cache, matplotlib works but logs many lines.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        # The XDG specification ignores relative paths; matplotlib would create the folder in the
        # working folder.
        if not os.path.isabs(os.environ.get(name, "/")):
            del os.environ[name]


_format_warning_by_default = warnings.formatwarning


def _format_warning(message: Any, category: type[Warning], *place: Any, **more: Any) -> str:
    """Format a warning: as a sentence if it is from beamdae, otherwise with file and line."""
    if issubclass(category, (BeamdaeWarning, KernelWarning)):
        return f"warning: {record_warning(str(message))}\n"
    return _format_warning_by_default(message, category, *place, **more)


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
    """Simulate planar mechanisms with curved, flexible beams."""
