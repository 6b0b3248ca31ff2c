"""Roots, turns and minima of functions of time between samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray

# Tolerance of the time of a root, relative to the time and to the distance of its neighbors.
_TIME_ROUNDING = 4.0 * float(np.finfo(float).eps)
_BRENT_RTOL = 1e-15
# Minima are located to (2 / 32)^5 = 1e-6 of the first distance of their neighbors.
_REFINED_SAMPLES = 33
_REFINEMENTS = 5


def find_dips(t: Array, values: Array, evaluate: Callable[[Array], Array]) -> Array:
    """Return times [s] at which a function has passed to the other side of zero between samples.

    `evaluate` is the function of times that has the `values` at the times `t`.
    """
    k, _ = find_turns(t, values[:, None])
    if not len(k):
        return k
    signs = np.sign(values[k])

    def distances(times: Array) -> Array:
        return signs[:, None] * evaluate(times.ravel()).reshape(times.shape)

    dips = locate_minima(t[k - 1], t[k + 1], distances)
    return dips[signs * evaluate(dips) < 0.0]


def find_turns(t: Array, values: Array) -> tuple[Array, Array]:
    """Return rows and columns of samples (rows, k) beside which functions may pass zero and return.

    These samples and both of their neighbors have equal signs, the distance from zero is not larger
    than at the neighbors, and lines through two of the samples reach zero before the third one:
    a convex distance would be above these lines.
    """
    distance, signs = np.abs(values), np.sign(values)
    before, at, after = distance[:-2], distance[1:-1], distance[2:]
    is_one_sided = (signs[:-2] == signs[1:-1]) & (signs[1:-1] == signs[2:]) & (at > 0.0)
    is_smallest = (at <= before) & (at <= after)
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = np.diff(t)[:, None]
        slopes = np.abs(np.diff(distance, axis=0)) / lengths
        change = np.maximum(slopes[:-1] * lengths[1:], slopes[1:] * lengths[:-1])
    rows, columns = np.nonzero(is_one_sided & is_smallest & (at < change))
    return rows + 1, columns


def locate_minima(left: Array, right: Array, evaluate: Callable[[Array], Array]) -> Array:
    """Return the times [s] of the minima of functions between times [s], (k,) each.

    `evaluate` returns the values of function i at the times [i, :]. The minima are located by
    repeated sampling between the neighbors of the smallest sample.
    """
    center, functions = left, np.arange(len(left))
    for _ in range(_REFINEMENTS):
        times = np.linspace(left, right, _REFINED_SAMPLES, axis=1)
        lowest = np.argmin(evaluate(times), axis=1)
        left, center, right = (
            times[functions, np.clip(lowest + k, 0, _REFINED_SAMPLES - 1)] for k in (-1, 0, 1)
        )
    return center


def locate_root(evaluate: Callable[[Array], Array], start: float, end: float) -> float:
    """Return the time [s] between two times [s] at which a function of times changes its sign.

    Without a change, return the time at which the function is closer to zero.
    """
    # Imported here because the import takes as long as a short run.
    from scipy.optimize import brentq

    def value(t: float) -> float:
        return float(evaluate(np.array([t]))[0])

    before, after = value(start), value(end)
    if before * after >= 0.0:
        return end if abs(after) < abs(before) else start
    xtol = _TIME_ROUNDING * max(abs(end), end - start)
    return float(brentq(value, start, end, xtol=xtol, rtol=_BRENT_RTOL))
