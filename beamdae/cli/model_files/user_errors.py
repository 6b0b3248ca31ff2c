"""Messages for exceptions of a model file, with the line and suggestions for mistyped names."""

from __future__ import annotations

import builtins
import re
import traceback
from contextlib import suppress
from pathlib import Path

from beamdae.errors import format_message, short_repr, suggest

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
    if isinstance(problem, AttributeError):
        with suppress(Exception):  # of the object
            names = dir(problem.obj)
    elif isinstance(problem, NameError):
        *_, (frame, _) = traceback.walk_tb(problem.__traceback__)
        names = [*frame.f_globals, *frame.f_locals, *dir(builtins)]
    is_private = missing.startswith("_")
    return suggest(missing, [x for x in names if is_private or not x.startswith("_")])
