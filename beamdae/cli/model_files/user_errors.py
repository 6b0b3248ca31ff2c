"""Messages for exceptions of a model file, with the line and suggestions for mistyped names."""

from __future__ import annotations

import builtins
import inspect
import re
import sys
import traceback
from collections.abc import Iterable
from pathlib import Path
from types import FrameType
from typing import Any

import beamdae
from beamdae.errors import format_message, short_repr, suggest

_UNEXPECTED_ARGUMENT = re.compile(r"([\w.]+)\(\) got an unexpected keyword argument '(\w+)'")
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
    missing, names = _missing_name(problem)
    if not missing:
        return ""
    is_private = missing.startswith("_")
    return suggest(missing, [name for name in names if is_private or not name.startswith("_")])


def _missing_name(problem: BaseException) -> tuple[str, Iterable[str]]:
    """Return the name that an exception reports as missing, and the names that exist."""
    if isinstance(problem, AttributeError) and problem.name:
        return problem.name, _attribute_names(problem.obj)
    if isinstance(problem, NameError) and problem.name:
        frame = _last_frame(problem)
        visible = {**frame.f_globals, **frame.f_locals} if frame else {}
        return problem.name, [*visible, *dir(builtins)]
    if isinstance(problem, ModuleNotFoundError) and problem.name:
        return problem.name, {name.partition(".")[0] for name in sys.modules}
    if isinstance(problem, ImportError) and problem.name:
        match = re.match(r"cannot import name '(\w+)'", str(problem))
        return (match[1] if match else ""), _attribute_names(sys.modules.get(problem.name))
    unexpected = (
        _UNEXPECTED_ARGUMENT.match(str(problem)) if isinstance(problem, TypeError) else None
    )
    if unexpected:
        return unexpected[2], _argument_names(unexpected[1], _last_frame(problem))
    return "", ()


def _attribute_names(value: Any) -> list[str]:
    try:
        return dir(value)
    except Exception:
        return []


def _last_frame(problem: BaseException) -> FrameType | None:
    frames = [frame for frame, _ in traceback.walk_tb(problem.__traceback__)]
    return frames[-1] if frames else None


def _argument_names(qualified_name: str, frame: FrameType | None) -> list[str]:
    """Return the argument names of the function `qualified_name`, or [] if it is unknown."""
    first, *others = qualified_name.removesuffix(".__init__").split(".")
    function = (frame.f_globals if frame else {}).get(first) or getattr(beamdae, first, None)
    for name in others:
        function = getattr(function, name, None)
    try:
        return list(inspect.signature(function).parameters) if callable(function) else []
    except ValueError:
        return []
