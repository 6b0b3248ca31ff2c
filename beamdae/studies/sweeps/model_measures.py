"""Measures of models for sweeps without runs: natural frequencies and buckling loads."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from beamdae.analysis.linear_dynamics.natural_modes import modes
from beamdae.analysis.statics.linear_buckling import buckling
from beamdae.errors import warn_user
from beamdae.model_functions import Model

Array = np.ndarray

# The last model and its values: the columns of a row need one analysis.
_last: dict[str, tuple[Model, int, list[float]]] = {}


def natural_frequencies(n: int) -> dict[str, Callable[[Model], Any]]:
    """Return functions of the first n natural frequencies [Hz] of a model, as of `modes`."""
    return {f"frequency {k} [Hz]": partial(_frequency, n=n, k=k) for k in range(1, n + 1)}


def buckling_factors(n: int) -> dict[str, Callable[[Model], Any]]:
    """Return functions of the first n load factors of a model, as of `buckling`."""
    return {f"buckling factor {k} [-]": partial(_factor, n=n, k=k) for k in range(1, n + 1)}


def _frequency(model: Model, n: int, k: int) -> float | None:
    return _value("modes", model, n, k, lambda: _warn_of(modes(model, n=n)).frequencies)


def _factor(model: Model, n: int, k: int) -> float | None:
    return _value("buckling", model, n, k, lambda: _warn_of(buckling(model, n)).factors)


def _warn_of(result: Any) -> Any:
    """Issue the warnings of an analysis, which the table contains, and return the analysis."""
    for sentence in result.warnings:
        warn_user(sentence)
    return result


def _value(name: str, model: Model, n: int, k: int, compute: Callable[[], Array]) -> float | None:
    """Return the k-th value of an analysis, or None if there are fewer."""
    last = _last.get(name)
    if last is None or last[0] is not model or last[1] != n:
        last = _last[name] = model, n, compute().tolist()
    return last[2][k - 1] if k <= len(last[2]) else None
