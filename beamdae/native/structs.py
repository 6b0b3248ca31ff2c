"""Numba types of the objects that loops work on: pointers to tables of 64-bit words.

A word holds an integer, a floating point number or an address. An array takes one word for its
address and one for each dimension; nested objects are stored inline. Importing this module imports
numba.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    lower_setattr_generic,
    register_model,
)
from numba.np.arrayobj import make_array, populate_array

_integer = ir.IntType(64)
# Hexadecimal digits that distinguish layouts of one class.
_NAME_DIGITS = 8


class Struct(types.Type):
    """Numba type of a table that holds one object; `fields` maps names to (first word, type)."""

    def __init__(self, name: str, fields: dict[str, tuple[int, types.Type]]) -> None:
        self.fields = fields
        layout = ", ".join(f"{field} {first} {kind}" for field, (first, kind) in fields.items())
        # A short name: it is repeated in the names of all compiled functions.
        digest = hashlib.sha256(layout.encode()).hexdigest()
        super().__init__(f"{name}{digest[:_NAME_DIGITS]}")


@register_model(Struct)
class _StructModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Struct) -> None:
        super().__init__(manager, kind, _integer.as_pointer())


@infer_getattr
class _StructAttributes(AttributeTemplate):
    key = Struct

    def generic_resolve(self, struct: Struct, name: str) -> types.Type | None:
        return struct.fields[name][1] if name in struct.fields else None


def _field_pointer(builder: Any, pointer: Any, word: int, kind: Any) -> Any:
    return builder.bitcast(cgutils.gep_inbounds(builder, pointer, word), kind.as_pointer())


@lower_getattr_generic(Struct)
def _load_field(context: Any, builder: Any, struct: Struct, pointer: Any, name: str) -> Any:
    word, kind = struct.fields[name]
    if isinstance(kind, Struct):
        return cgutils.gep_inbounds(builder, pointer, word)
    if not isinstance(kind, types.Array):
        return builder.load(_field_pointer(builder, pointer, word, context.get_value_type(kind)))
    shape = [
        builder.load(_field_pointer(builder, pointer, word + 1 + k, _integer))
        for k in range(kind.ndim)
    ]
    number = context.get_data_type(kind.dtype).as_pointer()
    data = builder.load(_field_pointer(builder, pointer, word, number))
    return build_array(context, builder, kind, data, shape)


def build_array(context: Any, builder: Any, kind: types.Array, data: Any, shape: list[Any]) -> Any:
    """Return the C-contiguous array of this type and shape at the pointer `data`."""
    size = np.dtype(str(kind.dtype)).itemsize
    strides = [ir.Constant(_integer, size)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    result = make_array(kind)(context, builder)
    populate_array(
        result,
        data=data,
        shape=shape,
        strides=strides,
        itemsize=ir.Constant(_integer, size),
        meminfo=None,
    )
    return result._getvalue()


@lower_setattr_generic(Struct)
def _store_field(context: Any, builder: Any, signature: Any, arguments: Any, name: str) -> None:
    struct = signature.args[0]
    word, kind = struct.fields[name]
    pointer, value = arguments
    value = context.cast(builder, value, signature.args[1], kind)
    builder.store(value, _field_pointer(builder, pointer, word, context.get_value_type(kind)))


def object_at_table(struct: Struct) -> Any:
    """Return a numba intrinsic that maps a table to the object stored in it."""

    @intrinsic
    def object_at(typing, table):
        def code(context, builder, signature, arguments):
            return arguments[0]

        return struct(table), code

    return object_at
