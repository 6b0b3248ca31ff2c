"""Errors about unknown keyword arguments of public classes and functions."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from functools import wraps
from typing import Any

from beamdae.errors import UnknownArgumentError, join_names, short_repr, suggest


def explain_unknown_arguments(value: Any) -> Any:
    """Return a class or function whose calls list their arguments.

    The constructor and the public class methods of a class, or the function, raise
    `UnknownArgumentError` if a keyword is none of these. A function is also replaced in its module,
    so that it can be pickled.
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
            parameters = list(inspect.signature(function).parameters.values())[bound:]
            names = [x.name for x in parameters]
            unknown = next((x for x in settings if x not in names), None)
            if unknown is None or any(x.kind is x.VAR_KEYWORD for x in parameters):
                raise
            hint = _suggest_model_call(arguments, settings, unknown)
            if not hint:
                public = [x for x in names if not x.startswith("_")]
                allowed = f"the arguments are {join_names(public)}" if public else "it has none"
                hint = f"{suggest(unknown, public)}; {allowed}"
            raise UnknownArgumentError(f"{part}: there is no argument {unknown!r}{hint}.") from None

    return call


def _suggest_model_call(arguments: tuple[Any, ...], settings: dict[str, Any], unknown: str) -> str:
    """Return the end of a message if an argument contains parameters of a model function."""
    model: Any = settings.get("model", arguments[0] if arguments else None)
    known = getattr(model, "parameter_info", {})
    values = settings[unknown] if unknown == "parameters" else {unknown: settings[unknown]}
    if not (known and isinstance(values, dict) and set(values) <= set(known)):
        return ""
    texts = (f"{name}={short_repr(value)}" for name, value in values.items())
    return f"; pass parameters to the model function, as in {model.name}({', '.join(texts)})"
