"""Curves of solutions of F(x, p) = 0, followed by predictor and corrector steps.

Newton's method solves the equations together with one further row, which prescribes the parameter,
a function of the solution, or the arc length (H. B. Keller, 1977): the bordered matrix is regular
at limit points. One norm, the largest change of a coordinate in natural sizes, measures all steps.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from beamdae.core.return_codes import CORRECTED, DIVERGED, DONE, NOT_CONVERGED, NOT_FINITE
from beamdae.core.tables import Loop

Array = np.ndarray

# Corrections up to this size, in natural sizes, may be rounding errors of solutions.
ROUNDING = 1e-7
# Larger errors of solutions show that a matrix is singular. Those of stiff beams reach 1e-7.
_MAX_ERROR_OF_SOLUTIONS = 1e-6
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


FAILURES = {
    NOT_CONVERGED: "Newton's method did not converge",
    NOT_FINITE: "the equations are not finite at the next point",
    DIVERGED: "Newton's method diverges",
}


class CurveError(Exception):
    """Raised if a point or a step cannot be found; the message says why, without a period."""


@dataclass(slots=True)
class Corrections:
    """Corrections of Newton's method, see `judge_correction` in `statics.c`.

    Attributes
    ----------
    count
        Number of corrections.
    is_solved
        1 or 0 if the equations tell whether the point is a solution after the last one; -1 if its
        size does.
    size, last, earlier
        Sizes of the last three, in natural sizes.
    share, bound
        Share of the last one by which the point moves, and bound of this motion.
    """

    count: int = 0
    is_solved: int = -1
    size: float = np.inf
    last: float = np.inf
    earlier: float = np.inf
    share: float = 1.0
    bound: float = 0.5

    def restart(self) -> None:
        """Forget all corrections."""
        self.__init__()  # type: ignore[misc]


class RefinedFactors(NamedTuple):
    """Matrix in units `sizes` of the unknowns, and its factors."""

    matrix: sp.csc_array
    factors: SuperLU
    sizes: Array | float = 1.0

    def solve(self, right: Array, transposition: str = "N") -> Array:
        """Return the solution for a right-hand side, or that of the transposed matrix ("T").

        It is refined once: small changes of tests for critical points count more than the accuracy
        of a correction.
        """
        matrix = self.matrix if transposition == "N" else self.matrix.T
        scaled = self.sizes * right
        solution = self.factors.solve(scaled, transposition)
        solution += self.factors.solve(scaled - matrix @ solution, transposition)
        return np.asarray(self.sizes * solution)

    @property
    def is_regular(self) -> bool:
        """True if solutions are accurate, unlike those of matrices that rounding made regular."""
        expected = np.ones(self.matrix.shape[0])
        error = self.factors.solve(self.matrix @ expected) - expected
        return bool(np.max(np.abs(error)) <= _MAX_ERROR_OF_SOLUTIONS)


@dataclass(frozen=True, eq=False)
class Linearization:
    """Equations, linearized about a point.

    Attributes
    ----------
    residual, by_parameter
        F and its derivative by the parameter, (n,).
    jacobian
        Jacobian by x in units `sizes` of the unknowns.
    sizes
        Units of the unknowns, (n,) or a number.
    """

    residual: Array
    by_parameter: Array
    jacobian: sp.csc_array
    sizes: Array | float = 1.0

    def bordered(self, column: Array, row: Array, corner: float) -> Any:
        """Return the factors of [[J, column], [row, corner]], with a method `solve(right)`.

        Several columns and rows, (n, k) each, have corners of zero.

        Raises
        ------
        CurveError
            If the matrix is singular or not finite.
        """
        column, row = ((x.T * self.sizes).T for x in (column, row))
        scaled = factorize_bordered(self.jacobian, column, row, corner)
        ones = np.ones(scaled.matrix.shape[0] - len(row))
        return scaled._replace(sizes=np.append(np.broadcast_to(self.sizes, len(row)), ones))


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
        """Return the equations, linearized about (x, p), like `Linearization`.

        `last` is the linearization of the last iteration, or None: a problem may keep its matrix.

        Raises
        ------
        CurveError
            If the equations cannot be evaluated.
        """

    @abstractmethod
    def monitor(self, point: Point) -> Any:
        """Return what must change continuously along a curve, such as its stability."""

    def determinant(self, x: Array, p: float) -> Any:
        """Return the determinant of a monitor that contains one, between points of a curve."""
        raise NotImplementedError

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
        judge = Loop("judge_correction", corrections)
        while True:
            row = control(x, p)
            factors = linear.bordered(linear.by_parameter, row.gradient[:-1], row.gradient[-1])
            step = factors.solve(-np.append(linear.residual, row.value - target))
            corrections.size = size = self.measure(step[:-1])
            corrections.is_solved = self.is_solved(linear, step, size, corrections.last)
            code = judge()
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

    def is_solved(self, linear: Any, step: Array, size: float, last: float) -> int:
        """Return 1 if a point is a solution after its correction `step`, 0 if not, -1 by its size.

        `size` and `last` are the sizes of this and of the previous correction in natural sizes.
        """
        return -1

    def complete(self, point: Point, step: Array) -> Point:
        """Return a solution, given the point before its last correction `step` of (x, p)."""
        x, p = point.x + step[:-1], point.p + float(step[-1])
        return replace(point, x=x, p=p, linearization=self.linearize(x, p))


class Row(NamedTuple):
    """Value of a control at a point, and its derivatives by (x, p), (n + 1,).

    `is_linear` is True if the derivatives are the same everywhere.
    """

    value: float
    gradient: Array
    is_linear: bool = False


Control = Callable[[Array, float], Row]


@dataclass(frozen=True, eq=False)
class Point:
    """Solution of a problem, with its linearization.

    `beside` is a point beside a singular one, whose monitor is not a matter of rounding;
    `known_tangent` the gradient of a control and the tangent along which it increases by 1.
    """

    problem: Any
    x: Array
    p: float
    linearization: Any
    iterations: int = 0
    beside: Point | None = None
    known_tangent: tuple[Array, Array] | None = None

    @cached_property
    def monitor(self) -> Any:
        """What must change continuously along curves, see `Problem.monitor`."""
        return self.beside.monitor if self.beside else self.problem.monitor(self)

    def plus(self, move: Array) -> Point:
        """Return the point after a change (n + 1,) of (x, p) that keeps it on the curve."""
        x, p = self.x + move[:-1], self.p + float(move[-1])
        return Point(self.problem, x, p, self.problem.linearize(x, p))

    def minus(self, other: Point) -> Array:
        """Return the change (n + 1,) of (x, p) from another point to this one."""
        return np.append(self.x - other.x, self.p - other.p)

    def bordered(self, column: Array, row: Array, corner: float = 0.0) -> Any:
        """Return the factors of the Jacobian, bordered by a column and a row."""
        return self.linearization.bordered(column, row, corner)

    def tangent(self, control: Control) -> Array:
        """Return the tangent (n + 1,) along which the control increases by 1."""
        gradient = control(self.x, self.p).gradient
        if self.known_tangent and np.array_equal(self.known_tangent[0], gradient):
            tangent = self.known_tangent[1]
        else:
            factors = self.bordered(self.linearization.by_parameter, gradient[:-1], gradient[-1])
            tangent = np.asarray(factors.solve(_last_unit(len(gradient))))
        if not np.isfinite(tangent).all():
            raise CurveError("the tangent is not unique")
        return tangent


def factorize_bordered(
    jacobian: sp.csc_array, column: Array, row: Array, corner: float = 0.0
) -> RefinedFactors:
    """Return the factors of [[J, column], [row, corner]]; see `Linearization.bordered`.

    Raises
    ------
    CurveError
        If the matrix is singular or not finite.
    """
    matrix = jacobian
    for left, below in zip(np.atleast_2d(column.T), np.atleast_2d(row.T), strict=True):
        added = np.zeros(matrix.shape[0] - len(row))
        matrix = _add_border(matrix, np.append(left, added), np.append(below, added), corner)
    if not np.isfinite(matrix.data).all():
        raise CurveError("the equations are not finite")
    try:
        return RefinedFactors(matrix, splu(matrix))
    except RuntimeError:
        raise CurveError("the tangent is singular") from None


def _add_border(matrix: sp.csc_array, column: Array, row: Array, corner: float) -> sp.csc_array:
    n, starts = len(row), matrix.indptr
    entries = np.concatenate([np.insert(matrix.data, starts[1:], row), column, [corner]])
    rows = np.append(np.insert(matrix.indices, starts[1:], n), np.arange(n + 1))
    return sp.csc_array((entries, rows, np.append(starts + np.arange(n + 1), len(entries))))


def prescribe_parameter(x: Array, p: float) -> Row:
    """Control by the parameter."""
    return Row(p, _last_unit(len(x) + 1), True)


@lru_cache(maxsize=8)
def _last_unit(size: int) -> Array:
    unit = np.zeros(size)
    unit[-1] = 1.0
    unit.flags.writeable = False
    return unit


@dataclass(frozen=True, eq=False)
class ArcLength:
    """Control by the distance from a point along its tangent, in units 1 / `weights`."""

    begin: Point
    tangent: Array
    weights: Array

    @cached_property
    def gradient(self) -> Array:
        """Derivatives of the distance, (n + 1,)."""
        row = self.weights**2 * self.tangent
        return np.asarray(row / (row @ self.tangent))

    def __call__(self, x: Array, p: float) -> Row:
        """Return the distance and its derivatives."""
        begin, row = self.begin, self.gradient
        return Row(float(row[:-1] @ (x - begin.x) + row[-1] * (p - begin.p)), row, True)


@dataclass(frozen=True, eq=False)
class Segment:
    """Part of a curve between two points.

    Attributes
    ----------
    begin, end
        First and last point.
    control, values
        Control that changes monotonically along the curve, and its values at both points.
    begin_tangent
        Tangent (n + 1,) at the first point, with respect to the control.
    """

    begin: Point
    end: Point
    control: Control
    values: tuple[float, float]
    begin_tangent: Array

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
        begin, step = self.begin, position * self.end.minus(self.begin)
        value, p = self.values[0] + position * self.reach, begin.p + float(step[-1])
        return begin.problem.correct(self.control, value, begin.x + step[:-1], p)

    def tangent_at(self, point: Point) -> Array:
        """Return the tangent at a point of the segment, with respect to the control."""
        if point is self.begin:
            return self.begin_tangent
        return self.tangent if point is self.end else point.tangent(self.control)

    @cached_property
    def tangent(self) -> Array:
        """Tangent at the end, with respect to the control.

        Raises
        ------
        CurveError
            If it is not unique.
        """
        return self.end.tangent(self.control)

    @property
    def direction(self) -> Array:
        """Tangent at the end, along the segment."""
        return self.tangent * np.sign(self.reach)

    def part(self, begin: Point, end: Point, first: float, last: float) -> Segment:
        """Return the part between two points at the positions `first` and `last`."""
        low, high = (self.values[0] + x * self.reach for x in (first, last))
        return replace(self, begin=begin, end=end, values=(low, high))

    def end_at(self, share: float, critical: list[Any]) -> tuple[Segment, list[Any]]:
        """Return the part up to a position where the tangent may be singular.

        `critical` are the critical points of the whole; those of the part are returned, too.
        """
        d = REGULAR_DISTANCE
        points = {share + k * d: self.at(share + k * d) for k in (-2, -1, 1, 2)}
        before, after = points[share - d], points[share + d]
        found = [one for one in critical if one.position <= share + ROUNDING]
        is_after = any(one.position > share - d for one in found)
        end = interpolate(points, share)
        tangent = after.minus(before) * (0.5 / (d * self.reach))
        known = self.control(end.x, end.p).gradient, tangent
        end = replace(end, beside=after if is_after else before, known_tangent=known)
        return self.part(self.begin, end, 0.0, share), found


def interpolate(points: dict[float, Point], position: float) -> Point:
    """Return the point at a position of the cubic through the four nearest points."""
    nearest = sorted(points, key=lambda x: abs(x - position))[:4]
    base = points[nearest[0]]
    return base.plus(weigh_nodes(nearest, position) @ [points[x].minus(base) for x in nearest])


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
    tangent: Array | None = None,
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
        weights = np.append(problem.weights, steps.parameter_weight)
        proposed, passes = size, False
        if tangent is None:
            tangent = begin.tangent(control) * np.sign(target - row.value)
        if steps.by_arc_length:
            tangent = tangent / _length(problem, weights, tangent)
            motion, change = problem.measure(tangent[:-1]), abs(float(tangent[-1]))
            usual = min(
                steps.largest / motion if motion > 0.0 else np.inf,
                steps.parameter_step / change if change > 0.0 else np.inf,
            )
            size, usual = min(size, usual), min(usual, steps.largest)
        while True:
            is_corner, is_last = size <= _CORNER_STEP * usual, False
            try:
                arc = ArcLength(begin, tangent, weights) if steps.by_arc_length else None
                trial, is_last = _plan_step(begin, control, row, target, arc, tangent, size)
                if passes:
                    values = trial.values[0], trial.values[0] + trial.reach / _TARGET
                    trial = replace(trial, values=values)
                segment, growth = _correct_step(trial, last, arc, weights, is_corner)
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
        taken = 0.0 if isinstance(segment.control, ArcLength) else abs(segment.reach)
        along = segment.begin_tangent * np.sign(segment.reach)
        last = along, segment.end.minus(begin), taken
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
    arc: ArcLength | None,
    tangent: Array,
    size: float,
) -> tuple[Segment, bool]:
    """Return a segment whose end is not known yet, and True if it ends at the target.

    `row` is the control at its begin, `arc` that of steps by arc length. A step that would pass the
    target ends at it.
    """
    rate = float(row.gradient @ tangent)
    reach = target - row.value
    moved = size * rate if arc else float(np.copysign(size, reach))
    is_last = moved * reach > 0.0 and (1.0 + _REACH_ROUNDING) * abs(moved) >= abs(reach)
    if arc and not is_last:
        return Segment(begin, begin, arc, (0.0, size), tangent), False
    if not is_last and abs(reach) < _SPLIT_RATIO * abs(moved):
        moved = 0.5 * reach  # the last step is not tiny
    if rate == 0.0:
        raise CurveError("the control has an extremum")
    values = row.value, target if is_last else row.value + moved
    return Segment(begin, begin, control, values, tangent / rate), is_last


def _correct_step(
    trial: Segment, last: _Step | None, arc: ArcLength | None, weights: Array, is_corner: bool
) -> tuple[Segment, float]:
    """Return the segment of a planned step, and by which factor the next step may grow.

    Across a corner, such as the onset of a contact, the parameter may reverse: arc lengths are then
    those of the unknowns alone, and the curve may turn by any angle.

    Raises
    ------
    CurveError
        If Newton's method fails, or the tangent at one of the ends does not lead to the other one.
    """
    begin, problem, is_arc = trial.begin, trial.begin.problem, trial.control is arc
    change, cosine = trial.reach * trial.begin_tangent, 1.0
    moved = problem.measure(change[:-1])
    if arc and is_arc and is_corner and moved > 0.0:
        trial = replace(trial, control=replace(arc, weights=np.append(weights[:-1], 0.0)))
    reach = 0.0 if is_arc else abs(trial.reach)
    predicted = _extrapolate(problem, weights, last, change, reach)
    x, p = begin.x + predicted[:-1], begin.p + float(predicted[-1])
    end = problem.correct(trial.control, trial.values[1], x, p)
    segment = replace(trial, end=end)
    # A step between two curves is not seen from one of its ends alone.
    returned, error = -trial.reach * segment.tangent[:-1], problem.measure(end.x - x)
    missed = problem.measure(end.x + returned - begin.x)
    if is_corner:
        # Seen from the softer side, a corner shortens the step.
        is_near = error <= moved + ROUNDING or missed <= problem.measure(returned) + ROUNDING
    else:
        is_near = max(error, missed) <= _MAX_ERROR * moved + ROUNDING
    if arc:
        cosine = _cosine(weights, change, segment.direction)
    if not is_near or (cosine < _MIN_COSINE and not is_corner):
        raise CurveError("the curve turns too sharply for the step")
    growth = np.sqrt((_AIMED_CORRECTION * moved + ROUNDING) / (error + np.finfo(float).eps))
    if is_arc and cosine < 1.0:
        growth = min(growth, _AIMED_ANGLE / np.arccos(cosine))
    return segment, float(np.clip(growth, _MIN_GROWTH, _MAX_GROWTH))


def _extrapolate(
    problem: Problem, weights: Array, last: _Step | None, straight: Array, reach: float
) -> Array:
    """Return the change (n + 1,) of a step along a cubic polynomial through the last one.

    The polynomial over the control, or over the arc length if `reach` is 0, has the tangents and
    the chord of the last step. `straight` is the change along the tangent.
    """
    if last is None:
        return straight
    (start, chord, before), slope = last, 1.0
    if reach == 0.0:
        # Lengths must be smooth functions.
        reach, slope, before = (
            float(np.linalg.norm(weights * x)) for x in (straight, start, chord)
        )
    if 0.0 in (reach, slope, before):
        return straight
    mean, unit, ratio = chord / before, straight / reach, reach / before
    # Newton's form of the polynomial, with both ends as double nodes.
    second = unit - mean
    bent = reach * ratio * (second + (1.0 + ratio) * (second - mean + start / slope))
    is_smooth = _length(problem, weights, bent) <= _MAX_CURVED * _length(problem, weights, straight)
    return straight + bent if is_smooth else straight


def switch(
    branch: Point, mode: Array, along: Array, side: float, steps: Steps
) -> tuple[Point, Array]:
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
    problem, weights = branch.problem, np.append(branch.problem.weights, steps.parameter_weight)
    # Both curves are tangent to the plane of the mode and the response to the parameter.
    row, load = weights[:-1] ** 2 * mode, branch.linearization.by_parameter
    response = branch.bordered(row, row).solve(np.append(-load, 0.0))
    plane = np.array([np.append(mode, 0.0), np.append(response[:-1], 1.0)])
    metric = weights**2
    parts = plane - np.outer(plane @ (metric * along) / (along @ (metric * along)), along)
    shares = (parts**2 @ metric) / (plane**2 @ metric)
    tangent = side * parts[np.argmax(shares)]
    tangent /= _length(problem, weights, tangent)
    control, size = ArcLength(branch, tangent, weights), 0.5 * steps.largest
    while True:
        try:
            at = branch.x + size * tangent[:-1], branch.p + size * float(tangent[-1])
            first = problem.correct(control, size, *at)
            after = first.tangent(control)
            if _cosine(weights, first.minus(branch), after) < _MIN_COSINE:
                raise CurveError("the curve turns too sharply for the step")
            return first, after
        except CurveError as error:
            size *= _CUT
            if size < steps.smallest * steps.largest:
                raise CurveError(
                    f"no crossing path was found at the branch point: {error}"
                ) from None


def _length(problem: Problem, weights: Array, change: Array) -> float:
    """Return the length of a change of (x, p)."""
    return max(problem.measure(change[:-1]), float(weights[-1]) * abs(float(change[-1])))


def _cosine(weights: Array, one: Array, other: Array) -> float:
    """Return the cosine of the angle between two changes of (x, p)."""
    one, other = weights * one, weights * other
    lengths = np.linalg.norm(one) * np.linalg.norm(other)
    return min(float(one @ other / lengths), 1.0) if lengths else 1.0
