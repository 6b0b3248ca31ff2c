"""Values of command-line options, converted without pydantic where no check is needed.

Typer converts all values by pydantic, also those of omitted options. Its import and its adapters
take as long as a short run.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Settings of an option of Typer that restrict or change plain values, which parsers leave alone.
_RULES = ("min", "max", "click_type", "exists", "resolve_path", "formats")


def convert_plain_values(parameter: Any) -> None:
    """Make a parameter of Typer convert plain values by `PlainConversion`.

    Versions of Typer without `get_runtime_param` do not use pydantic and are left alone. Values of
    parameters with rules of their own, such as `min`, are not plain.
    """
    create = getattr(parameter, "get_runtime_param", None)
    if create is not None and not isinstance(create, PlainConversion):
        descriptor = parameter.type_descriptor
        rules = vars(descriptor.parameter_info)
        has_rules = any(rules.get(name) not in (None, False) for name in _RULES)
        annotation = None if has_rules else descriptor.annotation
        parameter.get_runtime_param = PlainConversion(annotation, create)


@dataclass(frozen=True)
class PlainConversion:
    """Conversion of plain values; Typer converts all others.

    Plain values are omitted options, and valid strings for those of type str, Path, int and float.

    Attributes
    ----------
    annotation
        Type of the option; None if no value but an omitted one is plain.
    create_conversion
        Function that returns Typer's conversion.
    """

    annotation: Any
    create_conversion: Callable[[], Any]

    def __call__(self) -> PlainConversion:
        """Return this conversion, as the method of Typer that it replaces."""
        return self

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return the value of an option, converted to its type."""
        if value is None:
            return () if param.multiple or param.nargs == -1 else None
        try:
            return _convert_plain(self.annotation, value)
        except ValueError:
            return self.create_conversion().coerce(value, param=param, ctx=ctx)


def _convert_plain(annotation: Any, value: Any) -> Any:
    """Return a value as an instance of `annotation`.

    Raises
    ------
    ValueError
        If the value or the annotation is not plain.
    """
    if annotation == list[str] and isinstance(value, (list, tuple)):
        return [_convert_plain(str, item) for item in value]
    if annotation not in (str, Path, int, float) or not isinstance(value, (str, annotation)):
        raise ValueError
    # Typer rejects files and folders without permission to read.
    if annotation is Path and os.path.exists(value) and not os.access(value, os.R_OK):
        raise ValueError
    return annotation(value)
