"""Measures of models for sweeps without runs: natural frequencies and buckling loads."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from beamdae.analysis.linear_dynamics.natural_modes import compute_modes
from beamdae.analysis.statics.linear_buckling import buckling
from beamdae.errors import warn_user
from beamdae.model_functions import Model

# Model, number of values and values of the last call of each analysis. The columns of a row share
# one call.
_last_calls: dict[str, tuple[Model, int, list[float]]] = {}


def natural_frequencies(n: int) -> dict[str, Callable[[Model], Any]]:
    """Return functions of the first n natural frequencies [Hz] of a model, as of `modes`."""
    return {f"frequency {k} [Hz]": partial(_frequency, n=n, k=k) for k in range(1, n + 1)}


def buckling_factors(n: int) -> dict[str, Callable[[Model], Any]]:
    """Return functions of the first n load factors of a model, as of `buckling`."""
    return {f"buckling factor {k} [-]": partial(_factor, n=n, k=k) for k in range(1, n + 1)}


def _frequency(model: Model, n: int, k: int) -> float | None:
    return _select_value(_compute_frequencies, model, n, k)


def _factor(model: Model, n: int, k: int) -> float | None:
    return _select_value(_compute_factors, model, n, k)


def _compute_frequencies(model: Model, n: int) -> list[float]:
    result = compute_modes(model, n=n)
    _forward_warnings(result.warnings)
    return [float(x) for x in result.frequencies]


def _compute_factors(model: Model, n: int) -> list[float]:
    result = buckling(model, n)
    _forward_warnings(result.warnings)
    return [float(x) for x in result.factors]


def _forward_warnings(sentences: Iterable[str]) -> None:
    """Issue the warnings of an analysis, which the table of the sweep contains."""
    for sentence in sentences:
        warn_user(sentence)


def _select_value(
    analyze: Callable[[Model, int], list[float]], model: Model, n: int, k: int
) -> float | None:
    """Return the k-th value of an analysis, or None if there are fewer."""
    last = _last_calls.get(analyze.__name__)
    if last is None or last[0] is not model or last[1] != n:
        last = _last_calls[analyze.__name__] = model, n, analyze(model, n)
    values = last[2]
    return values[k - 1] if k <= len(values) else None
