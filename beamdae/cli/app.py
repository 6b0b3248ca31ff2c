"""The command-line application: its commands, their common options, errors and exit codes."""

from __future__ import annotations

import inspect
import logging
import os
import shutil
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import is_dataclass
from functools import cache, wraps
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from beamdae import deferred
from beamdae.cli import process
from beamdae.cli.options import output_option
from beamdae.cli.output import CommandOutput, hold_warnings, print_error, use_output
from beamdae.errors import BeamdaeError, short_repr
from beamdae.input_files import CHECKPOINT, register_input
from beamdae.interrupts import Interrupted, interruptible
from beamdae.memory import is_out_of_memory
from beamdae.report.option_names import use_options

# Exit code of a usage or model error; a failed run ends with 1.
USAGE_ERROR = 2
EXIT_CODES = (
    "Exit codes: 0 success, 1 failure (partial results are written), 2 usage or model error, "
    "3 study incomplete because processes or a cluster failed (run it again to resume), "
    "130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP (closed terminal)."
)
# Commands that show warnings at once, because they run until they are interrupted.
_ENDLESS_COMMANDS = ("view",)
_COMMANDS_WITH_DETAILS = ("fit", "run", "static")  # see `Report.details`
# In narrower terminals the boxes around help texts would cut words.
_MIN_BOX_WIDTH = 76  # columns
_OUT_OF_MEMORY = "out of memory; use fewer elements or a larger output step."
_DELETED_FOLDER = "the working folder has been deleted; change to an existing folder."

_OUTPUT_OPTIONS = {
    "verbose": Annotated[
        bool, output_option("--verbose", "-v", help="Print settings, cost and checks, too.")
    ],
    "quiet": Annotated[bool, output_option("--quiet", "-q", help="Print errors only.")],
    "as_json": Annotated[
        bool, output_option("--json", help="Print the results as one JSON document.")
    ],
}
# Options with paths of outputs; the paths of all others are inputs.
_OUTPUT_PATHS = {"out", "fmu", "checkpoint"}
_UsageError: Any = typer.BadParameter.__base__

# Modules in `cli.commands` by command, in the groups of the help.
_GROUPS = {
    "Models": {
        "new": "models",
        "examples": "models",
        "list": "list",
        "draw": "models",
        "view": "models",
        "check": "models",
    },
    "Runs": {"run": "run", "sweep": "sweep", "compare": "compare"},
    "Statics and vibrations": {
        "static": "statics",
        "buckling": "statics",
        "modes": "vibrations",
        "bode": "vibrations",
        "periodic": "periodic",
        "response": "periodic",
    },
    "Parameters and export": {"fit": "parameters", "optimize": "parameters", "export": "export"},
}
_GROUP_OF_COMMAND = {name: group for group, names in _GROUPS.items() for name in names}


def wrap_command(name: str, command: Callable[..., None]) -> Callable[..., None]:
    """Add --quiet and --json to a command, and turn its errors into messages and exit codes."""
    own = list(inspect.signature(command, eval_str=True).parameters.values())
    job_type: Any = own[0].annotation if own and is_dataclass(own[0].annotation) else None
    of_job: list[inspect.Parameter] = []
    if job_type is not None:
        own = own[1:]
        of_job = list(inspect.signature(job_type, eval_str=True).parameters.values())[1:]

    def call_command(options: dict[str, Any]) -> None:
        arguments = []
        if job_type is not None:
            arguments.append(job_type(name, **{x.name: options.pop(x.name) for x in of_job}))
        command(*arguments, **options)

    @wraps(command)
    def run_and_exit(*, quiet: bool, as_json: bool, verbose: bool = False, **options: Any) -> None:
        output = CommandOutput(quiet, as_json, verbose)
        for option in options.keys() - _OUTPUT_PATHS:
            if isinstance(path := options[option], Path):
                register_input(path, CHECKPOINT if option == "resume_from" else "")
        with ExitStack() as stack:
            stack.enter_context(use_output(output))
            if as_json:
                stack.enter_context(process.redirect_output_to_stderr())
            if quiet:
                stack.enter_context(warnings.catch_warnings(action="ignore"))
            else:
                stack.enter_context(hold_warnings(output, name in _ENDLESS_COMMANDS))
            code = _run_to_exit_code(lambda: interruptible(call_command)(options))
        if as_json:
            typer.echo(output.to_json(name, code))
        raise typer.Exit(code)

    # Help texts are wrapped to the width of the terminal, so remove line breaks of docstrings.
    paragraphs = (inspect.getdoc(command) or "").split("\n\n")
    run_and_exit.__doc__ = "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
    outputs = [
        inspect.Parameter(
            option, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation
        )
        for option, annotation in _OUTPUT_OPTIONS.items()
        if option != "verbose" or name in _COMMANDS_WITH_DETAILS
    ]
    parameters = [
        x.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for x in (*of_job[:1], *own, *of_job[1:], *outputs)
    ]
    run_and_exit.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run_and_exit.__annotations__ = {x.name: x.annotation for x in parameters}
    return run_and_exit


def _run_to_exit_code(command: Callable[[], None]) -> int:
    try:
        command()
    except KeyboardInterrupt as problem:
        return _report_interrupt(problem.reason if isinstance(problem, Interrupted) else "")
    except typer.Exit as problem:
        return problem.exit_code
    except Exception as problem:
        if process.is_interrupted():
            # Other code converted the interrupt to a different exception.
            return _report_interrupt("")
        if is_out_of_memory(problem):
            problem = BeamdaeError(_OUT_OF_MEMORY)
        elif isinstance(problem, FileNotFoundError) and deferred.module(
            "results.storage.files"
        ).is_in_deleted_folder(Path()):
            problem = BeamdaeError(_DELETED_FOLDER)
        if not isinstance(problem, BeamdaeError):
            raise
        print_error(f"error: {problem}")
        return USAGE_ERROR
    except BaseException as problem:  # raised by a part or a law of a model
        print_error(f"error: the model ended the run with {type(problem).__name__}({problem}).")
        return USAGE_ERROR
    return 0


def _report_interrupt(reason: str) -> int:
    print_error(reason or "interrupted")
    return process.exit_code()


@contextmanager
def _escape_brackets(parameters: Iterable[Any]) -> Iterator[None]:
    """Escape units such as [mm] in help texts, which boxes would omit as the name of a style."""
    from rich.markup import escape

    texts = [(x, x.help) for x in parameters if getattr(x, "help", None)]
    for parameter, text in texts:
        parameter.help = escape(text)
    try:
        yield
    finally:
        for parameter, text in texts:
            parameter.help = text


class _Plain:
    """Help without boxes in narrow terminals and without "boolean" after flags."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        columns = shutil.get_terminal_size().columns
        if columns >= _MIN_BOX_WIDTH:
            with _escape_brackets(vars(self)["params"]):
                super().format_help(ctx, formatter)  # type: ignore[misc]
            return
        markup_mode = vars(self).get("rich_markup_mode")
        formatter.width = min(formatter.width, columns - 2)
        vars(self)["rich_markup_mode"] = None
        super().format_help(ctx, formatter)  # type: ignore[misc]
        vars(self)["rich_markup_mode"] = markup_mode

    def get_params(self, ctx: Any) -> Any:
        parameters = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            if getattr(parameter, "is_flag", False):
                parameter.metavar = ""
        return parameters


class Command(_Plain, TyperCommand):
    """Command with plain help in narrow terminals, whose messages name its options."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with use_options(self.params):
            return super().invoke(ctx)


class Commands(_Plain, TyperGroup):
    """Group of all commands, which reports usage errors in one line."""

    def make_context(self, info_name: Any, args: list[str], *rest: Any, **more: Any) -> Any:
        """Return the context of a command line; its `obj` is True if --json is given."""
        as_json = "--json" in args
        with _report_usage_errors(as_json):
            context = super().make_context(info_name, args, *rest, **more)
        context.obj = as_json
        return context

    def invoke(self, ctx: Any) -> Any:
        """Parse the options of the command and run it."""
        with _report_usage_errors(ctx.obj):
            return super().invoke(ctx)


@contextmanager
def _report_usage_errors(as_json: bool) -> Iterator[None]:
    try:
        yield
    except _UsageError as problem:
        if type(problem).__name__ == "NoArgsIsHelpError":
            raise
        output = CommandOutput(as_json=as_json)
        with use_output(output):
            print_error(_format_usage_error(problem))
        if as_json:
            typer.echo(output.to_json(problem.ctx.info_name if problem.ctx else "", USAGE_ERROR))
        raise typer.Exit(USAGE_ERROR) from None


def _format_usage_error(problem: Any) -> str:
    """Format a usage error with the command and, if the parser provides it, the value."""
    command = problem.ctx.command_path if problem.ctx else "beamdae"
    option = getattr(problem, "option_name", "")
    if problem.ctx and option:
        names = [name for parameter in problem.ctx.command.params for name in parameter.opts]
        if begun := [name for name in names if name.startswith(option)]:
            problem.possibilities = begun
    message = problem.format_message().rstrip(".")
    details: Any = getattr(problem.__cause__, "errors", list)()
    value = f", got {short_repr(details[0]['input'])}" if details else ""
    message = f"{message[:1].lower()}{message[1:]}".replace(". Did", ", did")
    return f"error: {command}: {message}{value}; see {command} --help."


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
        group = _GROUP_OF_COMMAND[name]
        module = import_module(f"beamdae.cli.commands.{_GROUPS[group][name]}")
        command = wrap_command(name, getattr(module, f"{name}_command"))
        app.command(name, cls=Command, rich_help_panel=group)(command)
    return app


def __getattr__(name: str) -> Any:
    if name == "app":
        return create_app()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def main() -> int:
    """Run the command line and return its exit code, even after signals and stream errors."""
    code = 0
    try:
        process.secure_streams()
        _configure_warnings()
        # Importing all commands takes longer than the start of a command.
        names = (name for name in sys.argv[1:2] if name in _GROUP_OF_COMMAND)
        create_app(*names)(prog_name="beamdae")
    except SystemExit as problem:
        code = problem.code if isinstance(problem.code, int) else int(problem.code is not None)
    except KeyboardInterrupt:
        code = process.exit_code()
    process.ignore_signals()
    if process.is_interrupted():
        code = process.exit_code()
    return process.flush_output(code)


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
