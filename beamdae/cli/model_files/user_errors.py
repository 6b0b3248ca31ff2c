"""Exceptions of a user's file in words: their place in it, and the nearest name there is."""

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

_UNEXPECTED = re.compile(r"([\w.]+)\(\) got an unexpected keyword argument '(\w+)'")
# From Python 3.13 on arguments are suggested as well.
_SUGGESTED = re.compile(r"\. Did you mean '\w+'\?$")


def describe_error(problem: BaseException, path: Path) -> str:
    """Type, line of the file at `path`, message and hint of an exception, on one line."""
    own = (path, path.absolute())
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(problem.__traceback__)
        if Path(frame.filename) in own
    ]
    message, hint = format_message(problem).replace(".__init__()", "()"), _hint(problem)
    if hint:
        message = _SUGGESTED.sub("", message)
    if isinstance(problem, SystemExit):
        code = "" if problem.code is None else short_repr(problem.code)
        message = f"it called sys.exit({code})"
    if isinstance(problem, SyntaxError):
        # Its own message repeats the place, and the place may be another file.
        elsewhere = problem.filename is not None and Path(problem.filename) not in own
        where = f" of {problem.filename}" if elsewhere else ""
        lines, message = [problem.lineno or 1], f"{problem.msg}{where}"
    line = f" at line {lines[-1]}" if lines else ""
    words = f": {message}" if message else ""
    return f"{type(problem).__name__}{line}{words}{hint}"


def _hint(problem: BaseException) -> str:
    """A hint at the nearest name to the one that was not found, or nothing."""
    wanted, known = _missing_name(problem)
    hidden = wanted.startswith("_")
    return suggest(wanted, [n for n in known if hidden or not n.startswith("_")]) if wanted else ""


def _missing_name(problem: BaseException) -> tuple[str, Iterable[str]]:
    """The name an exception is about, and the names there are."""
    if isinstance(problem, AttributeError) and problem.name:
        return problem.name, _names_of(problem.obj)
    if isinstance(problem, NameError) and problem.name:
        frame = _last_frame(problem)
        seen = {**frame.f_globals, **frame.f_locals} if frame else {}
        return problem.name, [*seen, *dir(builtins)]
    if isinstance(problem, ModuleNotFoundError) and problem.name:
        return problem.name, {name.partition(".")[0] for name in sys.modules}
    if isinstance(problem, ImportError) and problem.name:
        wanted = re.match(r"cannot import name '(\w+)'", str(problem))
        return (wanted[1] if wanted else ""), _names_of(sys.modules.get(problem.name))
    unexpected = _UNEXPECTED.match(str(problem)) if isinstance(problem, TypeError) else None
    if unexpected:
        return unexpected[2], _arguments(unexpected[1], _last_frame(problem))
    return "", ()


def _names_of(value: Any) -> list[str]:
    try:
        return dir(value)
    except Exception:
        return []


def _last_frame(problem: BaseException) -> FrameType | None:
    frames = [frame for frame, _ in traceback.walk_tb(problem.__traceback__)]
    return frames[-1] if frames else None


def _arguments(called: str, frame: FrameType | None) -> list[str]:
    """Names of the arguments of a function, found by its qualified name."""
    first, *others = called.removesuffix(".__init__").split(".")
    found = (frame.f_globals if frame else {}).get(first) or getattr(beamdae, first, None)
    for name in others:
        found = getattr(found, name, None)
    try:
        return list(inspect.signature(found).parameters) if callable(found) else []
    except ValueError:
        return []
