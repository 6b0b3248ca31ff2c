"""Curves of solutions of F(x, p) = 0, followed by predictor and corrector steps.

Newton's method solves the equations together with one further row, which prescribes the parameter,
a function of the solution, or the arc length (H. B. Keller, 1977): the bordered matrix is regular
at limit points. One norm, the largest change of a coordinate in natural sizes, measures all steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

Array = np.ndarray

_MAX_ITERATIONS = 12
# Corrections below this size, in natural sizes, are rounding errors of solutions.
_TOLERANCE = 1e-10
# If corrections stop decreasing, they are rounding errors up to this size.
_ROUNDING = 1e-7
# The next correction is predicted if the last but one is below the first number, and need not be
# made if it is below the second one.
_QUADRATIC, _NEGLIGIBLE = 1e-3, 1e-15
# Largest correction of one iteration, in natural sizes: farther, the linearization says nothing.
_MAX_CORRECTION = 0.5
# Steps: factor after a failure, smallest part of the largest step, and largest growth.
_CUT, _MIN_STEP, _MAX_GROWTH = 0.25, 1e-6, 2.0
# The correction of a step, relative to the step, at which steps neither grow nor shrink.
_AIMED_CORRECTION = 0.05
# Largest correction of a step along the tangent at one of its ends, relative to the step: a larger
# one leads to another curve.
_MAX_ERROR = 0.3
# Largest curvature of a prediction, relative to the step.
_MAX_CURVED = 0.25
# A remaining distance up to this multiple of the step is split in two.
_SPLIT_RATIO = 1.2
# Steps below this fraction of the largest one may turn by any angle: the curve has a corner. A
# correction of more than the second number, in natural sizes, is a jump.
_CORNER_STEP, _MAX_CORNER = 1e-3, 1e-2
# Smallest cosine of the angle between successive tangents: a crossing curve leaves at a larger one.
_MIN_COSINE = 0.8


class CurveError(Exception):
    """Raised if a point or a step cannot be found; the message says why, without a period."""


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

    def correction(self, row: Row, target: float) -> Array:
        """Return the changes of x and p by Newton's method, where the control equals `target`.

        Raises
        ------
        CurveError
            If the bordered Jacobian is singular or not finite.
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

    def correction(self, row: Row, target: float) -> Array:
        """Return the correction of Newton's method."""
        factors = self.bordered(self.by_parameter, row.x, row.p)
        return factors.solve(-np.append(self.residual, row.value - target))


class Problem(Protocol):
    """Equations F(x, p) = 0.

    Attributes
    ----------
    weights
        Inverse natural sizes of the unknowns; 0 for those that do not measure a step, such as
        multipliers.
    """

    weights: Array

    def linearize(self, x: Array, p: float) -> Linearization:
        """Return the equations, linearized about (x, p)."""

    def move(self, x: Array, step: Array) -> Array:
        """Return the unknowns after a finite step."""

    def difference(self, end: Array, begin: Array) -> Array:
        """Return the step that leads from `begin` to `end`."""

    def monitor(self, point: Point) -> Any:
        """Return what must change continuously along a curve, such as its stability."""


class Tangent(NamedTuple):
    """Derivatives of x and p along a curve."""

    x: Array
    p: float

    def scale(self, factor: float) -> Tangent:
        """Return the tangent times `factor`."""
        return Tangent(factor * self.x, factor * self.p)


class Row(NamedTuple):
    """Value of a control at a point, and its derivatives by x and p."""

    value: float
    x: Array
    p: float


Control = Callable[[Array, float], Row]


@dataclass(frozen=True, eq=False)
class Point:
    """Solution of a problem, with its linearization."""

    problem: Problem
    x: Array
    p: float
    linearization: Linearization
    iterations: int = 0

    @cached_property
    def monitor(self) -> Any:
        """What must change continuously along curves, see `Problem.monitor`."""
        return self.problem.monitor(self)

    def bordered(self, column: Array, row: Array, corner: float) -> Factors:
        """Return the factors of the Jacobian, bordered by a column and a row."""
        return self.linearization.bordered(column, row, corner)

    def distance(self, other: Point) -> float:
        """Return the distance of another point, in natural sizes."""
        return _size(self.problem, self.problem.difference(other.x, self.x))

    def between(self, other: Point, share: float) -> tuple[Array, float]:
        """Return x and p between this point (0) and another one (1)."""
        step = self.problem.difference(other.x, self.x)
        return self.problem.move(self.x, share * step), self.p + share * (other.p - self.p)

    def tangent(self, row: Row) -> Tangent:
        """Return the tangent along which the control with this row increases by 1."""
        factors = self.bordered(self.linearization.by_parameter, row.x, row.p)
        solution = factors.solve(np.append(np.zeros(len(self.x)), 1.0))
        if not np.isfinite(solution).all():
            raise CurveError("the tangent is not unique")
        return Tangent(solution[:-1], float(solution[-1]))


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
    return Row(p, np.zeros_like(x), 1.0)


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
        return Row(value / size, row / size, by_parameter / size)


def correct(problem: Problem, control: Control, target: float, x: Array, p: float) -> Point:
    """Return the solution at which the control has the value `target`, by Newton's method.

    Raises
    ------
    CurveError
        If the method fails.
    """
    last, is_found = np.inf, False
    for iteration in range(_MAX_ITERATIONS + 1):
        linear = problem.linearize(x, p)
        if is_found:
            return Point(problem, x, p, linear, iteration)
        step = linear.correction(control(x, p), target)
        size = _size(problem, step[:-1])
        if not np.isfinite(size):
            raise CurveError("the equations are not finite at the next point")
        # Multipliers do not count in the size, but change with the last correction.
        is_found = size <= _TOLERANCE or (size <= _ROUNDING and size > 0.5 * last)
        # Convergence is quadratic: the next correction would be the square of this one.
        is_found |= last <= _QUADRATIC and size**3 <= _NEGLIGIBLE * last**2
        if not is_found and iteration > 2 and size > 2.0 * last:
            raise CurveError("Newton's method diverges")
        step *= min(1.0, _MAX_CORRECTION / max(size, _TOLERANCE))
        x, p, last = problem.move(x, step[:-1]), p + float(step[-1]), size
    raise CurveError(f"Newton's method did not converge in {_MAX_ITERATIONS} iterations")


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
        Tangent at the first point, with respect to the control.
    """

    begin: Point
    end: Point
    control: Control
    values: tuple[float, float]
    begin_tangent: Tangent

    def at(self, position: float) -> Point:
        """Return the point at a position from 0 to 1.

        Raises
        ------
        CurveError
            If Newton's method fails.
        """
        x, p = self.begin.between(self.end, position)
        value = self.values[0] + position * (self.values[1] - self.values[0])
        return correct(self.begin.problem, self.control, value, x, p)

    def rate(self, point: Point) -> float:
        """Return the derivative of the parameter by the control at a point of the segment."""
        if point is self.begin:
            return self.begin_tangent.p
        return self.tangent.p if point is self.end else self._tangent_at(point).p

    @cached_property
    def tangent(self) -> Tangent:
        """Tangent at the end, with respect to the control.

        Raises
        ------
        CurveError
            If it is not unique.
        """
        return self._tangent_at(self.end)

    def _tangent_at(self, point: Point) -> Tangent:
        return point.tangent(self.control(point.x, point.p))

    def part(self, begin: Point, end: Point, first: float, last: float) -> Segment:
        """Return the part between two points at the positions `first` and `last`."""
        begin_value, end_value = self.values
        low, high = (begin_value + x * (end_value - begin_value) for x in (first, last))
        return replace(self, begin=begin, end=end, values=(low, high))

    def up_to(self, end: Point) -> Segment:
        """Return the segment to another end."""
        return replace(self, end=end, values=(self.values[0], self.control(end.x, end.p).value))


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
    parameter_step, first_parameter_step
        Largest change of the parameter in a step by arc length, and in the first one.
    """

    largest: float
    by_arc_length: bool = False
    parameter_weight: float = 0.0
    parameter_step: float = np.inf
    first_parameter_step: float = np.inf


def follow(
    begin: Point,
    control: Control,
    target: float,
    steps: Steps,
    explain: Callable[[Segment], Any],
    tangent: Tangent | None = None,
) -> Iterator[tuple[Segment, Any]]:
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
        Function that returns the critical points of a segment, and raises CurveError if what it
        monitors changes without them; the step is then shortened.
    tangent
        First direction; by default, that in which the control approaches the target.

    Raises
    ------
    CurveError
        If no step converges.
    """
    progress = _Progress(begin, tangent, steps.largest)
    first = replace(steps, parameter_step=steps.first_parameter_step)
    while control(progress.begin.x, progress.begin.p).value != target:
        segment, found, progress = _take_step(progress, control, target, first, explain)
        first = steps
        yield segment, found
        if progress.has_arrived:
            return


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
        Unit tangent at the begin of the last step, and the size of this step.
    has_arrived
        True if the curve has reached its target.
    """

    begin: Point
    tangent: Tangent | None
    size: float
    last: tuple[Tangent, float] | None = None
    has_arrived: bool = False


class _Trial(NamedTuple):
    """Trial step: its control and target, unit tangent, and the steps that change the point."""

    control: Control
    values: tuple[float, float]
    unit: Tangent
    step: Tangent
    curved: Tangent

    @property
    def size(self) -> float:
        return abs(self.values[1] - self.values[0])


def _take_step(
    progress: _Progress,
    control: Control,
    target: float,
    steps: Steps,
    explain: Callable[[Segment], Any],
) -> tuple[Segment, Any, _Progress]:
    """Return the segment of the next step, its critical points, and the progress after it."""
    begin, size = progress.begin, progress.size
    problem, row, tangent = begin.problem, control(begin.x, begin.p), progress.tangent
    if tangent is None:
        tangent = begin.tangent(row).scale(np.sign(target - row.value))
    if steps.by_arc_length:
        unit = _normalize(problem, tangent, steps.parameter_weight)
        size = min(size, _limit_arc(problem, unit, steps))
    else:
        rate = float(row.x @ tangent.x) + row.p * tangent.p
        unit = tangent.scale(np.sign(target - row.value) / rate)
    least, usual = _MIN_STEP * size, min(size, steps.largest)
    while True:
        is_corner = size <= _CORNER_STEP * usual
        try:
            trial = _try(begin, row, control, target, steps, unit, size, progress, is_corner)
            segment, error = _correct_trial(begin, trial, is_corner)
            has_arrived = trial.values[1] == target and not steps.by_arc_length
            if steps.by_arc_length:
                cosine = _cosine(problem, unit, segment.tangent, steps.parameter_weight)
                if cosine < _MIN_COSINE and not is_corner:
                    raise CurveError("the curve turns too sharply for the step")
                segment, has_arrived = _truncate(segment, control, target)
            found = explain(segment)
            break
        except CurveError:
            size *= _CUT
            if size < least:
                raise
    moved = _size(problem, trial.step.x)
    aimed = _AIMED_CORRECTION * moved + _ROUNDING
    growth = float(np.clip(np.sqrt(aimed / max(error, 1e-3 * _ROUNDING)), 0.3, _MAX_GROWTH))
    grown = trial.size * growth
    # A step that is shortened to meet a target does not shorten the next step.
    grown = max(grown, progress.size) if has_arrived else grown
    if not steps.by_arc_length:
        grown = min(grown, steps.largest)
    last = (trial.unit, trial.size)
    return segment, found, _Progress(segment.end, segment.tangent, grown, last, has_arrived)


def _limit_arc(problem: Problem, unit: Tangent, steps: Steps) -> float:
    """Return the largest permitted size of a step by arc length."""
    motion, change = _size(problem, unit.x), abs(unit.p)
    by_motion = steps.largest / motion if motion > 0.0 else np.inf
    return min(by_motion, steps.parameter_step / change if change > 0.0 else np.inf)


def _try(
    begin: Point,
    row: Row,
    control: Control,
    target: float,
    steps: Steps,
    unit: Tangent,
    size: float,
    progress: _Progress,
    is_corner: bool,
) -> _Trial:
    """Return a trial step, whose curvature is that of the last one.

    Across a corner, such as the onset of a contact, the parameter may reverse: arc lengths are then
    those of the unknowns alone.
    """
    problem = begin.problem
    if steps.by_arc_length:
        weight = steps.parameter_weight
        if is_corner and _size(problem, unit.x) > 0.0:
            weight = 0.0
        control, values = ArcLength(begin, unit, weight), (0.0, size)
    else:
        side, reach = float(np.sign(target - row.value)), abs(target - row.value)
        # The last step is not tiny.
        size = 0.5 * reach if 1.001 * size < reach < _SPLIT_RATIO * size else size
        is_last = 1.001 * size >= reach
        values = row.value, target if is_last else row.value + side * size
    length = abs(values[1] - values[0])
    step = curved = unit.scale(length)
    if progress.last is not None and not is_corner:
        before, last = progress.last
        factor = 0.5 * length**2 / last
        bent = Tangent(factor * (unit.x - before.x), factor * (unit.p - before.p))
        if _size(problem, bent.x) <= _MAX_CURVED * _size(problem, step.x):
            curved = Tangent(step.x + bent.x, step.p + bent.p)
    return _Trial(control, values, unit, step, curved)


def _correct_trial(begin: Point, trial: _Trial, is_corner: bool) -> tuple[Segment, float]:
    """Return the segment of a trial step and the size of its correction.

    Raises
    ------
    CurveError
        If Newton's method fails, or the tangent at one of the ends does not lead to the other one.
    """
    problem = begin.problem
    x, p = problem.move(begin.x, trial.curved.x), begin.p + trial.curved.p
    end = correct(problem, trial.control, trial.values[1], x, p)
    first, last = trial.values
    segment = Segment(
        begin, end, trial.control, trial.values, trial.unit.scale(np.sign(last - first))
    )
    # A step between two curves is not seen from one of its ends alone.
    back = problem.move(end.x, segment.tangent.scale(first - last).x)
    error = _size(problem, problem.difference(end.x, x))
    missed = max(error, _size(problem, problem.difference(back, begin.x)))
    limit = _MAX_ERROR * _size(problem, trial.step.x) + _ROUNDING
    if error > _MAX_CORNER if is_corner else missed > limit:
        raise CurveError("the curve turns too sharply for the step")
    return segment, error


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
    tangent = _normalize(problem, parts[int(np.argmax(shares))].scale(side), weight)
    size = 0.5 * steps.largest
    while True:
        try:
            x, p = problem.move(branch.x, size * tangent.x), branch.p + size * tangent.p
            control = ArcLength(branch, tangent, weight)
            first = correct(problem, control, size, x, p)
            step = Tangent(problem.difference(first.x, branch.x), first.p - branch.p)
            row = control(first.x, first.p)
            after = first.tangent(row)
            if _cosine(problem, step, after, weight) < _MIN_COSINE:
                raise CurveError("the curve turns too sharply for the step")
            return first, after
        except CurveError as error:
            size *= _CUT
            if size < _MIN_STEP * steps.largest:
                raise CurveError(
                    f"no crossing path was found at the branch point: {error}"
                ) from None


def _truncate(segment: Segment, control: Control, target: float) -> tuple[Segment, bool]:
    """Return the segment, up to the target if it is within, and True if it is."""
    off = [control(x.x, x.p).value - target for x in (segment.begin, segment.end)]
    if off[0] * off[1] > 0.0 or off[0] == 0.0:
        return segment, False
    if off[1] == 0.0:
        return segment, True
    low, high = 0.0, 1.0
    for _ in range(40):
        position = low - off[0] * (high - low) / (off[1] - off[0])
        point = segment.at(position)
        rest = control(point.x, point.p).value - target
        if abs(high - low) < 1e-6 or rest == 0.0:
            break
        if rest * off[0] > 0.0:
            low, off[0], off[1] = position, rest, 0.5 * off[1]
        else:
            high, off[1], off[0] = position, rest, 0.5 * off[0]
    try:
        end = correct(point.problem, control, target, point.x, point.p)
    except CurveError:
        end = point  # the control has an extremum there
    return segment.up_to(end), True


def _size(problem: Problem, step: Array) -> float:
    return float(np.max(np.abs(step * problem.weights), initial=0.0))


def _normalize(problem: Problem, tangent: Tangent, weight: float) -> Tangent:
    size = max(_size(problem, tangent.x), weight * abs(tangent.p))
    return tangent.scale(1.0 / size)


def _inner(problem: Problem, one: Tangent, other: Tangent, weight: float) -> float:
    product = (one.x * problem.weights) @ (other.x * problem.weights)
    return float(product) + weight**2 * one.p * other.p


def _cosine(problem: Problem, one: Tangent, other: Tangent, weight: float) -> float:
    sizes = _inner(problem, one, one, weight) * _inner(problem, other, other, weight)
    return _inner(problem, one, other, weight) / np.sqrt(sizes)


def _remove(problem: Problem, one: Tangent, other: Tangent, weight: float) -> Tangent:
    """Return the part of a direction that is orthogonal to another one."""
    share = _inner(problem, one, other, weight) / _inner(problem, other, other, weight)
    return Tangent(one.x - share * other.x, one.p - share * other.p)
