"""Mutations of the parsed content of files: JSON values, arrays and CSV text."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable
from typing import Any

import numpy as np

_STOP_PROBABILITY = 0.1  # of mutating a container as a whole instead of one of its entries
_MAX_DEPTH = 12
OTHER_TYPES = (None, True, "x", 3, 2.5, [], {}, [[1]], {"a": 1}, [None], "", False)
HUGE = (10**400, -(10**400), 10**30, 2**63, 1e308, -1e308, 1e200, -(10**4000))
NOT_FINITE = (math.nan, math.inf, -math.inf)
LONG = (
    "x" * 100_000,
    "\x1b[2J\x07",
    "\ud800",
    "../../../etc/passwd",
    "/dev/zero",
    "a\0b",
    "=1+2",
    "</script><script>",
    "%s %d {0}",
)


def _nest(depth: int) -> Any:
    value: Any = []
    for _ in range(depth):
        value = [value]
    return value


NESTED = (_nest(30), _nest(120), _nest(400), [[]] * 1000)


def pick(content: Any, rng: random.Random) -> tuple[Any, Any]:
    """Return a container inside `content` and a key or index of one of its entries."""
    container, key = [content], 0
    for _ in range(_MAX_DEPTH):
        value = container[key]
        if not isinstance(value, (dict, list)) or not value:
            break
        if value is not content and rng.random() < _STOP_PROBABILITY:
            break
        entries = list(value) if isinstance(value, dict) else range(len(value))
        container, key = value, rng.choice(entries)
    return container, key


def replace_by(values: tuple[Any, ...]) -> Callable[[Any, random.Random], None]:
    """Return the mutation that replaces an entry by one of `values`."""

    def mutate(content: Any, rng: random.Random) -> None:
        container, key = pick(content, rng)
        container[key] = copy.deepcopy(rng.choice(values))

    return mutate


def change_value(content: Any, rng: random.Random) -> None:
    """Replace a value by another value of the same type."""
    container, key = pick(content, rng)
    value = container[key]
    if isinstance(value, bool):
        container[key] = not value
    elif isinstance(value, (int, float)):
        container[key] = rng.choice(
            (-value, value + 1, 2 * value, 0 * value, value * 1000, -1, value - 1)
        )
    elif isinstance(value, str):
        container[key] = rng.choice((f"{value}2", "", "unknown", value[::-1], "up", "ok"))
    elif isinstance(value, list):
        container[key] = rng.choice((value[::-1], value[:1], value * 2))


def remove(content: Any, rng: random.Random) -> None:
    """Remove an entry."""
    container, key = pick(content, rng)
    del container[key]


def add(content: Any, rng: random.Random) -> None:
    """Add an entry."""
    container, key = pick(content, rng)
    value = copy.deepcopy(rng.choice((container[key], *OTHER_TYPES)))
    if isinstance(container, list):
        container.insert(key, value)
    else:
        container[rng.choice(("more", "status", "t", f"{key} "))] = value


def rename(content: Any, rng: random.Random) -> None:
    """Rename an entry of an object."""
    container, key = pick(content, rng)
    if isinstance(container, dict):
        container[f"{key}x"] = container.pop(key)


JSON_MUTATIONS: dict[str, Callable[[Any, random.Random], None]] = {
    "types": replace_by(OTHER_TYPES),
    "values": change_value,
    "missing": remove,
    "extra": add,
    "names": rename,
    "huge": replace_by(HUGE),
    "nan": replace_by(NOT_FINITE),
    "nesting": replace_by(NESTED),
    "texts": replace_by(LONG),
}


def change_array(array: np.ndarray, rng: random.Random) -> np.ndarray:
    """Return an array with other numbers."""
    values = np.array(array)
    if not values.size:
        return np.ones((1, *values.shape[1:]))
    if values.dtype.kind != "f":
        return rng.choice((values[::-1], values + 1, -values, values * 0))
    index = rng.randrange(values.size)
    number = rng.choice((0.0, -1.0, 1e9, 1e300, math.nan, math.inf, 1e-300))
    with np.errstate(over="ignore"):
        kind = rng.randrange(5)
        if kind == 0:
            values.flat[index] = number
        elif kind == 1:
            values = values[::-1].copy()
        elif kind == 2:
            values = np.full_like(values, number)
        elif kind == 3:
            values = values * 1.5
        else:
            values.flat[index] = values.flat[index - 1]
    return values


def reshape_array(array: np.ndarray, rng: random.Random) -> np.ndarray:
    """Return an array of another shape or type."""
    options: list[Callable[[], np.ndarray]] = [
        lambda: array[:-1],
        lambda: array[:0],
        lambda: np.concatenate([array, array]),
        lambda: np.atleast_2d(array),
        lambda: array.ravel(),
        lambda: array.T[None],
        lambda: np.float64(3.0),
        lambda: array.astype(np.float32),
        lambda: array.astype(np.int64, casting="unsafe"),
        lambda: array.astype(complex),
        lambda: array.astype(str),
        lambda: array.astype(">f8"),
        lambda: array.astype(bool),
        lambda: np.asfortranarray(array),
        lambda: np.array(["2026-01-01"], "datetime64[D]"),
    ]
    with np.errstate(invalid="ignore"):
        return np.asarray(rng.choice(options)())


def change_csv(text: str, rng: random.Random) -> str:
    """Return CSV text with another cell, row or header."""
    lines = text.splitlines()
    row = rng.randrange(len(lines))
    cells = lines[row].split(",")
    cell = rng.randrange(len(cells))
    kind = rng.randrange(8)
    if kind <= 2:
        cells[cell] = rng.choice(("", "nan", "inf", "x", "1.2.3", "1e999", "-", "1_0", "9e9", '"'))
        lines[row] = ",".join(cells)
    elif kind == 3:
        lines[row] = ",".join([*cells, "0.0"])
    elif kind == 4:
        lines[row] = ",".join(cells[:-1])
    elif kind == 5:
        del lines[row]
    elif kind == 6:
        lines.insert(row, lines[row])
    else:
        lines[1:] = lines[:0:-1]
    return rng.choice(("\n".join([*lines, ""]), "\n".join(lines), "\n".join([*lines, ""])))
