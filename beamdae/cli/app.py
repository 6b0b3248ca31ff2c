"""The command-line application `beamdae`."""

from __future__ import annotations

import logging
import os
import sys
import warnings
from collections.abc import Callable
from typing import Annotated, Any

import typer

from beamdae.cli import completion, signals, streams
from beamdae.cli.command_wrapper import EXIT_CODES, Command, Commands, wrap_command
from beamdae.cli.commands.buckling import buckling_command
from beamdae.cli.commands.check import check_command
from beamdae.cli.commands.compare import compare_command
from beamdae.cli.commands.draw import draw_command
from beamdae.cli.commands.examples import examples_command, new_command
from beamdae.cli.commands.list import list_command
from beamdae.cli.commands.modes import modes_command
from beamdae.cli.commands.periodic import periodic_command
from beamdae.cli.commands.response import response_command
from beamdae.cli.commands.run import run_command
from beamdae.cli.commands.static import static_command
from beamdae.cli.commands.sweep import sweep_command
from beamdae.cli.output import record_warning
from beamdae.errors import BeamdaeWarning, KernelWarning

app = typer.Typer(
    name="beamdae",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    epilog=EXIT_CODES,
)

_COMMANDS: dict[str, Callable[..., None]] = {
    "run": run_command,
    "compare": compare_command,
    "sweep": sweep_command,
    "check": check_command,
    "draw": draw_command,
    "static": static_command,
    "buckling": buckling_command,
    "modes": modes_command,
    "periodic": periodic_command,
    "response": response_command,
    "list": list_command,
    "examples": examples_command,
    "new": new_command,
}
for _name, _command in _COMMANDS.items():
    app.command(_name, cls=Command)(wrap_command(_name, _command))


def main() -> None:
    """Run the command line and exit with its exit code, even after signals and stream errors."""
    code = 0
    try:
        streams.secure_streams()
        _configure_warnings()
        with completion.rejoin_bash_words():
            app(prog_name="beamdae")
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


@app.callback()
def beamdae(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Simulate planar mechanisms with curved, flexible beams."""
