"""Errors about arguments that public classes and functions do not have, or lack."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from functools import wraps
from typing import Any

from beamdae.errors import ArgumentError, join_names, short_repr, suggest


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
        except TypeError:
            problem = _describe_misuse(inspect.signature(function), bound, arguments, settings)
            if not problem:
                raise
            raise ArgumentError(f"{part}: {problem}.") from None

    return call


def _describe_misuse(
    signature: inspect.Signature, bound: int, arguments: tuple[Any, ...], settings: dict[str, Any]
) -> str:
    """Return why arguments do not fit a function, "" if they do; the first `bound` are bound."""
    parameters = list(signature.parameters.values())[bound:]
    public = [x.name for x in parameters if not x.name.startswith("_")]
    allowed = f"the arguments are {join_names(public)}" if public else "it has none"
    unknown = next((x for x in settings if x not in signature.parameters), None)
    if unknown is not None and not any(x.kind is x.VAR_KEYWORD for x in parameters):
        hint = _suggest_model_call(arguments[bound:], settings, unknown)
        return f"there is no argument {unknown!r}{hint or f'{suggest(unknown, public)}; {allowed}'}"
    try:
        signature.bind(*arguments, **settings)
    except TypeError as problem:
        return f"{problem}; {allowed}"
    return ""


def _suggest_model_call(arguments: tuple[Any, ...], settings: dict[str, Any], unknown: str) -> str:
    """Return the end of a message if an argument contains parameters of a model function."""
    model: Any = settings.get("model", arguments[0] if arguments else None)
    known = getattr(model, "parameter_info", {})
    values = settings[unknown] if unknown == "parameters" else {unknown: settings[unknown]}
    if not (known and isinstance(values, dict) and set(values) <= set(known)):
        return ""
    texts = (f"{name}={short_repr(value)}" for name, value in values.items())
    return f"; pass parameters to the model function, as in {model.name}({', '.join(texts)})"
