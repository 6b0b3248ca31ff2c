"""Measures of models for sweeps without runs: natural frequencies and buckling loads."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from beamdae.analysis.linear_dynamics.natural_modes import compute_modes
from beamdae.analysis.statics.linear_buckling import buckling
from beamdae.errors import warn_user
from beamdae.model_functions import Model

Measures = dict[str, Callable[[Model], Any]]

# Model, number of values and values of the last call of each analysis. The columns of a row share
# one call.
_last_calls: dict[str, tuple[Model, int, list[float]]] = {}


def natural_frequencies(n: int) -> Measures:
    """Return functions of the first n natural frequencies [Hz] of a model, as of `modes`."""
    return {f"frequency {k} [Hz]": partial(_select, "frequencies", n, k) for k in range(1, n + 1)}


def buckling_factors(n: int) -> Measures:
    """Return functions of the first n load factors of a model, as of `buckling`."""
    return {f"buckling factor {k} [-]": partial(_select, "factors", n, k) for k in range(1, n + 1)}


def _select(name: str, n: int, k: int, model: Model) -> float | None:
    """Return the k-th of n values of an analysis, or None if there are fewer."""
    last = _last_calls.get(name)
    if last is None or last[0] is not model or last[1] != n:
        result: Any = compute_modes(model, n=n) if name == "frequencies" else buckling(model, n)
        for sentence in result.warnings:
            warn_user(sentence)
        last = _last_calls[name] = model, n, getattr(result, name).tolist()
    values = last[2]
    return values[k - 1] if k <= len(values) else None
