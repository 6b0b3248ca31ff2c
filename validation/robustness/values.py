"""Values that most arguments cannot be."""

from __future__ import annotations

import math
from collections.abc import Callable
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


# Made anew for each input, from the small mechanism it is put into.
VALUES: dict[str, Callable[[Any], Any]] = {
    "nan": lambda w: math.nan,
    "inf": lambda w: math.inf,
    "-inf": lambda w: -math.inf,
    "-1": lambda w: -1,
    "0": lambda w: 0,
    "-0.0": lambda w: -0.0,
    "10**400": lambda w: 10**400,
    "1e308": lambda w: 1e308,
    "-1e308": lambda w: -1e308,
    "1e-308": lambda w: 1e-308,
    "5e-324": lambda w: 5e-324,
    "1e12": lambda w: 1e12,
    "1e-12": lambda w: 1e-12,
    "True": lambda w: True,
    "None": lambda w: None,
    "empty text": lambda w: "",
    "text": lambda w: "abc",
    "text of a number": lambda w: "1.0",
    "bytes": lambda w: b"x",
    "empty list": lambda w: [],
    "empty dictionary": lambda w: {},
    "empty set": lambda w: set(),
    "tuple of one": lambda w: (1,),
    "tuple of three": lambda w: (1, 2, 3),
    "pair with nan": lambda w: (1.0, math.nan),
    "pair of texts": lambda w: ("a", "b"),
    "object": lambda w: object(),
    "function of nothing": lambda w: lambda: None,
    "function that gives None": lambda w: lambda *t: None,
    "function that fails": lambda w: lambda *t: 1 / 0,
    "complex": lambda w: 1 + 2j,
    "nested lists": lambda w: [[1, [2]], [3]],
    "ragged list": lambda w: [[1, 2], [3]],
    "list in a thousand lists": lambda w: _nested(1000),
    "array of two": lambda w: np.array([1.0, 2.0]),
    "array of shape (3, 3)": lambda w: np.ones((3, 3)),
    "array of shape (0,)": lambda w: np.zeros(0),
    "array without a dimension": lambda w: np.array(1.0),
    "array of nan": lambda w: np.full(2, np.nan),
    "array of texts": lambda w: np.array(["a", "b"]),
    "array of objects": lambda w: np.array([None, {}], object),
    "numpy integer": lambda w: np.int8(-1),
    "numpy nan": lambda w: np.float32("nan"),
    "SX symbol": lambda w: ca.SX.sym("s"),
    "MX symbol": lambda w: ca.MX.sym("m"),
    "SX vector": lambda w: ca.SX.sym("s", 3),
    "DM": lambda w: ca.DM([1.0, math.nan]),
    "long text": lambda w: "x" * 100_000,
    "control characters": lambda w: "a\x1b[31m\r\n\tb\x00",
    "markup": lambda w: "[bold]a[/bold] <b>&amp;</b>",
    "half a surrogate": lambda w: "\ud800",
    "separators": lambda w: "../a/b\\c",
    "generator": lambda w: (x for x in (1.0, 2.0)),
    "range": lambda w: range(2),
    "Decimal nan": lambda w: Decimal("nan"),
    "Fraction": lambda w: Fraction(10**400, 3),
    "path": lambda w: Path("nowhere"),
    "another part": lambda w: w.bar,
    "a part of another mechanism": lambda w: bd.RigidBody("stranger", 1.0, 1.0),
    "an attachment": lambda w: w.bar.at(1.0, 0.0),
    "a mechanism": lambda w: w.mech,
    "a class": lambda w: int,
    "a module": lambda w: np,
    "Ellipsis": lambda w: ...,
}
