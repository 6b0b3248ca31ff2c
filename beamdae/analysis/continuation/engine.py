"""Curves of solutions of F(x, p) = 0, followed by predictor and corrector steps.

Newton's method solves the equations together with one further row, which prescribes the parameter,
a function of the solution, or the arc length (H. B. Keller, 1977): the bordered matrix is regular
at limit points. One norm, the largest change of a coordinate in natural sizes, measures all steps.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.analysis.continuation.newton import (
    CORRECTED,
    FAILURES,
    NEGLIGIBLE,
    ROUNDING,
    Corrections,
    is_negligible,
    judge,
)
from beamdae.native.return_codes import DONE

Array = np.ndarray

# Number of times a correction is halved if the equations cannot be evaluated after it.
_MAX_HALVINGS = 5
# Steps: factor after a failure, and smallest and largest growth.
_CUT, _MIN_GROWTH, _MAX_GROWTH = 0.25, 0.3, 2.0
# The correction of a step, relative to the step, and the angle [rad] between successive tangents at
# which steps neither grow nor shrink.
_AIMED_CORRECTION, _AIMED_ANGLE = 0.05, 0.4
# Largest correction of a step along the tangent at one of its ends, relative to the step: a larger
# one leads to another curve. Smallest cosine of the angle between successive tangents: a crossing
# curve leaves at a larger one.
_MAX_ERROR, _MIN_COSINE = 0.3, 0.8
# Largest curvature of a prediction, relative to the step.
_MAX_CURVED = 0.25
# A remaining distance up to this multiple of the step is split in two.
_SPLIT_RATIO = 1.2
# Relative rounding of a remaining distance.
_REACH_ROUNDING = 1e-3
# Steps below this fraction of the largest one may turn by any angle: the curve has a corner.
_CORNER_STEP = 1e-3
# Position of a target in a step that passes it.
_TARGET = 0.5
# Distance from a singular point, relative to the segment, at which rounding does not move points
# along the critical mode.
REGULAR_DISTANCE = 1e-3


class CurveError(Exception):
    """Raised if a point or a step cannot be found; the message says why, without a period."""


class Factors(Protocol):
    """Factors of a bordered matrix."""

    def solve(self, right: Array) -> Array:
        """Return the solution for a right-hand side (n + 1,)."""


@dataclass(frozen=True, eq=False)
class SparseLinearization:
    """Linearization of equations with a Jacobian (CSC), see `Problem.linearize`."""

    residual: Array
    by_parameter: Array
    jacobian: sp.csc_array

    def bordered(self, column: Array, row: Array, corner: float) -> Factors:
        """Return the factors of the bordered Jacobian."""
        return factorize_bordered(self.jacobian, column, row, corner)


class Problem(ABC):
    """Equations F(x, p) = 0."""

    @property
    @abstractmethod
    def weights(self) -> Array:
        """Inverse natural sizes of the unknowns; 0 for those that do not measure a step."""

    @property
    def mode_weights(self) -> Array:
        """Inverse sizes of the unknowns that make all parts equally stiff, for critical modes."""
        return self.weights

    @abstractmethod
    def linearize(self, x: Array, p: float, last: Any = None) -> Any:
        """Return the equations, linearized about (x, p).

        The result has the residual F and its derivative `by_parameter`, (n,) each, and a method
        `bordered(column, row, corner)` that returns the factors of [[J, column], [row, corner]]. J
        is the Jacobian by x; factors have a method `solve(right)`.

        `last` is the linearization of the last iteration, or None: a problem may keep its matrix.

        Raises
        ------
        CurveError
            If the equations cannot be evaluated; `bordered` raises it for singular matrices.
        """

    @abstractmethod
    def monitor(self, point: Point) -> Any:
        """Return what must change continuously along a curve, such as its stability."""

    def measure(self, step: Array) -> float:
        """Return the size of a step in natural sizes: by default, the largest change."""
        return float(np.max(np.abs(step * self.weights), initial=0.0))

    # Corrections that are not finite end the method.
    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def correct(self, control: Control, target: float, x: Array, p: float) -> Point:
        """Return the solution at which the control has the value `target`, by Newton's method.

        Raises
        ------
        CurveError
            If the method fails.
        """
        corrections, linear = Corrections(), self.linearize(x, p)
        while True:
            row = control(x, p)
            factors = linear.bordered(linear.by_parameter, row.x, row.p)
            step = factors.solve(-np.append(linear.residual, row.value - target))
            size = self.measure(step[:-1])
            code = judge(corrections, size, self.is_solved(linear, step, size, corrections.last))
            if code == DONE:
                return self.complete(Point(self, x, p, linear, corrections.count), step)
            if code != CORRECTED:
                raise CurveError(FAILURES[code])
            for k in range(_MAX_HALVINGS + 1):
                change = corrections.share * 0.5**k * step
                following = x + change[:-1], p + float(change[-1])
                try:
                    linear = self.linearize(*following, linear)
                    break
                except CurveError:
                    if k == _MAX_HALVINGS:
                        raise
            x, p = following

    def find_tangent(self, point: Point, row: Row) -> Tangent:
        """Return the tangent at a solution along which the control with this row increases by 1."""
        factors = point.bordered(point.linearization.by_parameter, row.x, row.p)
        solution = factors.solve(np.append(np.zeros(len(point.x)), 1.0))
        return Tangent(solution[:-1], float(solution[-1]))

    def is_solved(self, linear: Any, step: Array, size: float, last: float) -> bool:
        """Return True if a point is a solution after its correction `step` of (x, p).

        `size` and `last` are the sizes of this and of the previous correction in natural sizes.
        """
        return is_negligible(size, last)

    def complete(self, point: Point, step: Array) -> Point:
        """Return a solution, given the point before its last correction `step` of (x, p)."""
        x, p = point.x + step[:-1], point.p + float(step[-1])
        return replace(point, x=x, p=p, linearization=self.linearize(x, p))


class Tangent(NamedTuple):
    """Derivatives of x and p along a curve, or changes of both."""

    x: Array
    p: float

    def scale(self, factor: float) -> Tangent:
        """Return the tangent times `factor`."""
        return Tangent(factor * self.x, factor * self.p)

    def plus(self, other: Tangent, factor: float = 1.0) -> Tangent:
        """Return the sum with `factor` times another one."""
        return Tangent(self.x + factor * other.x, self.p + factor * other.p)

    @property
    def packed(self) -> Array:
        """Derivatives in one array, (n + 1,)."""
        return np.append(self.x, self.p)


class Row(NamedTuple):
    """Value of a control at a point, and its derivatives by x and p.

    `is_linear` is True if the derivatives are the same everywhere.
    """

    value: float
    x: Array
    p: float
    is_linear: bool = False


Control = Callable[[Array, float], Row]


@dataclass(frozen=True, eq=False)
class Point:
    """Solution of a problem, with its linearization.

    `beside` is a point beside a singular one, whose monitor is not a matter of rounding.
    """

    problem: Problem
    x: Array
    p: float
    linearization: Any
    iterations: int = 0
    beside: Point | None = None
    _neighbor: list[tuple[Tangent, Any]] = field(default_factory=list, init=False, repr=False)

    @cached_property
    def monitor(self) -> Any:
        """What must change continuously along curves, see `Problem.monitor`."""
        return self.beside.monitor if self.beside else self.problem.monitor(self)

    def neighbor(self, move: Tangent) -> tuple[Tangent, Any]:
        """Return a small move along the curve, and the monitor after it.

        They are those of the first call: the tangent of a curve is unique.
        """
        if not self._neighbor:
            self._neighbor.append((move, self.plus(move).monitor))
        return self._neighbor[0]

    def plus(self, move: Tangent) -> Point:
        """Return the point after a move that keeps it on the curve."""
        x, p = self.x + move.x, self.p + move.p
        return Point(self.problem, x, p, self.problem.linearize(x, p))

    def minus(self, other: Point) -> Tangent:
        """Return the change from another point to this one."""
        return Tangent(self.x - other.x, self.p - other.p)

    def bordered(self, column: Array, row: Array, corner: float) -> Factors:
        """Return the factors of the Jacobian, bordered by a column and a row."""
        return self.linearization.bordered(column, row, corner)

    def tangent(self, row: Row) -> Tangent:
        """Return the tangent along which the control with this row increases by 1."""
        tangent = self.problem.find_tangent(self, row)
        if not np.isfinite(tangent.packed).all():
            raise CurveError("the tangent is not unique")
        return tangent


def factorize_bordered(jacobian: sp.csc_array, column: Array, row: Array, corner: float) -> Factors:
    """Return the factors of [[J, column], [row, corner]].

    Raises
    ------
    CurveError
        If the matrix is singular or not finite.
    """
    top = sp.hstack([jacobian, sp.csc_array(column[:, None])])
    bottom = sp.csc_array(np.append(row, corner)[None])
    matrix = sp.csc_matrix(sp.vstack([top, bottom]))
    if not np.isfinite(matrix.data).all():
        raise CurveError("the equations are not finite")
    try:
        return splu(matrix)
    except RuntimeError:
        raise CurveError("the tangent is singular") from None


def prescribe_parameter(x: Array, p: float) -> Row:
    """Control by the parameter."""
    return Row(p, _zero_row(len(x)), 1.0, True)


@lru_cache(maxsize=8)
def _zero_row(size: int) -> Array:
    zeros = np.zeros(size)
    zeros.flags.writeable = False
    return zeros


@dataclass(frozen=True, eq=False)
class ArcLength:
    """Control by the distance from a point along its tangent, in natural sizes."""

    begin: Point
    tangent: Tangent
    parameter_weight: float

    def __call__(self, x: Array, p: float) -> Row:
        """Return the distance and its derivatives."""
        begin, tangent = self.begin, self.tangent.packed
        row = np.append(begin.problem.weights, self.parameter_weight) ** 2 * tangent
        row /= row @ tangent
        value = float(row @ np.append(x - begin.x, p - begin.p))
        return Row(value, row[:-1], float(row[-1]), True)


@dataclass(frozen=True, eq=False)
class Segment:
    """Part of a curve between two points.

    Attributes
    ----------
    begin, end
        First and last point.
    control, values
        Control that changes monotonically along the curve, and its values at both points.
    begin_tangent, end_tangent
        Tangents at both points, with respect to the control; None to compute that at the end.
    """

    begin: Point
    end: Point
    control: Control
    values: tuple[float, float]
    begin_tangent: Tangent
    end_tangent: Tangent | None = None

    @property
    def reach(self) -> float:
        """Change of the control."""
        return self.values[1] - self.values[0]

    def at(self, position: float) -> Point:
        """Return the point at a position from 0 to 1.

        Raises
        ------
        CurveError
            If Newton's method fails.
        """
        begin, step = self.begin, self.end.minus(self.begin).scale(position)
        value = self.values[0] + position * self.reach
        return begin.problem.correct(self.control, value, begin.x + step.x, begin.p + step.p)

    def tangent_at(self, point: Point) -> Tangent:
        """Return the tangent at a point of the segment, with respect to the control."""
        if point is self.begin:
            return self.begin_tangent
        return self.tangent if point is self.end else self._tangent_at(point)

    @cached_property
    def tangent(self) -> Tangent:
        """Tangent at the end, with respect to the control.

        Raises
        ------
        CurveError
            If it is not unique.
        """
        return self.end_tangent or self._tangent_at(self.end)

    @property
    def direction(self) -> Tangent:
        """Tangent at the end, along the segment."""
        return self.tangent.scale(float(np.sign(self.reach)))

    def _tangent_at(self, point: Point) -> Tangent:
        return point.tangent(self.control(point.x, point.p))

    def part(self, begin: Point, end: Point, first: float, last: float) -> Segment:
        """Return the part between two points at the positions `first` and `last`."""
        low, high = (self.values[0] + x * self.reach for x in (first, last))
        return replace(self, begin=begin, end=end, values=(low, high), end_tangent=None)

    def end_at(self, share: float, critical: list[Any]) -> tuple[Segment, list[Any]]:
        """Return the part up to a position where the tangent may be singular.

        `critical` are the critical points of the whole; those of the part are returned, too.
        """
        d = REGULAR_DISTANCE
        points = {share + k * d: self.at(share + k * d) for k in (-2, -1, 1, 2)}
        before, after = points[share - d], points[share + d]
        found = [one for one in critical if one.position <= share + ROUNDING]
        is_after = any(one.position > share - d for one in found)
        end = replace(interpolate(points, share), beside=after if is_after else before)
        tangent = after.minus(before).scale(0.5 / (d * self.reach))
        return replace(self.part(self.begin, end, 0.0, share), end_tangent=tangent), found


def interpolate(points: dict[float, Point], position: float) -> Point:
    """Return the point at a position of the cubic through the four nearest points."""
    nearest = sorted(points, key=lambda x: abs(x - position))[:4]
    base = points[nearest[0]]
    changes = [points[x].minus(base).packed for x in nearest]
    change = weigh_nodes(nearest, position) @ changes
    return base.plus(Tangent(change[:-1], float(change[-1])))


def weigh_nodes(nodes: list[float], at: float) -> Array:
    """Return the weights of values at `nodes` in the polynomial through them, at a position."""
    return np.array([np.prod([(at - x) / (one - x) for x in nodes if x != one]) for one in nodes])


@dataclass(frozen=True)
class Steps:
    """Steps along a curve.

    Attributes
    ----------
    largest
        Largest step, in units of the control or, by arc length, of the unknowns in natural sizes.
    by_arc_length
        True to step by arc length, False to step by `control`.
    parameter_weight
        Weight of the parameter in arc lengths.
    parameter_step
        Largest change of the parameter in a step by arc length.
    first, smallest
        First and smallest step, relative to the largest one.
    """

    largest: float
    by_arc_length: bool = False
    parameter_weight: float = 0.0
    parameter_step: float = np.inf
    first: float = 1.0
    smallest: float = 1e-8


# Direction at the begin of a step, its change, and that of its control, 0 for arc length.
_Step = tuple[Array, Array, float]


def follow(
    begin: Point,
    control: Control,
    target: float,
    steps: Steps,
    explain: Callable[[Segment], list[Any]],
    tangent: Tangent | None = None,
) -> Iterator[tuple[Segment, list[Any]]]:
    """Yield segments from `begin` on until the control has the value `target`.

    Parameters
    ----------
    begin
        First point.
    control, target
        Where the curve ends.
    steps
        Size of steps.
    explain
        Function that returns the critical points of a segment, with a `position` from 0 to 1, and
        raises CurveError if what it monitors changes without them; the step is then shortened.
    tangent
        First direction; by default, that in which the control approaches the target.

    Raises
    ------
    CurveError
        If no step converges.
    """
    size, last = steps.first * steps.largest, None
    is_last = control(begin.x, begin.p).value == target
    while not is_last:
        problem, row, usual = begin.problem, control(begin.x, begin.p), steps.largest
        proposed, passes = size, False
        if tangent is None:
            tangent = begin.tangent(row).scale(np.sign(target - row.value))
        if steps.by_arc_length:
            tangent = tangent.scale(1.0 / _length(problem, tangent.packed, steps.parameter_weight))
            motion, change = problem.measure(tangent.x), abs(tangent.p)
            usual = min(
                steps.largest / motion if motion > 0.0 else np.inf,
                steps.parameter_step / change if change > 0.0 else np.inf,
            )
            size, usual = min(size, usual), min(usual, steps.largest)
        while True:
            is_corner, is_last = size <= _CORNER_STEP * usual, False
            try:
                trial, is_last = _plan_step(begin, control, row, target, steps, tangent, size)
                if passes:
                    values = trial.values[0], trial.values[0] + trial.reach / _TARGET
                    trial = replace(trial, values=values)
                segment, growth = _correct_step(trial, last, steps, is_corner)
                after = control(segment.end.x, segment.end.p).value
                if not is_last and (target - row.value) * (target - after) <= 0.0:
                    raise CurveError("the step passes the target")
                found = explain(segment)
                if passes:
                    segment, found = segment.end_at(_TARGET, found)
                break
            except CurveError:
                # A target where the tangent is singular is found between regular points.
                passes = is_last and not passes
                if not passes:
                    size, last = size * _CUT, None
                    if size < steps.smallest * usual:
                        raise
        taken = 0.0 if isinstance(trial.control, ArcLength) else abs(trial.reach)
        along = trial.begin_tangent.packed * np.sign(trial.reach)
        last = along, segment.end.minus(begin).packed, taken
        size = growth * (taken or size)
        # A step that is shortened to meet a target does not shorten the next step.
        size = max(size, proposed) if is_last else size
        size = size if steps.by_arc_length else min(size, steps.largest)
        begin, tangent = segment.end, segment.direction
        yield segment, found


def _plan_step(
    begin: Point,
    control: Control,
    row: Row,
    target: float,
    steps: Steps,
    tangent: Tangent,
    size: float,
) -> tuple[Segment, bool]:
    """Return a segment whose end is not known yet, and True if it ends at the target.

    `row` is the control at its begin. A step that would pass the target ends at it.
    """
    rate = float(row.x @ tangent.x) + row.p * tangent.p
    reach, moved = target - row.value, size * rate
    if not steps.by_arc_length:
        moved = float(np.copysign(size, reach))
    is_last = moved * reach > 0.0 and (1.0 + _REACH_ROUNDING) * abs(moved) >= abs(reach)
    if steps.by_arc_length and not is_last:
        arc = ArcLength(begin, tangent, steps.parameter_weight)
        return Segment(begin, begin, arc, (0.0, size), tangent), False
    if not is_last and abs(reach) < _SPLIT_RATIO * abs(moved):
        moved = 0.5 * reach  # the last step is not tiny
    if rate == 0.0:
        raise CurveError("the control has an extremum")
    values = row.value, target if is_last else row.value + moved
    return Segment(begin, begin, control, values, tangent.scale(1.0 / rate)), is_last


def _correct_step(
    trial: Segment, last: _Step | None, steps: Steps, is_corner: bool
) -> tuple[Segment, float]:
    """Return the segment of a planned step, and by which factor the next step may grow.

    Across a corner, such as the onset of a contact, the parameter may reverse: arc lengths are then
    those of the unknowns alone, and the curve may turn by any angle.

    Raises
    ------
    CurveError
        If Newton's method fails, or the tangent at one of the ends does not lead to the other one.
    """
    begin, problem, control = trial.begin, trial.begin.problem, trial.control
    change, weight = trial.begin_tangent.scale(trial.reach), steps.parameter_weight
    is_arc, cosine = isinstance(control, ArcLength), 1.0
    if isinstance(control, ArcLength) and is_corner and problem.measure(change.x) > 0.0:
        trial = replace(trial, control=replace(control, parameter_weight=0.0))
    reach = 0.0 if is_arc else abs(trial.reach)
    predicted = _extrapolate(problem, last, change.packed, reach, weight)
    x, p = begin.x + predicted[:-1], begin.p + float(predicted[-1])
    end = problem.correct(trial.control, trial.values[1], x, p)
    segment = replace(trial, end=end)
    # A step between two curves is not seen from one of its ends alone.
    returned = segment.tangent.scale(-trial.reach)
    moved, error = problem.measure(change.x), problem.measure(end.x - x)
    missed = problem.measure(end.x + returned.x - begin.x)
    if is_corner:
        # Seen from the softer side, a corner shortens the step.
        is_near = error <= moved + ROUNDING or missed <= problem.measure(returned.x) + ROUNDING
    else:
        is_near = max(error, missed) <= _MAX_ERROR * moved + ROUNDING
    if steps.by_arc_length:
        cosine = _cosine(problem, change.packed, segment.direction.packed, weight)
    if not is_near or (cosine < _MIN_COSINE and not is_corner):
        raise CurveError("the curve turns too sharply for the step")
    growth = np.sqrt((_AIMED_CORRECTION * moved + ROUNDING) / (error + NEGLIGIBLE))
    if is_arc and cosine < 1.0:
        growth = min(growth, _AIMED_ANGLE / np.arccos(cosine))
    return segment, float(np.clip(growth, _MIN_GROWTH, _MAX_GROWTH))


def _extrapolate(
    problem: Problem, last: _Step | None, straight: Array, reach: float, weight: float
) -> Array:
    """Return the change (n + 1,) of a step along a cubic polynomial through the last one.

    The polynomial over the control, or over the arc length if `reach` is 0, has the tangents and
    the chord of the last step. `straight` is the change along the tangent.
    """
    sizes = np.append(problem.weights, weight)
    if last is None:
        return straight
    (start, chord, before), slope = last, 1.0
    if reach == 0.0:
        # Lengths must be smooth functions.
        reach, slope, before = (float(np.linalg.norm(sizes * x)) for x in (straight, start, chord))
    if 0.0 in (reach, slope, before):
        return straight
    mean, unit, ratio = chord / before, straight / reach, reach / before
    # Newton's form of the polynomial, with both ends as double nodes.
    second = unit - mean
    bent = reach * ratio * (second + (1.0 + ratio) * (second - mean + start / slope))
    is_smooth = _length(problem, bent, weight) <= _MAX_CURVED * _length(problem, straight, weight)
    return straight + bent if is_smooth else straight


def switch(
    branch: Point, mode: Array, along: Tangent, side: float, steps: Steps
) -> tuple[Point, Tangent]:
    """Return the first point of the curve that crosses at a branch point, and its tangent.

    Parameters
    ----------
    branch
        Branch point.
    mode
        Direction in which the Jacobian is singular there.
    along
        Tangent of the curve on which it was found.
    side
        1 or -1, the direction along the crossing curve.
    steps
        Size of steps.

    Raises
    ------
    CurveError
        If no point is found.
    """
    problem, weight = branch.problem, steps.parameter_weight
    # Both curves are tangent to the plane of the mode and the response to the parameter.
    row = problem.weights**2 * mode
    response = branch.bordered(row, row, 0.0).solve(
        np.append(-branch.linearization.by_parameter, 0.0)
    )
    plane = np.array([np.append(mode, 0.0), np.append(response[:-1], 1.0)])
    metric = np.append(problem.weights, weight) ** 2
    known = along.packed
    parts = plane - np.outer(plane @ (metric * known) / (known @ (metric * known)), known)
    shares = (parts**2 @ metric) / (plane**2 @ metric)
    part = side * parts[np.argmax(shares)]
    part = part / _length(problem, part, weight)
    tangent = Tangent(part[:-1], float(part[-1]))
    control, size = ArcLength(branch, tangent, weight), 0.5 * steps.largest
    while True:
        try:
            step = tangent.scale(size)
            first = problem.correct(control, size, branch.x + step.x, branch.p + step.p)
            after = first.tangent(control(first.x, first.p))
            if _cosine(problem, first.minus(branch).packed, after.packed, weight) < _MIN_COSINE:
                raise CurveError("the curve turns too sharply for the step")
            return first, after
        except CurveError as error:
            size *= _CUT
            if size < steps.smallest * steps.largest:
                raise CurveError(
                    f"no crossing path was found at the branch point: {error}"
                ) from None


def _length(problem: Problem, change: Array, weight: float) -> float:
    """Return the length of a change of (x, p)."""
    return max(problem.measure(change[:-1]), weight * abs(float(change[-1])))


def _cosine(problem: Problem, one: Array, other: Array, weight: float) -> float:
    """Return the cosine of the angle between two changes of (x, p)."""
    sizes = np.append(problem.weights, weight)
    one, other = sizes * one, sizes * other
    lengths = np.linalg.norm(one) * np.linalg.norm(other)
    return min(float(one @ other / lengths), 1.0) if lengths else 1.0
