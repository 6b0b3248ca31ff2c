"""Messages for exceptions of a model file, with the line and suggestions for mistyped names."""

from __future__ import annotations

import builtins
import inspect
import re
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from types import FrameType

import beamdae
from beamdae.errors import format_message, short_repr, suggest

_UNEXPECTED_ARGUMENT = re.compile(r"([\w.]+)\(\) got an unexpected keyword argument '(\w+)'")
_MISSING_NAME = re.compile(r"cannot import name '(\w+)'")
# Python 3.13 and later suggest arguments themselves.
_SUGGESTION = re.compile(r"\. Did you mean '\w+'\?$")


def describe_error(problem: BaseException, path: Path) -> str:
    """Describe an exception in one line: type, line number in `path`, message and suggestion."""
    file_names = (path, path.absolute())
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(problem.__traceback__)
        if Path(frame.filename) in file_names
    ]
    message = format_message(problem).replace(".__init__()", "()")
    suggestion = _suggest_name(problem)
    if suggestion:
        message = _SUGGESTION.sub("", message)
    if isinstance(problem, SystemExit):
        code = "" if problem.code is None else short_repr(problem.code)
        message = f"sys.exit({code}) was called"
    if isinstance(problem, SyntaxError):
        # str() repeats the line number, and the error may be in an imported file.
        is_elsewhere = problem.filename is not None and Path(problem.filename) not in file_names
        place = f" of {problem.filename}" if is_elsewhere else ""
        lines, message = [problem.lineno or 1], f"{problem.msg}{place}"
    line = f" at line {lines[-1]}" if lines else ""
    text = f": {message}" if message else ""
    return f"{type(problem).__name__}{line}{text}{suggestion}"


def _suggest_name(problem: BaseException) -> str:
    """Return a suggestion for the name that an exception reports as missing, or ""."""
    missing, names = getattr(problem, "name", None) or "", []
    frames = [frame for frame, _ in traceback.walk_tb(problem.__traceback__)]
    unexpected = _UNEXPECTED_ARGUMENT.match(str(problem))
    if isinstance(problem, AttributeError):
        with suppress(Exception):  # of the object
            names = dir(problem.obj)
    elif isinstance(problem, NameError):
        names = [*frames[-1].f_globals, *frames[-1].f_locals, *dir(builtins)]
    elif isinstance(problem, ModuleNotFoundError):
        names = [name.partition(".")[0] for name in sys.modules]
    elif isinstance(problem, ImportError) and (match := _MISSING_NAME.match(str(problem))):
        missing, names = match[1], dir(sys.modules.get(missing))
    elif isinstance(problem, TypeError) and unexpected:
        missing, names = unexpected[2], _argument_names(unexpected[1], frames[-1])
    is_private = missing.startswith("_")
    return suggest(missing, [x for x in names if is_private or not x.startswith("_")])


def _argument_names(qualified_name: str, frame: FrameType) -> list[str]:
    """Return the argument names of the function `qualified_name`, or [] if it is unknown."""
    first, *others = qualified_name.removesuffix(".__init__").split(".")
    function = frame.f_globals.get(first) or getattr(beamdae, first, None)
    for name in others:
        function = getattr(function, name, None)
    try:
        return list(inspect.signature(function).parameters) if callable(function) else []
    except ValueError:
        return []
