"""What all commands have: --quiet and --json, users' mistakes in a sentence, and an exit code."""

from __future__ import annotations

import inspect
import shutil
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from beamdae.cli import signals, streams
from beamdae.cli.output import CommandOutput, print_error, use_output
from beamdae.errors import BeamdaeError, short_repr

# What a model or a command was wrong about; a run that failed ends with 1.
USAGE_ERROR = 2
EXIT_CODES = (
    "Exit codes: 0 done, 1 failed (what was reached is written), 2 a mistake in the command or the "
    "model, 130 after Ctrl-C, 143 after SIGTERM."
)
# Boxes of help cut words in fewer columns.
_MIN_BOX_WIDTH = 76
_OUT_OF_MEMORY = (
    "more memory is needed than there is; take fewer elements, or a larger output step."
)

_OUTPUT_OPTIONS = {
    "quiet": Annotated[
        bool,
        typer.Option("--quiet", "-q", help="Say nothing but what went wrong."),
    ],
    "as_json": Annotated[
        bool,
        typer.Option("--json", help="Say what was found as one JSON document."),
    ],
}
_UsageError: Any = typer.BadParameter.__base__


def wrap_command(name: str, command: Callable[..., None]) -> Callable[..., None]:
    """A command with the options all have, that ends by its exit code whatever happens in it."""

    @wraps(command)
    def ended(*, quiet: bool, as_json: bool, **options: Any) -> None:
        voice = CommandOutput(quiet, as_json)
        with ExitStack() as scope:
            scope.enter_context(use_output(voice))
            if as_json:
                scope.enter_context(streams.redirect_output_to_stderr())
            if quiet:
                scope.enter_context(warnings.catch_warnings(action="ignore"))
            code = _run_to_exit_code(lambda: command(**options))
        if as_json:
            typer.echo(voice.document(name, code))
        raise typer.Exit(code)

    # Help has its own width: lines of a docstring are none of its.
    paragraphs = (inspect.getdoc(command) or "").split("\n\n")
    ended.__doc__ = "\n\n".join(" ".join(one.split()) for one in paragraphs)
    own = inspect.signature(command, eval_str=True).parameters.values()
    more = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in _OUTPUT_OPTIONS.items()
    ]
    ended.__signature__ = inspect.Signature([*own, *more])  # type: ignore[attr-defined]
    ended.__annotations__ = {one.name: one.annotation for one in (*own, *more)}
    return ended


def _run_to_exit_code(command: Callable[[], None]) -> int:
    """The exit code of a command; of mistakes and interrupts it is told what they were."""
    try:
        command()
    except KeyboardInterrupt as problem:
        return _report_interrupt(str(problem))
    except typer.Exit as end:
        return end.exit_code
    except Exception as problem:
        if signals.is_interrupted():
            # Other code took the interrupt for a failure of its own.
            return _report_interrupt("")
        if isinstance(problem, MemoryError):
            problem = BeamdaeError(_OUT_OF_MEMORY)
        if not isinstance(problem, BeamdaeError):
            raise
        print_error(f"error: {problem}")
        return USAGE_ERROR
    except BaseException as problem:  # What a part or a law of a model raises to end it all.
        print_error(f"error: the model ended the run, {type(problem).__name__}({problem}).")
        return USAGE_ERROR
    return 0


def _report_interrupt(where: str) -> int:
    print_error(f"interrupted {where}".strip())
    return signals.exit_code()


class _PlainHelp:
    """Help without boxes where it is narrow, that says of no flag that it is true or false."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        columns, before = shutil.get_terminal_size().columns, vars(self).get("rich_markup_mode")
        if columns < _MIN_BOX_WIDTH:
            formatter.width = min(formatter.width, columns - 2)
            vars(self)["rich_markup_mode"] = None
        super().format_help(ctx, formatter)  # type: ignore[misc]
        vars(self)["rich_markup_mode"] = before

    def get_params(self, ctx: Any) -> Any:
        found = super().get_params(ctx)  # type: ignore[misc]
        for one in found:
            if getattr(one, "is_flag", False):
                one.metavar = ""
        return found


class Command(_PlainHelp, TyperCommand):
    """A command."""


class Commands(_PlainHelp, TyperGroup):
    """Commands; what is wrong with the options of one is told in one line."""

    def make_context(self, info_name: Any, args: list[str], *rest: Any, **more: Any) -> Any:
        """The context of a command line, and whether that asks for JSON, should it be wrong."""
        as_json = "--json" in args
        with _report_usage_errors(as_json):
            context = super().make_context(info_name, args, *rest, **more)
        context.obj = as_json
        return context

    def invoke(self, ctx: Any) -> Any:
        """Parse the options of the command, and do what it does."""
        with _report_usage_errors(ctx.obj):
            return super().invoke(ctx)


@contextmanager
def _report_usage_errors(as_json: bool) -> Iterator[None]:
    try:
        yield
    except _UsageError as problem:
        if type(problem).__name__ == "NoArgsIsHelpError":
            raise
        voice = CommandOutput(as_json=as_json)
        with use_output(voice):
            print_error(_format_usage_error(problem))
        if as_json:
            typer.echo(voice.document(problem.ctx.info_name if problem.ctx else "", USAGE_ERROR))
        raise typer.Exit(USAGE_ERROR) from None


def _format_usage_error(problem: Any) -> str:
    """What is wrong with options, and the value that is."""
    # The parser of options does not always know whose they are.
    command = problem.ctx.command_path if problem.ctx else "beamdae"
    words = problem.format_message().rstrip(".")
    details: Any = getattr(problem.__cause__, "errors", list)()
    got = f", got {short_repr(details[0]['input'])}" if details else ""
    words = f"{words[:1].lower()}{words[1:]}".replace(". Did", ", did")
    return f"error: {command}: {words}{got} ({command} --help tells more)."
