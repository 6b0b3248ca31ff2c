"""Output of commands: standard output, messages, JSON documents, and checks of output paths."""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

import typer

from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    InputWarning,
    KernelWarning,
    kind_of_message,
    short_repr,
)
from beamdae.input_files import CHECKPOINT, require_output
from beamdae.report.option_names import name_options
from beamdae.report.text import format_json, make_printable

if TYPE_CHECKING:
    from rich.console import Console


# Widths in columns. Without a terminal, lines are not wrapped; tables need the minimum width.
_UNLIMITED_WIDTH = 10_000
_MIN_WIDTH = 20


@dataclass(frozen=True)
class CommandOutput:
    """Output settings of a command, and the contents of its JSON document.

    Attributes
    ----------
    quiet
        True to print only errors and, if `as_json` is True, the JSON document.
    as_json
        True to print the results as one JSON document instead of tables.
    verbose
        True to print settings, cost and checks of the solver, too.
    results, files, warnings, errors
        Contents of the JSON document, besides the command and its exit code.
    held_warnings
        Warnings of beamdae that have been issued but not printed.
    """

    quiet: bool = False
    as_json: bool = False
    verbose: bool = False
    results: dict[str, Any] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    held_warnings: list[str] = field(default_factory=list)

    def to_json(self, command: str, exit_code: int) -> str:
        """Return the JSON document of a command."""
        document = {"command": command, "exit_code": exit_code, **self.results}
        document |= {"files": self.files, "warnings": self.warnings, "errors": self.errors}
        return format_json(document, _to_plain, indent=2)


_current_output: ContextVar[CommandOutput | None] = ContextVar("current_output", default=None)


@contextmanager
def use_output(output: CommandOutput) -> Iterator[None]:
    """Use these output settings within a `with` block."""
    token = _current_output.set(output)
    try:
        yield
    finally:
        _current_output.reset(token)


def current_output() -> CommandOutput:
    """Return the output settings of the running command; the defaults if no command is running."""
    return _current_output.get() or CommandOutput()


def is_quiet() -> bool:
    """Return True if the running command has the option --quiet."""
    return current_output().quiet


def record_results(create: Callable[[], Mapping[str, Any]]) -> None:
    """Add the results that `create` returns to the JSON document, if there is one."""
    output = current_output()
    if output.as_json:
        results = dict(create())
        if isinstance(reason := results.get("reason"), str):
            results["reason"] = name_options(reason)
        output.results.update(results)


def create_console(stderr: bool = False) -> Console:
    """Return a console on standard output or, with `stderr`, on standard error.

    With --quiet or --json, a console on standard output prints nothing. Lines are as wide as the
    terminal or COLUMNS; without these, lines are not wrapped. Markup is disabled, because units are
    written in brackets.
    """
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    has_width = stream.isatty() or os.environ.get("COLUMNS", "").isdigit()
    output = current_output()
    console = Console(
        stderr=stderr,
        width=None if has_width else _UNLIMITED_WIDTH,
        markup=False,
        highlight=False,
        emoji=False,
        quiet=not stderr and (output.quiet or output.as_json),
    )
    console.width = max(console.width, _MIN_WIDTH)
    return console


def show(console: Console, content: Any, style: str | None = None) -> None:
    """Print content; in files and pipes, lines have no trailing spaces."""
    if console.is_terminal or console.quiet:
        console.print(content, style=style)
        return
    with console.capture() as captured:
        console.print(content, style=style)
    text = re.sub(" +$", "", captured.get(), flags=re.MULTILINE)
    typer.echo(text, nl=False, err=console.stderr)


def create_progress_console() -> Console | None:
    """Return a console on standard error, or None if no progress bar can be displayed there."""
    if not sys.stderr.isatty():
        return None
    console = create_console(stderr=True)
    return console if console.is_terminal and not console.is_dumb_terminal else None


def print_error(sentence: str) -> None:
    """Print a sentence on standard error, and add it to the JSON document."""
    line = make_printable(name_options(" ".join(sentence.split())))
    current_output().errors.append(line)
    show(create_console(stderr=True), line)


def print_warnings(console: Console, sentences: Iterable[str]) -> None:
    """Print warnings about a result, and add them to the JSON document, unless both was done."""
    for sentence in sentences:
        printable = make_printable(name_options(sentence))
        if not any(printable in x for x in current_output().warnings):
            _print_warning(console, sentence)


def _print_warning(console: Console, sentence: str) -> None:
    show(console, f"warning: {record_warning(sentence)}", "yellow")


@contextmanager
def hold_warnings(output: CommandOutput, at_once: bool) -> Iterator[None]:
    """Print the warnings that beamdae issues in a `with` block after it, even if it raises.

    Those about arguments, data and compilers are printed at once, because analyses may take hours;
    with `at_once`, all are. Warnings that were printed with a result or as the reason of a failure
    are not repeated, and of those that differ only in numbers, only the first is printed.
    """
    with warnings.catch_warnings():
        show = warnings.showwarning

        def hold(message: Any, category: type[Warning], *place: Any, **more: Any) -> None:
            sentence = name_options(str(message))
            if not issubclass(category, (BeamdaeWarning, KernelWarning)):
                show(message, category, *place, **more)
            elif not (at_once or issubclass(category, (InputWarning, KernelWarning))):
                output.held_warnings.append(sentence)
            elif not _is_printed(sentence, output):
                _print_warning(create_console(stderr=True), sentence)

        warnings.simplefilter("always", BeamdaeWarning)
        warnings.showwarning = hold
        try:
            yield
        finally:
            by_kind = {kind_of_message(x): x for x in reversed(output.held_warnings)}
            sentences = [x for x in reversed(by_kind.values()) if not _is_printed(x, output)]
            for sentence in sentences:
                _print_warning(create_console(stderr=True), sentence)


def withdraw_warnings(text: str) -> None:
    """Forget the warnings that contain this text, because a better result replaces theirs."""
    held, withdrawn = current_output().held_warnings, name_options(text)
    held[:] = [x for x in held if withdrawn not in x]


def _is_printed(sentence: str, output: CommandOutput) -> bool:
    """Return True if a result or an error contains this warning, perhaps with another prefix.

    Numbers are ignored.
    """

    def kind(text: str) -> str:
        return kind_of_message(f": {make_printable(text)}")

    body = kind((sentence.partition(": ")[2] or sentence).rstrip("."))[2:]
    if any(body in kind(line) for line in [*output.warnings, *output.errors]):
        return True
    reasons = [kind(x.removeprefix("failed: ").partition("; ")[0])[2:] for x in output.errors]
    return any(reason and reason in kind(sentence) for reason in reasons)


def record_warning(sentence: str) -> str:
    """Add a warning to the JSON document, and return it with unprintable characters escaped."""
    printable = make_printable(name_options(sentence))
    current_output().warnings.append(printable)
    return printable


def _to_plain(value: Any) -> Any:
    """Return arrays and sets as lists, tables as lists of rows, and other objects as strings."""
    if hasattr(value, "to_dict"):
        return value.to_dict("records")
    if hasattr(value, "tolist"):  # NumPy scalars and arrays
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    return list(value) if isinstance(value, (set, frozenset)) else str(value)


def require_writable(*groups: tuple[str, Iterable[Path]]) -> None:
    """Raise an error if an output file cannot be written, or would replace another output.

    Folders are created and a temporary file is written for this purpose; both are removed again.

    Parameters
    ----------
    *groups
        Pairs of an option, named in messages, and the paths of the files that the option sets.

    Raises
    ------
    BeamdaeError
        If a path is not a valid name or is a folder, a folder cannot be created or written, or an
        output is an input, or has the path of another output or of its folder.
    """
    options: dict[Path, str] = {}
    for option, paths in groups:
        for path in paths:
            _require_file_path(option, path)
            require_output(path, option, CHECKPOINT if option == "--checkpoint" else "")
            place = Path(os.path.realpath(path.parent), path.name)
            if place in options:
                raise BeamdaeError(
                    f"{option} {path}: {options[place]} writes the same file; choose another file."
                )
            options[place] = option
    for place, option in options.items():
        if any(place in other.parents for other in options):
            raise BeamdaeError(
                f"{option} {place}: the path is the folder of other results; choose another file."
            )
    for option, paths in groups:
        for folder in dict.fromkeys(path.parent for path in paths):
            _require_folder(option, folder)


def _require_file_path(option: str, path: Path) -> None:
    if not str(path).isprintable() or not path.name:
        raise BeamdaeError(
            f"{option}: {short_repr(str(path))} is not a valid file name; give a name "
            "of printable characters."
        )
    try:
        is_folder = path.is_dir()
        # Names that are too long are reported here.
        with suppress(FileNotFoundError, NotADirectoryError):
            path.lstat()
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise BeamdaeError(
            f"{option} {path}: the file cannot be written: {reason}; choose another name."
        ) from None
    if is_folder:
        raise BeamdaeError(
            f"{option} {path.parent}: the files cannot be written because {path} is a folder; "
            "remove this folder or choose another."
        )


def _require_folder(option: str, folder: Path) -> None:
    """Raise an error unless files can be created in the folder, which need not exist yet."""
    # Imported here because the help is printed without NumPy.
    from beamdae.results.storage.files import is_in_deleted_folder

    created: list[Path] = []
    try:
        # Fails if the working folder has been deleted.
        missing = [x for x in (folder.absolute(), *folder.absolute().parents) if not x.exists()]
        for each in reversed(missing):
            each.mkdir()
            created.append(each)
        # The system folder of devices accepts no files, but its devices are valid outputs.
        if folder.absolute() != Path("/dev"):
            TemporaryFile(dir=folder).close()
    except OSError as problem:
        reason = f"of the error '{problem.strerror or problem}'"
        if is_in_deleted_folder(folder):
            reason = "the working folder has been deleted"
        raise BeamdaeError(
            f"{option} {folder}: the folder cannot be written because {reason}; "
            "choose another folder."
        ) from None
    finally:
        for each in reversed(created):
            with suppress(OSError):
                each.rmdir()
