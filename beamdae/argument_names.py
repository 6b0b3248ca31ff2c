"""Errors about unknown keyword arguments of public classes that list the arguments."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any

from beamdae.errors import UnknownArgumentError, join_names, suggest


def explain_unknown_arguments(cls: type) -> None:
    """Let the constructor and the public class methods of a class list their arguments.

    They raise `UnknownArgumentError` if a keyword is none of these.
    """
    constructor = cls.__init__  # type: ignore[misc]
    if inspect.isfunction(constructor):
        cls.__init__ = _explain(cls.__name__, constructor)  # type: ignore[misc]
    for name, method in list(vars(cls).items()):
        if isinstance(method, classmethod) and not name.startswith("_"):
            function = _explain(f"{cls.__name__}.{name}", method.__func__)
            setattr(cls, name, classmethod(function))


def _explain(part: str, function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def call(*arguments: Any, **settings: Any) -> Any:
        try:
            return function(*arguments, **settings)
        except TypeError:
            parameters = list(inspect.signature(function).parameters.values())[1:]
            names = [x.name for x in parameters]
            unknown = next((x for x in settings if x not in names), None)
            if unknown is None or any(x.kind is x.VAR_KEYWORD for x in parameters):
                raise
            public = [x for x in names if not x.startswith("_")]
            allowed = f"the arguments are {join_names(public)}" if public else "it has none"
            raise UnknownArgumentError(
                f"{part}: there is no argument {unknown!r}{suggest(unknown, public)}; {allowed}."
            ) from None

    return call
