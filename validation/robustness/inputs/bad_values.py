"""Values that most arguments reject."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import beamdae as bd


def _nested(depth: int) -> list[Any]:
    value: list[Any] = []
    for _ in range(depth):
        value = [value]
    return value


def _raise(*arguments: Any, **options: Any) -> Any:
    raise RuntimeError("this object raises")


_METHODS_OF_OBJECTS = ("bool", "eq", "hash", "len", "repr", "str")
_METHODS_OF_NUMBERS = ("abs", "add", "float", "ge", "gt", "index", "int", "le", "lt", "mul", "neg")
_METHODS_OF_CONTAINERS = ("contains", "getitem", "iter", "reversed")


def _hostile(base: type, names: Iterable[str], *arguments: Any, **members: Any) -> Any:
    """Return an object of a subclass of `base` whose special methods raise."""
    members |= {f"__{name}__": _raise for name in names}
    return type("Hostile", (base,), members)(*arguments)


HOSTILE_VALUES: dict[str, Callable[[Any], Any]] = {
    "object whose methods raise": lambda box: _hostile(
        object, (*_METHODS_OF_OBJECTS, *_METHODS_OF_NUMBERS, *_METHODS_OF_CONTAINERS)
    ),
    "object whose attributes raise": lambda box: _hostile(object, ("getattr",)),
    "number that raises": lambda box: _hostile(
        float, (*_METHODS_OF_OBJECTS, *_METHODS_OF_NUMBERS), 1.0
    ),
    "list that raises": lambda box: _hostile(
        list, (*_METHODS_OF_OBJECTS, *_METHODS_OF_CONTAINERS), [1.0, 2.0]
    ),
    "dictionary that raises": lambda box: _hostile(
        dict, (*_METHODS_OF_OBJECTS, *_METHODS_OF_CONTAINERS), {"a": 1.0}, items=_raise
    ),
    "text that raises": lambda box: _hostile(
        str, (*_METHODS_OF_OBJECTS, *_METHODS_OF_CONTAINERS), "abc", strip=_raise
    ),
    "path that raises": lambda box: _hostile(object, ("fspath", "str")),
    "array that raises": lambda box: _hostile(object, ("array",), ndim=0, item=_raise),
    # Without a valid name, it is no model function, whose exceptions are passed on unchanged.
    "function whose error has no text": lambda box: lambda *t, **options: _raise_hostile(),
}


def _raise_hostile(*arguments: Any, **options: Any) -> Any:
    raise type("HostileError", (Exception,), {"__str__": _raise, "__repr__": _raise})()


# Functions of the sandbox, so that each trial gets a new value.
BAD_VALUES: dict[str, Callable[[Any], Any]] = {
    "nan": lambda box: math.nan,
    "inf": lambda box: math.inf,
    "-inf": lambda box: -math.inf,
    "-1": lambda box: -1,
    "0": lambda box: 0,
    "-0.0": lambda box: -0.0,
    "10**400": lambda box: 10**400,
    "1e308": lambda box: 1e308,
    "-1e308": lambda box: -1e308,
    "1e-308": lambda box: 1e-308,
    "5e-324": lambda box: 5e-324,
    "1e12": lambda box: 1e12,
    "1e-12": lambda box: 1e-12,
    "True": lambda box: True,
    "None": lambda box: None,
    "empty text": lambda box: "",
    "text": lambda box: "abc",
    "text of a number": lambda box: "1.0",
    "bytes": lambda box: b"x",
    "empty list": lambda box: [],
    "empty dictionary": lambda box: {},
    "empty set": lambda box: set(),
    "tuple of one": lambda box: (1,),
    "tuple of three": lambda box: (1, 2, 3),
    "pair with nan": lambda box: (1.0, math.nan),
    "pair of texts": lambda box: ("a", "b"),
    "object": lambda box: object(),
    "function of nothing": lambda box: lambda: None,
    "function that gives None": lambda box: lambda *t: None,
    "function that fails": lambda box: lambda *t: 1 / 0,
    "complex": lambda box: 1 + 2j,
    "nested lists": lambda box: [[1, [2]], [3]],
    "ragged list": lambda box: [[1, 2], [3]],
    "list in a thousand lists": lambda box: _nested(1000),
    "array of two": lambda box: np.array([1.0, 2.0]),
    "array of shape (3, 3)": lambda box: np.ones((3, 3)),
    "array of shape (0,)": lambda box: np.zeros(0),
    "array without a dimension": lambda box: np.array(1.0),
    "array of nan": lambda box: np.full(2, np.nan),
    "array of texts": lambda box: np.array(["a", "b"]),
    "array of objects": lambda box: np.array([None, {}], object),
    "numpy integer": lambda box: np.int8(-1),
    "numpy nan": lambda box: np.float32("nan"),
    "SX symbol": lambda box: ca.SX.sym("s"),
    "MX symbol": lambda box: ca.MX.sym("m"),
    "SX vector": lambda box: ca.SX.sym("s", 3),
    "DM": lambda box: ca.DM([1.0, math.nan]),
    "long text": lambda box: "x" * 100_000,
    "control characters": lambda box: "a\x1b[31m\r\n\tb\x00",
    "markup": lambda box: "[bold]a[/bold] <b>&amp;</b>",
    "half a surrogate": lambda box: "\ud800",
    "separators": lambda box: "../a/b\\c",
    "generator": lambda box: (x for x in (1.0, 2.0)),
    "range": lambda box: range(2),
    "Decimal nan": lambda box: Decimal("nan"),
    "Fraction": lambda box: Fraction(10**400, 3),
    "path": lambda box: Path("nowhere"),
    "another part": lambda box: box.bar,
    "a part of another mechanism": lambda box: bd.RigidBody("stranger", 1.0, 1.0),
    "an attachment": lambda box: box.bar.at(1.0, 0.0),
    "a mechanism": lambda box: box.mech,
    "a class": lambda box: int,
    "a module": lambda box: np,
    "Ellipsis": lambda box: ...,
} | HOSTILE_VALUES
