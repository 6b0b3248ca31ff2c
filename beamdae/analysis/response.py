"""Periodic motions over a parameter, past folds: response curves of nonlinear mechanisms."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.analysis.arc_length import Curve, Traced
from beamdae.analysis.periodic import RTOL, TOLERANCE, largest, sorted_multipliers
from beamdae.errors import BeamdaeError, BeamdaeWarning, count, finite, pair, positive, shown
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.model_functions import Model
from beamdae.results.solution import Solution, Status

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Iterations of Newton's method up to which steps get longer, and from which on they get shorter; by
# how much, and how short they may be over the first.
_FEW, _MANY = 3, 5
_LONGER, _SHORTER, _LEAST_STEP = 1.5, 0.5, 1e-3
# A multiplier beyond one by this much makes a motion unstable.
_UNSTABLE = 1e-3


@dataclass(frozen=True, eq=False)
class ResponsePoint:
    """A periodic motion of a response curve.

    Attributes
    ----------
    parameter, period
        Value of the parameter, and period [s].
    solution
        One period of the motion.
    multipliers
        Floquet multipliers, the largest first.
    forward
        Whether the parameter grows along the curve there.
    """

    parameter: float
    period: float
    solution: Solution
    multipliers: Array
    forward: bool = True

    @property
    def stable(self) -> bool:
        """Whether no disturbance grows."""
        return largest(self.multipliers) <= 1.0 + _UNSTABLE


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Periodic motions along a curve over a parameter.

    Attributes
    ----------
    parameter
        Its name.
    points
        The motions in the order of the curve.
    status
        Whether the curve reached the end of the range, or why not.
    """

    parameter: str
    points: tuple[ResponsePoint, ...]
    status: Status

    def table(self) -> pd.DataFrame:
        """One row a motion: parameter, period, mean and half the range of each observed column.

        Behind them whether it is stable, the largest modulus of its multipliers, and "fold" where
        the parameter turned around.
        """
        import pandas as pd

        return pd.DataFrame([self._row(k) for k in range(len(self.points))])

    def _row(self, k: int) -> dict[str, Any]:
        point = self.points[k]
        row: dict[str, Any] = {self.parameter: point.parameter, "period [s]": point.period}
        for header, values in point.solution.columns.items():
            name, _, unit = header.partition(" [")
            mean = float(np.trapezoid(values, point.solution.t) / point.period)
            row |= {
                f"{name} mean [{unit}": mean,
                f"{name} half range [{unit}": float(0.5 * np.ptp(values)),
            }
        fold = k > 0 and point.forward != self.points[k - 1].forward
        return row | {
            "stable": point.stable,
            "largest multiplier": largest(point.multipliers),
            "fold": fold,
        }

    @property
    def folds(self) -> list[float]:
        """Values of the parameter at which the curve turns around.

        Vertices of the parabolas through the points around each.
        """
        values = np.array([point.parameter for point in self.points])
        turned = np.flatnonzero(np.diff(np.sign(np.diff(values))) != 0) + 1
        return [self._vertex(k, values) for k in turned.tolist()]

    def peaks(self, column: str) -> list[tuple[float, float]]:
        """(parameter, half the range) where half the range of an observed column is largest.

        Of each peak of the curve, by the parabola through the points around it.
        """
        names = list(self.points[0].solution.columns)
        if column not in names:
            raise BeamdaeError(
                f"peaks: column must be one of {', '.join(map(repr, names))}, got {shown(column)}."
            )
        sizes = np.array([0.5 * np.ptp(x.solution.columns[column]) for x in self.points])
        values = np.array([point.parameter for point in self.points])
        (inner,) = np.nonzero((sizes[1:-1] >= sizes[:-2]) & (sizes[1:-1] > sizes[2:]))
        found = []
        for k in (inner + 1).tolist():
            at = self._top(k, sizes)
            found.append(
                (_lagrange(at, k, self._along, values), _lagrange(at, k, self._along, sizes))
            )
        return found

    @property
    def _along(self) -> Array:
        """Arc length of the curve, in what the parameter and the first column change."""
        values = np.array([point.parameter for point in self.points])
        sizes = np.array(
            [[0.5 * np.ptp(x) for x in p.solution.columns.values()] for p in self.points]
        )
        rows = np.concatenate([values[:, None], sizes], axis=1)
        rows = rows / np.where(np.ptp(rows, axis=0) > 0.0, np.ptp(rows, axis=0), 1.0)
        steps = np.linalg.norm(np.diff(rows, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-12))])

    def _top(self, k: int, values: Array) -> float:
        """Where along the curve the parabola through three points has its vertex."""
        x, y = self._along[k - 1 : k + 2], values[k - 1 : k + 2]
        a, b, _ = np.polyfit(x - x[1], y, 2)
        return float(x[1] - 0.5 * b / a) if a != 0.0 else float(x[1])

    def _vertex(self, k: int, values: Array) -> float:
        return _lagrange(self._top(k, values), k, self._along, values)


def _lagrange(at: float, k: int, along: Array, values: Array) -> float:
    x, y = along[k - 1 : k + 2], values[k - 1 : k + 2]
    return float(np.polyval(np.polyfit(x - x[1], y, 2), at - x[1]))


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
        Also where the curve ends before its range does: `status` says why, and a warning.
    """
    name = "frequency_response"
    if not isinstance(model, Model):
        raise BeamdaeError(f"{name}: model must be a model function, got {shown(model)}.")
    first, last = pair(name, "between", between, "a pair of values of the parameter")
    ends = finite(name, "between", first), finite(name, "between", last)
    if ends[0] == ends[1]:
        raise BeamdaeError(f"{name}: between must be two values that differ, got {shown(between)}.")
    model.complete({parameter: ends[0]})
    method = Radau(RTOL) if integrator is None else integrator
    require_integrator(name, method)
    curve = Curve(
        model,
        parameter,
        ends,
        _reciprocal if period is None else period,
        method,
        finite(name, "begin", begin),
        positive(name, "tolerance", tolerance),
    )
    steps = positive(name, "step", step), positive(name, "longest_step", longest_step)
    first_point = curve.first(count(name, "settle", settle, least=0))
    most = count(name, "most_points", most_points, least=2)
    points, status = _followed(curve, first_point, steps, most)
    if not status.success:
        warnings.warn(f"{name}: {status.sentence}.", BeamdaeWarning, stacklevel=2)
    return FrequencyResponse(parameter, points, status)


def _reciprocal(frequency: float) -> float:
    return 1.0 / frequency


def _followed(
    curve: Curve, point: Traced, steps: tuple[float, float], most: int
) -> tuple[tuple[ResponsePoint, ...], Status]:
    """The points, and how the curve ended."""
    size, (first, last) = steps[0], curve.ends
    way = 1.0 if last > first else -1.0
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
