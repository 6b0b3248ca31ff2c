"""Errors about arguments that public classes and functions do not have, or lack."""

from __future__ import annotations

import inspect
import os
import sys
import sysconfig
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from types import TracebackType
from typing import Any

from beamdae.errors import ArgumentError, BeamdaeError, join_names, short_repr, suggest


def explain_arguments(value: Any) -> Any:
    """Return a class or function whose calls list their arguments.

    The constructor and the public class methods of a class, or the function, raise
    `ArgumentError` if a keyword is none of these, an argument is missing or there are too many. A
    function is also replaced in its module, so that it can be pickled.
    """
    if inspect.isfunction(value):
        explained = _explain(value.__name__, value, 0)
        setattr(sys.modules[value.__module__], value.__name__, explained)
        return explained
    if isinstance(value, type):
        constructor = value.__init__  # type: ignore[misc]
        if inspect.isfunction(constructor):
            value.__init__ = _explain(value.__name__, constructor, 1)  # type: ignore[misc]
        for name, method in list(vars(value).items()):
            if isinstance(method, classmethod) and not name.startswith("_"):
                function = _explain(f"{value.__name__}.{name}", method.__func__, 1)
                setattr(value, name, classmethod(function))
    return value


def _explain(part: str, function: Callable[..., Any], bound: int) -> Callable[..., Any]:
    """Return a function that lists its arguments but the first `bound` ones."""

    @wraps(function)
    def call(*arguments: Any, **settings: Any) -> Any:
        try:
            return function(*arguments, **settings)
        except Exception as problem:
            if isinstance(problem, TypeError):
                signature = inspect.signature(function)
                if misuse := _describe_misuse(signature, bound, arguments, settings):
                    raise ArgumentError(f"{part}: {misuse}.") from None
            problem.__traceback__ = _select_frames(problem)
            raise

    return call


def _select_frames(problem: Exception) -> TracebackType | None:
    """Return the traceback of an error without frames of this package, which users cannot mend.

    Unexpected errors inside the package keep theirs.
    """
    paths, package = sysconfig.get_paths(), str(Path(__file__).parent) + os.sep
    libraries = tuple(paths[x] for x in ("stdlib", "purelib", "platlib"))
    entries, entry = list[tuple[bool, TracebackType]](), problem.__traceback__
    while entry is not None:
        code = entry.tb_frame.f_code
        is_own = code.co_filename.startswith(package)
        # Constructors of dataclasses have no file.
        is_library = code.co_filename.startswith(libraries) or code.co_qualname.startswith(
            "__create_fn__"
        )
        if is_own or not is_library:
            entries.append((is_own, entry))
        entry = entry.tb_next
    if not isinstance(problem, BeamdaeError) and entries[-1][0]:
        return problem.__traceback__
    selected: TracebackType | None = None
    for is_own, x in reversed(entries):
        if not is_own:
            selected = TracebackType(selected, x.tb_frame, x.tb_lasti, x.tb_lineno)
    return selected


def _describe_misuse(
    signature: inspect.Signature, bound: int, arguments: tuple[Any, ...], settings: dict[str, Any]
) -> str:
    """Return why arguments do not fit a function, "" if they do; the first `bound` are bound."""
    parameters = list(signature.parameters.values())[bound:]
    public = [x.name for x in parameters if not x.name.startswith("_")]
    allowed = f"the arguments are {join_names(public)}" if public else "it has none"
    unknown = next((x for x in settings if x not in signature.parameters), None)
    if unknown is not None and not any(x.kind is x.VAR_KEYWORD for x in parameters):
        hint = _suggest_parameters(arguments[bound:], settings, unknown, "parameters" in public)
        return f"there is no argument {unknown!r}{hint or f'{suggest(unknown, public)}; {allowed}'}"
    try:
        signature.bind(*arguments, **settings)
    except TypeError as problem:
        return f"{problem}; {allowed}"
    return ""


def _suggest_parameters(
    arguments: tuple[Any, ...], settings: dict[str, Any], unknown: str, has_parameters: bool
) -> str:
    """Return the end of a message if an argument contains parameters of a model function.

    Functions without an argument `parameters` accept the mechanism that the model returns.
    """
    model: Any = settings.get("model", arguments[0] if arguments else None)
    known = getattr(model, "parameter_info", {})
    values = settings[unknown] if unknown == "parameters" else {unknown: settings[unknown]}
    if not (known and isinstance(values, dict) and set(values) <= set(known)):
        return ""
    if has_parameters:
        return f"; pass parameters={short_repr(values)}"
    texts = (f"{name}={short_repr(value)}" for name, value in values.items())
    return f"; pass parameters to the model function, as in {model.name}({', '.join(texts)})"
