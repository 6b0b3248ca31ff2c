"""The command line: what can be done with model files."""

from __future__ import annotations

import logging
import os
import sys
import warnings
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from beamdae.cli import interrupts, streams
from beamdae.cli.check import check_command
from beamdae.cli.compare import compare_command
from beamdae.cli.draw import draw_command
from beamdae.cli.examples import examples_command, new_command
from beamdae.cli.listing import list_command
from beamdae.cli.modes import modes_command
from beamdae.cli.run import run_command
from beamdae.cli.saying import complain
from beamdae.cli.static import static_command
from beamdae.cli.sweep import sweep_command
from beamdae.errors import BeamdaeError, BeamdaeWarning, KernelWarning
from beamdae.report.letters import plain

# What a model or a command was wrong about; a run that failed ends with 1.
_MISTAKE = 2
_NO_MEMORY = "more memory is needed than there is; take fewer elements, or a larger output step."


class _PlainHelp:
    """Help that does not say of flags that they are true or false."""

    def get_help_option(self, ctx: Any) -> Any:
        option = super().get_help_option(ctx)  # type: ignore[misc]
        if option is not None:
            option.metavar = ""
        return option


class _Command(_PlainHelp, TyperCommand):
    """A command."""


class _Commands(_PlainHelp, TyperGroup):
    """Commands whose users' mistakes are told in one line."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as problem:
            _interrupted(str(problem))
        except (typer.Exit, typer.Abort):
            raise
        except Exception as problem:
            if interrupts.heard():
                # Other code took the interrupt for a failure of its own.
                _interrupted("")
            if isinstance(problem, MemoryError):
                problem = BeamdaeError(_NO_MEMORY)
            if not isinstance(problem, BeamdaeError):
                raise
            complain(f"error: {problem}")
        except BaseException as problem:  # What a part or a law of a model raises to end it all.
            complain(f"error: the model ended the run, {type(problem).__name__}({problem}).")
        raise typer.Exit(_MISTAKE)


def _interrupted(where: str) -> None:
    complain(f"interrupted {where}".strip())
    raise typer.Exit(interrupts.code())


app = typer.Typer(
    cls=_Commands, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)

app.command("run", cls=_Command)(run_command)
app.command("compare", cls=_Command)(compare_command)
app.command("sweep", cls=_Command)(sweep_command)
app.command("check", cls=_Command)(check_command)
app.command("draw", cls=_Command)(draw_command)
app.command("static", cls=_Command)(static_command)
app.command("modes", cls=_Command)(modes_command)
app.command("list", cls=_Command)(list_command)
app.command("examples", cls=_Command)(examples_command)
app.command("new", cls=_Command)(new_command)


def main() -> None:
    """Run the command line, to its exit code whatever becomes of its signals and streams."""
    code = 0
    try:
        streams.secure()
        _quiet()
        app(prog_name="beamdae")
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except KeyboardInterrupt:
        code = interrupts.code()
    interrupts.deaf()
    sys.exit(streams.ended(interrupts.code() if interrupts.heard() else code))


def _quiet() -> None:
    """Nothing but sentences on standard error, whatever libraries have to say there."""
    # What is not finite is told by a sentence.
    warnings.filterwarnings("ignore", category=RuntimeWarning, module="beamdae|numpy|pandas")
    warnings.formatwarning = _in_a_line
    # It goes on without a cache of fonts, and says so on many lines.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        # As their specification has it; matplotlib would make it a folder of the working folder.
        if not os.path.isabs(os.environ.get(name, "/")):
            del os.environ[name]


_formatted = warnings.formatwarning


def _in_a_line(message: Any, category: type[Warning], *place: Any, **more: Any) -> str:
    """Warnings of beamdae's own are sentences; of others it matters where they come from."""
    if issubclass(category, (BeamdaeWarning, KernelWarning)):
        return f"warning: {plain(str(message))}\n"
    return _formatted(message, category, *place, **more)


def _say_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"beamdae {version('beamdae')}")
        raise typer.Exit


@app.callback()
def beamdae(
    version: Annotated[
        bool,
        typer.Option(
            "--version", metavar="", callback=_say_version, is_eager=True, help="Say the version."
        ),
    ] = False,
) -> None:
    """Simulate curved beams in flexible multibody systems."""
