"""Tables of the numbers and arrays of an object, on which functions of the core work.

The structures in `core.h` determine the tables: a Python object, usually a dataclass, has
attributes with the names of the fields. Numbers are copied into the table and back at each call; of
arrays, it contains the address and the shape.
"""

from __future__ import annotations

import ctypes
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.core.library import FOLDER, load_core

Array = np.ndarray

_NUMBERS: dict[str, Any] = {"double": np.float64, "int64_t": np.int64}
_DTYPES = {
    "Reals": np.float64,
    "Complexes": np.complex128,
    "Indices": np.uint32,
    "Integers": np.int64,
    "Shorts": np.int32,
}
# dtype and number of dimensions of the array types in `arrays.h`.
_ARRAYS = {
    f"{name}{suffix}": (np.dtype(dtype), n_axes)
    for name, dtype in _DTYPES.items()
    for suffix, n_axes in (("", 1), ("2", 2), ("3", 3))
}
# Field that holds attributes of the same object.
_BASE = "base"
_CALL = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)


@cache
def read_header(*headers: Path) -> str:
    """Return the text of `core.h` and further headers, without comments."""
    files = (FOLDER / "core.h", *headers)
    text = "".join(file.read_text("utf-8") for file in files)
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


@cache
def _read_structures(*headers: Path) -> dict[str, tuple[tuple[str, str], ...]]:
    """Return (name, type) of the fields of each structure in `core.h` and further headers."""
    pattern, structures = r"typedef struct \{(.*?)\} (\w+);", {}
    for body, name in re.findall(pattern, read_header(*headers), re.DOTALL):
        lines = (line.split(maxsplit=1) for line in body.split(";") if line.strip())
        structures[name] = tuple(
            (field.strip(), kind) for kind, names in lines for field in names.split(",")
        )
    return structures


@cache
def _structure_of(function: str) -> str:
    """Return the structure on which a function works."""
    (name,) = re.findall(rf"int {function}\((\w+) \*\w+\);", read_header())
    return str(name)


def _list_fields(structure: str) -> dict[str, str]:
    """Return the types of the fields of a structure, those of its base first, by name."""
    fields = dict(_read_structures()[structure])
    base = fields.pop(_BASE, None)
    return fields if base is None else _list_fields(base) | fields


class Workspace:
    """Object with the fields of a structure in `core.h`; numbers are zero by default.

    Attributes
    ----------
    structure
        Name of the structure.
    """

    structure: str

    def __init__(self, structure: str, /, **fields: Any) -> None:
        known = _list_fields(structure)
        if unknown := fields.keys() - known.keys():
            raise TypeError(f"{structure} has no fields {', '.join(sorted(unknown))}")
        numbers = {x: _NUMBERS[kind](0).item() for x, kind in known.items() if kind in _NUMBERS}
        vars(self).update(numbers | fields, structure=structure)

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

        def __setattr__(self, name: str, value: Any) -> None: ...


class Number(NamedTuple):
    """Number in a table: words of the table as its type, index, and attribute of an object."""

    words: memoryview
    word: int
    owner: Any
    name: str


class Layout:
    """Words of an object in a table.

    Attributes
    ----------
    words
        Words of 64 bits, with zeros in place of numbers.
    arrays
        Arrays, each with the index of the word that contains its address.
    objects
        The object and those in its fields, each with its first word and its structure.
    """

    def __init__(self, structure: str, owner: Any, *headers: Path) -> None:
        """Lay out an object of a structure in `core.h` or in one of `headers`."""
        self.words: list[int] = []
        self._numbers: list[tuple[Any, int, Any, str]] = []
        self.arrays: list[tuple[int, Array]] = []
        self.objects: list[tuple[Any, int, str]] = []
        self._structures = _read_structures(*headers)
        self._add(structure, owner)

    def _add(self, structure: str, owner: Any) -> None:
        words = self.words
        self.objects.append((owner, len(words), structure))
        for name, kind in self._structures[structure]:
            if name == _BASE:
                self._add(kind, owner)
                continue
            value = getattr(owner, name, None)
            if kind in _ARRAYS:
                dtype, n_axes = _ARRAYS[kind]
                if value is None:
                    words += [0] * (1 + n_axes)
                    continue
                if value.dtype != dtype or value.ndim != n_axes or not value.flags.c_contiguous:
                    raise TypeError(f"{structure}.{name}: {value.dtype} {value.shape} is no {kind}")
                self.arrays.append((len(words), value))
                words.append(address_of(value))
                words += value.shape
            elif kind in _NUMBERS:
                if value is not None:
                    self._numbers.append((_NUMBERS[kind], len(words), owner, name))
                words.append(0)
            else:
                self._add(kind, value)

    def numbers_in(self, table: Array) -> list[Number]:
        """Return the numbers in a table of these words, int64."""
        views = {dtype: memoryview(table.view(dtype)) for dtype in _NUMBERS.values()}
        return [Number(views[dtype], *number) for dtype, *number in self._numbers]


def address_of(array: Array) -> int:
    """Return the address of an array; 0 if it is empty."""
    if not array.size:
        return 0
    if array.flags.writeable:
        # `array.ctypes` takes ten times as long.
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))
    return int(array.ctypes.data)


class Loop:
    """A function of the core, bound to the object on which it works.

    Parameters
    ----------
    function
        Name of a function of one structure that returns a code.
    work
        Object with the fields of the structure. Between calls, numbers may be assigned, but arrays
        must be changed in place.

    Attributes
    ----------
    table
        Words of 64 bits.
    """

    def __init__(self, function: str, work: Any) -> None:
        core = load_core()
        assert core is not None
        layout = Layout(_structure_of(function), work)
        self._objects = layout.objects
        self.table = np.array(layout.words, np.int64)
        self._numbers = layout.numbers_in(self.table)
        self._call = _CALL((function, core))
        self._address = self.table.ctypes.data
        # Kept because the table holds addresses of its arrays.
        self._work = work

    def __call__(self) -> int:
        """Call the function, update the numbers of the object, and return the code."""
        self.load()
        code = self._call(self._address)
        self.unload()
        return int(code)

    def bind(self, *owners: Any) -> None:
        """Update the table after arrays of these nested objects, or of any, have been replaced.

        The address of the table does not change, so that callbacks may call this method while the
        function runs.
        """
        for owner in owners or (self._work,):
            start, structure = next((word, name) for x, word, name in self._objects if x is owner)
            words = Layout(structure, owner).words
            self.table[start : start + len(words)] = words
        self.load()

    def load(self) -> None:
        """Copy the numbers of the object into the table."""
        for words, word, owner, name in self._numbers:
            words[word] = getattr(owner, name)

    def unload(self) -> None:
        """Copy the numbers in the table into the object."""
        for words, word, owner, name in self._numbers:
            setattr(owner, name, words[word])
