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
    """Raised if a point or a step cannot be found; the message says why, without a period.

    `nearest` is the last linearization of a search for a point, or None.
    """

    nearest: Linearization | None = None


class Factors(Protocol):
    """Factors of a bordered matrix."""

    def solve(self, right: Array) -> Array:
        """Return the solution for a right-hand side (n + 1,)."""


class Linearization(Protocol):
    """Equations, linearized about a point.

    Attributes
    ----------
    residual, by_parameter
        Residual F and its derivative by the parameter, (n,) each.
    """

    @property
    def residual(self) -> Array:
        """See above."""

    @property
    def by_parameter(self) -> Array:
        """See above."""

    def bordered(self, column: Array, row: Array, corner: float) -> Factors:
        """Return the factors of [[J, column], [row, corner]], J the Jacobian by x.

        Raises
        ------
        CurveError
            If the matrix is singular or not finite.
        """


@dataclass(frozen=True, eq=False)
class SparseLinearization:
    """Linearization with a Jacobian (CSC), see `Linearization`."""

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
    def linearize(self, x: Array, p: float, last: Any = None) -> Linearization:
        """Return the equations, linearized about (x, p).

        `last` is the linearization of the last iteration, or None: a problem may keep its matrix.

        Raises
        ------
        CurveError
            If the equations cannot be evaluated.
        """

    @abstractmethod
    def monitor(self, point: Point) -> Any:
        """Return what must change continuously along a curve, such as its stability."""

    def move(self, x: Array, step: Array) -> Array:
        """Return the unknowns after a finite step."""
        return np.asarray(x + step)

    def difference(self, end: Array, begin: Array) -> Array:
        """Return the step that leads from `begin` to `end`."""
        return np.asarray(end - begin)

    def measure(self, step: Array) -> float:
        """Return the size of a step in natural sizes: by default, the largest change."""
        return float(np.max(np.abs(step * self.weights), initial=0.0))

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
            code = judge(corrections, size, self.is_solved(linear, size, corrections.last))
            if code == DONE:
                return self.complete(Point(self, x, p, linear, corrections.count), step)
            if code != CORRECTED:
                error = CurveError(FAILURES[code])
                error.nearest = linear
                raise error
            x, p, linear = self._move_along(x, p, corrections.share * step, linear)

    def _move_along(
        self, x: Array, p: float, step: Array, linear: Linearization
    ) -> tuple[Array, float, Linearization]:
        """Return the point after a correction, halved until the equations can be evaluated."""
        for k in range(_MAX_HALVINGS + 1):
            moved = self.move(x, step[:-1]), p + float(step[-1])
            try:
                return *moved, self.linearize(*moved, linear)
            except CurveError as error:
                if k == _MAX_HALVINGS:
                    error.nearest = linear
                    raise
                step = 0.5 * step
        raise AssertionError

    def find_tangent(self, point: Point, row: Row) -> Tangent:
        """Return the tangent at a solution along which the control with this row increases by 1."""
        factors = point.bordered(point.linearization.by_parameter, row.x, row.p)
        solution = factors.solve(np.append(np.zeros(len(point.x)), 1.0))
        return Tangent(solution[:-1], float(solution[-1]))

    def is_solved(self, linear: Any, size: float, last: float) -> bool:
        """Return True if a point is a solution after its correction.

        `size` and `last` are the sizes of this and of the previous correction in natural sizes.
        """
        return is_negligible(size, last)

    def complete(self, point: Point, step: Array) -> Point:
        """Return a solution, given the point before its last correction `step` of (x, p)."""
        x, p = self.move(point.x, step[:-1]), point.p + float(step[-1])
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
    linearization: Linearization
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
            x, p = self.problem.move(self.x, move.x), self.p + move.p
            point = Point(self.problem, x, p, self.problem.linearize(x, p))
            self._neighbor.append((move, point.monitor))
        return self._neighbor[0]

    def bordered(self, column: Array, row: Array, corner: float) -> Factors:
        """Return the factors of the Jacobian, bordered by a column and a row."""
        return self.linearization.bordered(column, row, corner)

    def distance(self, other: Point) -> float:
        """Return the distance of another point, in natural sizes."""
        return self.problem.measure(self.problem.difference(other.x, self.x))

    def between(self, other: Point, share: float) -> tuple[Array, float]:
        """Return x and p between this point (0) and another one (1)."""
        step = self.problem.difference(other.x, self.x)
        return self.problem.move(self.x, share * step), self.p + share * (other.p - self.p)

    def tangent(self, row: Row) -> Tangent:
        """Return the tangent along which the control with this row increases by 1."""
        tangent = self.problem.find_tangent(self, row)
        if not np.isfinite(np.append(tangent.x, tangent.p)).all():
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
        weights = self.begin.problem.weights**2
        row = weights * self.tangent.x
        by_parameter = self.parameter_weight**2 * self.tangent.p
        step = self.begin.problem.difference(x, self.begin.x)
        value = float(row @ step) + by_parameter * (p - self.begin.p)
        size = float(row @ self.tangent.x) + by_parameter * self.tangent.p
        return Row(value / size, row / size, by_parameter / size, True)


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

    def at(self, position: float) -> Point:
        """Return the point at a position from 0 to 1.

        Raises
        ------
        CurveError
            If Newton's method fails.
        """
        x, p = self.begin.between(self.end, position)
        value = self.values[0] + position * (self.values[1] - self.values[0])
        return self.begin.problem.correct(self.control, value, x, p)

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
        return self.tangent.scale(float(np.sign(self.values[1] - self.values[0])))

    def _tangent_at(self, point: Point) -> Tangent:
        return point.tangent(self.control(point.x, point.p))

    def part(self, begin: Point, end: Point, first: float, last: float) -> Segment:
        """Return the part between two points at the positions `first` and `last`."""
        begin_value, end_value = self.values
        low, high = (begin_value + x * (end_value - begin_value) for x in (first, last))
        return replace(self, begin=begin, end=end, values=(low, high), end_tangent=None)

    def end_between(self, share: float, critical: list[Any]) -> tuple[Segment, list[Any]]:
        """Return the part up to a position where the tangent may be singular.

        `critical` are the critical points of the whole; those of the part are returned, too.
        """
        (first, last), d = self.values, REGULAR_DISTANCE
        points = {share + k * d: self.at(share + k * d) for k in (-2, -1, 1, 2)}
        before, after = points[share - d], points[share + d]
        change = self.begin.problem.difference(after.x, before.x)
        tangent = Tangent(change, after.p - before.p).scale(0.5 / (d * (last - first)))
        found = [one for one in critical if one.position <= share + ROUNDING]
        is_after = any(one.position > share - d for one in found)
        end = replace(interpolate(points, share), beside=after if is_after else before)
        part = self.part(self.begin, end, 0.0, share)
        return replace(part, end_tangent=tangent), found


def interpolate(points: dict[float, Point], position: float) -> Point:
    """Return the point at a position of the cubic through the four nearest points."""
    nearest = sorted(points, key=lambda x: abs(x - position))[:4]
    base = points[nearest[0]]
    problem, step, p = base.problem, np.zeros_like(base.x), 0.0
    for one in nearest:
        weight = float(np.prod([(position - x) / (one - x) for x in nearest if x != one]))
        step += weight * problem.difference(points[one].x, base.x)
        p += weight * points[one].p
    x = problem.move(base.x, step)
    return Point(problem, x, p, problem.linearize(x, p))


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
        raises CurveError if what it
        monitors changes without them; the step is then shortened.
    tangent
        First direction; by default, that in which the control approaches the target.

    Raises
    ------
    CurveError
        If no step converges.
    """
    has_arrived = control(begin.x, begin.p).value == target
    progress = _Progress(begin, tangent, steps.first * steps.largest, None, has_arrived)
    while not progress.has_arrived:
        segment, found, progress = _take_step(progress, control, target, steps, explain)
        yield segment, found


class _LastStep(NamedTuple):
    """Direction at the begin of a step, its change, and that of its control; 0 for arc length."""

    direction: Tangent
    chord: Tangent
    size: float


@dataclass(frozen=True, eq=False)
class _Progress:
    """Begin of the next step.

    Attributes
    ----------
    begin
        Point at which it begins.
    tangent
        Direction there; None for that in which the control approaches the target.
    size
        Proposed size of the step.
    last
        The last step, or None.
    has_arrived
        True if the curve has reached its target.
    """

    begin: Point
    tangent: Tangent | None
    size: float
    last: _LastStep | None = None
    has_arrived: bool = False


class _Trial(NamedTuple):
    """Trial step.

    Attributes
    ----------
    control, values
        Control that increases along it, and its values at both ends.
    unit
        Tangent at its begin, with respect to the control.
    is_last
        True if it ends at the target.
    """

    control: Control
    values: tuple[float, float]
    unit: Tangent
    is_last: bool

    @property
    def is_arc(self) -> bool:
        """True for a step by arc length."""
        return isinstance(self.control, ArcLength)

    @property
    def reach(self) -> float:
        """Size of the change of the control."""
        return abs(self.values[1] - self.values[0])

    @property
    def direction(self) -> Tangent:
        """Tangent along the step."""
        return self.unit.scale(float(np.sign(self.values[1] - self.values[0])))

    def pass_target(self) -> _Trial:
        """Return the step whose position `_TARGET` is its end."""
        first, last = self.values
        return self._replace(values=(first, first + (last - first) / _TARGET))

    @property
    def change(self) -> Tangent:
        """Change along the tangent."""
        return self.unit.scale(self.values[1] - self.values[0])


def _take_step(
    progress: _Progress,
    control: Control,
    target: float,
    steps: Steps,
    explain: Callable[[Segment], list[Any]],
) -> tuple[Segment, list[Any], _Progress]:
    """Return the segment of the next step, its critical points, and the progress after it."""
    begin, size, tangent, last = progress.begin, progress.size, progress.tangent, progress.last
    problem, weight, row = begin.problem, steps.parameter_weight, control(begin.x, begin.p)
    if tangent is None:
        tangent = begin.tangent(row).scale(np.sign(target - row.value))
    usual = steps.largest
    if steps.by_arc_length:
        tangent = tangent.scale(1.0 / _length(problem, tangent, weight))
        usual = _limit_arc(problem, tangent, steps)
        size, usual = min(size, usual), min(usual, steps.largest)
    passes = False
    while True:
        is_corner, trial = size <= _CORNER_STEP * usual, None
        try:
            trial = _try(begin, control, row, target, steps, tangent, size, is_corner)
            trial = trial.pass_target() if passes else trial
            curved = _extrapolate(problem, last, trial, weight)
            segment, error = _correct_trial(begin, trial, curved, is_corner)
            cosine = 1.0
            if steps.by_arc_length:
                cosine = _cosine(problem, tangent, segment.direction, weight)
                _require_near(control, target, trial, segment, 1.0 if is_corner else cosine)
            found = explain(segment)
            if passes:
                segment, found = segment.end_between(_TARGET, found)
            break
        except CurveError:
            passes = trial is not None and trial.is_last and not passes
            if passes:
                # A target where the tangent is singular is found between regular points.
                continue
            size, last = size * _CUT, None
            if size < steps.smallest * usual:
                raise
    grown = _propose_size(problem, trial, size, error, cosine)
    # A step that is shortened to meet a target does not shorten the next step.
    grown = max(grown, progress.size) if trial.is_last else grown
    grown = grown if steps.by_arc_length else min(grown, steps.largest)
    end = segment.end
    chord = Tangent(problem.difference(end.x, begin.x), end.p - begin.p)
    done = _LastStep(trial.direction, chord, 0.0 if trial.is_arc else trial.reach)
    return segment, found, _Progress(end, segment.direction, grown, done, trial.is_last)


def _propose_size(
    problem: Problem, trial: _Trial, size: float, error: float, cosine: float
) -> float:
    """Return the size of the next step, from the correction and the change of angle of this one."""
    aimed = _AIMED_CORRECTION * problem.measure(trial.change.x) + ROUNDING
    growth = np.sqrt(aimed / (error + NEGLIGIBLE))
    if trial.is_arc:
        growth = min(growth, _AIMED_ANGLE / np.arccos(cosine)) if cosine < 1.0 else growth
    taken = size if trial.is_arc else trial.reach
    return taken * float(np.clip(growth, _MIN_GROWTH, _MAX_GROWTH))


def _limit_arc(problem: Problem, unit: Tangent, steps: Steps) -> float:
    """Return the largest permitted size of a step by arc length."""
    motion, change = problem.measure(unit.x), abs(unit.p)
    by_motion = steps.largest / motion if motion > 0.0 else np.inf
    return min(by_motion, steps.parameter_step / change if change > 0.0 else np.inf)


def _try(
    begin: Point,
    control: Control,
    row: Row,
    target: float,
    steps: Steps,
    tangent: Tangent,
    size: float,
    is_corner: bool,
) -> _Trial:
    """Return a trial step, which ends at the target if it would pass it.

    `row` is the control at its begin.

    Across a corner, such as the onset of a contact, the parameter may reverse: arc lengths are then
    those of the unknowns alone.
    """
    rate = float(row.x @ tangent.x) + row.p * tangent.p
    reach, moved = target - row.value, size * rate
    if not steps.by_arc_length:
        moved = float(np.copysign(size, reach))
    is_last = moved * reach > 0.0 and (1.0 + _REACH_ROUNDING) * abs(moved) >= abs(reach)
    if steps.by_arc_length and not is_last:
        weight = steps.parameter_weight
        weight = 0.0 if is_corner and begin.problem.measure(tangent.x) > 0.0 else weight
        return _Trial(ArcLength(begin, tangent, weight), (0.0, size), tangent, False)
    if not is_last and abs(reach) < _SPLIT_RATIO * abs(moved):
        moved = 0.5 * reach  # the last step is not tiny
    if rate == 0.0:
        raise CurveError("the control has an extremum")
    end = target if is_last else row.value + moved
    return _Trial(control, (row.value, end), tangent.scale(1.0 / rate), is_last)


def _extrapolate(problem: Problem, last: _LastStep | None, trial: _Trial, weight: float) -> Tangent:
    """Return the change of a step along a cubic polynomial through the last one.

    The polynomial over the control, or over the arc length, has the tangents and the chord of the
    last step.
    """
    change = trial.change
    if last is None:
        return change
    start, chord, before = last
    length, unit = trial.reach, trial.direction
    if trial.is_arc:
        # Lengths must be smooth functions.
        length, slope, before = (_norm(problem, x, weight) for x in (change, start, chord))
        if 0.0 in (length, slope):
            return change
        unit, start = change.scale(1.0 / length), start.scale(1.0 / slope)
    if before == 0.0:
        return change
    mean, ratio = chord.scale(1.0 / before), length / before
    # Newton's form of the polynomial, with both ends as double nodes.
    second = unit.plus(mean, -1.0)
    third = second.plus(mean, -1.0).plus(start)
    bent = second.scale(ratio).plus(third, ratio * (1.0 + ratio)).scale(length)
    is_smooth = _length(problem, bent, weight) <= _MAX_CURVED * _length(problem, change, weight)
    return change.plus(bent) if is_smooth else change


def _correct_trial(
    begin: Point, trial: _Trial, predicted: Tangent, is_corner: bool
) -> tuple[Segment, float]:
    """Return the segment of a trial step and the size of its correction.

    Raises
    ------
    CurveError
        If Newton's method fails, or the tangent at one of the ends does not lead to the other one.
    """
    problem, (first, last) = begin.problem, trial.values
    x, p = problem.move(begin.x, predicted.x), begin.p + predicted.p
    end = problem.correct(trial.control, last, x, p)
    segment = Segment(begin, end, trial.control, trial.values, trial.unit)
    # A step between two curves is not seen from one of its ends alone.
    returned = segment.tangent.scale(first - last)
    back = problem.move(end.x, returned.x)
    moved, error = (problem.measure(y) for y in (trial.change.x, problem.difference(end.x, x)))
    missed = problem.measure(problem.difference(back, begin.x))
    if is_corner:
        # Seen from the softer side, a corner shortens the step.
        is_near = error <= moved + ROUNDING or missed <= problem.measure(returned.x) + ROUNDING
    else:
        is_near = max(error, missed) <= _MAX_ERROR * moved + ROUNDING
    if not is_near:
        raise CurveError("the curve turns too sharply for the step")
    return segment, error


def _require_near(
    control: Control, target: float, trial: _Trial, segment: Segment, cosine: float
) -> None:
    """Raise CurveError if a step by arc length turns too far or passes the target."""
    if cosine < _MIN_COSINE:
        raise CurveError("the curve turns too sharply for the step")
    ends = (control(point.x, point.p).value for point in (segment.begin, segment.end))
    before, after = (target - value for value in ends)
    if not trial.is_last and before * after <= 0.0:
        raise CurveError("the step passes the target")


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
    factors = branch.bordered(row, row, 0.0)
    response = factors.solve(np.append(-branch.linearization.by_parameter, 0.0))[:-1]
    plane = (Tangent(mode, 0.0), Tangent(response, 1.0))
    parts = [_remove(problem, x, along, weight) for x in plane]
    shares = [
        _inner(problem, part, part, weight) / _inner(problem, x, x, weight)
        for part, x in zip(parts, plane, strict=True)
    ]
    tangent = parts[int(np.argmax(shares))].scale(side)
    tangent = tangent.scale(1.0 / _length(problem, tangent, weight))
    size = 0.5 * steps.largest
    while True:
        try:
            x, p = problem.move(branch.x, size * tangent.x), branch.p + size * tangent.p
            control = ArcLength(branch, tangent, weight)
            first = problem.correct(control, size, x, p)
            step = Tangent(problem.difference(first.x, branch.x), first.p - branch.p)
            row = control(first.x, first.p)
            after = first.tangent(row)
            if _cosine(problem, step, after, weight) < _MIN_COSINE:
                raise CurveError("the curve turns too sharply for the step")
            return first, after
        except CurveError as error:
            size *= _CUT
            if size < steps.smallest * steps.largest:
                raise CurveError(
                    f"no crossing path was found at the branch point: {error}"
                ) from None


def _length(problem: Problem, change: Tangent, weight: float) -> float:
    return max(problem.measure(change.x), weight * abs(change.p))


def _norm(problem: Problem, change: Tangent, weight: float) -> float:
    return float(np.sqrt(_inner(problem, change, change, weight)))


def _inner(problem: Problem, one: Tangent, other: Tangent, weight: float) -> float:
    product = (one.x * problem.weights) @ (other.x * problem.weights)
    return float(product) + weight**2 * one.p * other.p


def _cosine(problem: Problem, one: Tangent, other: Tangent, weight: float) -> float:
    lengths = _norm(problem, one, weight) * _norm(problem, other, weight)
    return min(_inner(problem, one, other, weight) / lengths, 1.0) if lengths else 1.0


def _remove(problem: Problem, one: Tangent, other: Tangent, weight: float) -> Tangent:
    """Return the part of a direction that is orthogonal to another one."""
    share = _inner(problem, one, other, weight) / _inner(problem, other, other, weight)
    return Tangent(one.x - share * other.x, one.p - share * other.p)
