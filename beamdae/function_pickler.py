"""Pickler of functions that cannot be imported, such as models, laws and outputs of users."""

from __future__ import annotations

import io
from collections import ChainMap
from collections.abc import Callable
from types import CodeType
from typing import Any, ClassVar

import cloudpickle


def _reduce_code(code: CodeType) -> tuple[Callable[..., CodeType], tuple[Any, ...]]:
    return _restore_code, (code.co_filename, *cloudpickle.Pickler.dispatch_table[CodeType](code))


def _restore_code(file: str, create: Callable[..., CodeType], values: tuple[Any, ...]) -> CodeType:
    return create(*values).replace(co_filename=file)


class FunctionPickler(cloudpickle.Pickler):
    """Pickler of cloudpickle that keeps the file names of functions, as cloudpickle < 3.1.3 did.

    The files of a model are sought in the folder of its function, and messages state its lines.
    """

    dispatch_table: ClassVar = ChainMap(
        {CodeType: _reduce_code}, cloudpickle.Pickler.dispatch_table
    )


def pickle_with_functions(value: Any) -> bytes:
    """Pickle a value, including code that cannot be imported; `pickle.loads` restores it."""
    stream = io.BytesIO()
    FunctionPickler(stream).dump(value)
    return stream.getvalue()
