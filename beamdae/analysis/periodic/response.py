"""Periodic motions over a parameter, past folds: response curves of nonlinear mechanisms."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from beamdae.analysis.periodic.periodic import MOST_SETTLING, RTOL, TOLERANCE
from beamdae.analysis.periodic.periodic_family import Curve, Traced
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    require_choice,
    require_count,
    require_finite,
    require_pair,
    require_positive,
    short_repr,
)
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.model_functions import Model
from beamdae.results.frequency_response import FrequencyResponse, ResponsePoint
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import sorted_multipliers

Array = np.ndarray

# Iterations of Newton's method up to which steps get longer, and from which on they get shorter; by
# how much, and how short they may be over the first.
_FEW, _MANY = 3, 5
_LONGER, _SHORTER, _LEAST_STEP = 1.5, 0.5, 1e-3


def frequency_response(
    model: Model,
    parameter: str,
    between: tuple[float, float],
    period: Callable[[float], float] | None = None,
    integrator: Integrator | None = None,
    step: float = 0.02,
    longest_step: float = 0.1,
    settle: int = 20,
    tolerance: float = TOLERANCE,
    most_points: int = 400,
    begin: float = 0.0,
) -> FrequencyResponse:
    """Follow the periodic motion of a model over the frequency of its loads, or another parameter.

    Pseudo arc length continuation (Keller 1977) of single shooting, see `periodic`: the curve goes
    on where the parameter turns around (folds), on to motions that are not stable.

    Parameters
    ----------
    model
        A model function; each motion is one of `model(**{parameter: value})`.
    parameter
        The name of one of its parameters, a number.
    between
        Where the curve begins, and the value at which it ends; also downwards.
    period
        Period [s] of the loads as a function of the parameter; default its reciprocal, that of a
        frequency in Hz.
    integrator
        Default Radau(1e-8).
    step, longest_step
        First and longest step of the curve, over the range of the parameter.
    settle
        Periods run before the first motion.
    tolerance
        By how much a period may miss its start, over how far coordinates move.
    most_points
        How many motions at most.
    begin
        Time [s] at which periods begin.

    Returns
    -------
    FrequencyResponse
        Also where the curve ends before its range does, or where no motion is found to begin with:
        `status` says why, and a warning.
    """
    name = "frequency_response"
    if not isinstance(model, Model):
        raise BeamdaeError(f"{name}: model must be a model function, got {short_repr(model)}.")
    first, last = require_pair(name, "between", between, "a pair of values of the parameter")
    ends = require_finite(name, "between", first), require_finite(name, "between", last)
    if ends[0] == ends[1]:
        raise BeamdaeError(
            f"{name}: between must be two values that differ, got {short_repr(between)}."
        )
    require_choice(name, "parameter", parameter, tuple(model.parameters))
    model.complete({parameter: ends[0]})
    method = Radau(RTOL) if integrator is None else integrator
    require_integrator(name, method)
    curve = Curve(
        model,
        parameter,
        ends,
        _reciprocal if period is None else period,
        method,
        require_finite(name, "begin", begin),
        require_positive(name, "tolerance", tolerance),
    )
    steps = (
        require_positive(name, "step", step),
        require_positive(name, "longest_step", longest_step),
    )
    settle = require_count(name, "settle", settle, 0, MOST_SETTLING)
    most = require_count(name, "most_points", most_points, least=2)
    points, status = _followed(curve, settle, steps, most)
    if not status.success:
        warnings.warn(f"{name}: {status.sentence}.", BeamdaeWarning, stacklevel=2)
    return FrequencyResponse(parameter, points, status)


def _reciprocal(frequency: float) -> float:
    return 1.0 / frequency


def _followed(
    curve: Curve, settle: int, steps: tuple[float, float], most: int
) -> tuple[tuple[ResponsePoint, ...], Status]:
    """The points, and how the curve ended."""
    size, (first, last) = steps[0], curve.ends
    way = 1.0 if last > first else -1.0
    point, why = curve.first(settle)
    if point is None:
        return (), Status("failed", why)
    found = [_of(point, way)]
    while len(found) < most:
        after, why = curve.after(point, size)
        if after is None:
            size *= _SHORTER
            if size < _LEAST_STEP * steps[0]:
                return tuple(found), Status("failed", f"{curve.told(point.value)}: {why}")
            continue
        point = after
        found.append(_of(point, way))
        if way * (point.value - last) >= 0.0:
            return tuple(found), Status("ok", "reached the end of the range")
        if way * (point.value - first) < 0.0:
            return tuple(found), Status("ok", "came back to where the range begins")
        if point.iterations <= _FEW:
            size = min(size * _LONGER, steps[1])
        elif point.iterations >= _MANY:
            size *= _SHORTER
    return tuple(found), Status("limited", f"{curve.told(point.value)}: {most} points were made")


def _of(point: Traced, way: float) -> ResponsePoint:
    multipliers = sorted_multipliers(point.shot.carried)
    forward = way * point.direction[-1] > 0.0
    return ResponsePoint(point.value, point.period, point.shot.solution, multipliers, forward)
