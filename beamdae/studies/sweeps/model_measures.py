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

# Model, further arguments and values of the last call of each analysis. The columns of a row share
# one call.
_last_calls: dict[str, tuple[Model, tuple[Any, ...], list[float]]] = {}


def natural_frequencies(n: int, about: Any) -> Measures:
    """Return functions of the first n natural frequencies [Hz] of a model, as of `modes`."""
    select = partial(_select, "frequencies", (about, n))
    return {f"frequency {k} [Hz]": partial(select, k) for k in range(1, n + 1)}


def buckling_factors(n: int) -> Measures:
    """Return functions of the first n load factors of a model, as of `buckling`."""
    select = partial(_select, "factors", (n,))
    return {f"buckling factor {k} [-]": partial(select, k) for k in range(1, n + 1)}


def _select(name: str, arguments: tuple[Any, ...], k: int, model: Model) -> float | None:
    """Return the k-th value of an analysis, or None if there are fewer."""
    last = _last_calls.get(name)
    if last is None or last[0] is not model or last[1] != arguments:
        analyze: Callable[..., Any] = compute_modes if name == "frequencies" else buckling
        result = analyze(model, *arguments)
        for sentence in result.warnings:
            warn_user(sentence)
        last = _last_calls[name] = model, arguments, getattr(result, name).tolist()
    values = last[2]
    return values[k - 1] if k <= len(values) else None
