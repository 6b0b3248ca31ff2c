"""Curves of solutions of F(x, p) = 0, followed by predictor and corrector steps.

Newton's method solves the equations together with one further row, which prescribes the parameter,
a function of the solution, or the arc length (H. B. Keller, 1977): the bordered matrix is regular
at limit points. One norm, the largest change of a coordinate in natural sizes, measures all steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
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
# Largest correction of one iteration, in natural sizes: farther, the linearization says nothing.
_MAX_CORRECTION = 0.5
# Steps: factor after a failure, smallest part of the largest step, and largest growth.
_CUT, _MIN_STEP, _MAX_GROWTH = 0.25, 1e-6, 2.0
# The correction of a step, relative to the step, at which steps neither grow nor shrink.
_AIMED_CORRECTION = 0.05
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

    residual: Array
    by_parameter: Array

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

    def bordered(self, column: Array, row: Array, corner: float) -> Factors:
        """Return the factors of the Jacobian, bordered by a column and a row."""
        return self.linearization.bordered(column, row, corner)

    def tangent(self, row: Row) -> Tangent:
        """Return the tangent along which the control with this row increases by 1."""
        factors = self.bordered(self.linearization.by_parameter, row.x, row.p)
        solution = factors.solve(np.append(np.zeros(len(self.x)), 1.0))
        if not np.isfinite(solution).all():
            raise CurveError("the tangent is not unique")
        return Tangent(solution[:-1], float(solution[-1]))


def factorize_bordered(
    jacobian: sp.csc_array, column: Array, row: Array, corner: float
) -> Factors:
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
        weights = self.begin.problem.weights**2
        row = weights * self.tangent.x
        by_parameter = self.parameter_weight**2 * self.tangent.p
        step = self.begin.problem.difference(x, self.begin.x)
        value = float(row @ step) + by_parameter * (p - self.begin.p)
        size = float(row @ self.tangent.x) + by_parameter * self.tangent.p
        return Row(value / size, row / size, by_parameter / size)


def correct(
    problem: Problem, control: Control, target: float, x: Array, p: float
) -> Point:
    """Return the solution at which the control has the value `target`, by Newton's method.

    Raises
    ------
    CurveError
        If the method fails.
    """
    last = np.inf
    for iteration in range(_MAX_ITERATIONS + 1):
        linear = problem.linearize(x, p)
        if not np.isfinite(linear.residual).all():
            raise CurveError("the forces are not finite at the next point")
        row = control(x, p)
        right = -np.append(linear.residual, row.value - target)
        factors = linear.bordered(linear.by_parameter, row.x, row.p)
        step = factors.solve(right)
        size = float(np.max(np.abs(step[:-1] * problem.weights), initial=0.0))
        if not np.isfinite(size):
            raise CurveError("the tangent is singular at the next point")
        if size <= _TOLERANCE or (size <= _ROUNDING and size > 0.5 * last):
            return Point(problem, x, p, linear, iteration)
        if iteration > 2 and size > 2.0 * last:
            raise CurveError("Newton's method diverges")
        step *= min(1.0, _MAX_CORRECTION / size)
        x, p, last = problem.move(x, step[:-1]), p + float(step[-1]), size
    raise CurveError(f"Newton's method did not converge in {_MAX_ITERATIONS} iterations")


@dataclass(frozen=True, eq=False)
class Segment:
    """Part of a curve between two points, with a control that increases along it from 0 to 1."""

    begin: Point
    end: Point
    control: Control
    values: tuple[float, float]

    def at(self, position: float) -> Point:
        """Return the point at a position from 0 to 1.

        Raises
        ------
        CurveError
            If Newton's method fails.
        """
        a, b = self.begin, self.end
        step = a.problem.difference(b.x, a.x)
        x, p = a.problem.move(a.x, position * step), a.p + position * (b.p - a.p)
        value = self.values[0] + position * (self.values[1] - self.values[0])
        return correct(a.problem, self.control, value, x, p)

    def rate(self, point: Point) -> float:
        """Return the derivative of the parameter along the segment at a point of it."""
        return point.tangent(self.control(point.x, point.p)).p

    def up_to(self, end: Point) -> Segment:
        """Return the segment to another end."""
        return replace(self, end=end, values=(self.values[0], self.control(end.x, end.p).value))


@dataclass(frozen=True)
class Steps:
    """Steps along a curve.

    Attributes
    ----------
    largest
        Largest step, in units of the control.
    by_arc_length
        True to step by arc length, False to step by `control`.
    parameter_weight
        Weight of the parameter in arc lengths.
    """

    largest: float
    by_arc_length: bool
    parameter_weight: float


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
    size = steps.largest
    while True:
        towards = target - control(begin.x, begin.p).value
        if towards == 0.0:
            return
        if tangent is None:
            tangent = begin.tangent(control(begin.x, begin.p)).scale(np.sign(towards))
        segment, found, size, tangent, is_last = _take_step(
            begin, control, target, steps, explain, tangent, size
        )
        yield segment, found
        if is_last:
            return
        begin = segment.end


def _take_step(
    begin: Point,
    control: Control,
    target: float,
    steps: Steps,
    explain: Callable[[Segment], Any],
    tangent: Tangent,
    size: float,
) -> tuple[Segment, Any, float, Tangent, bool]:
    problem, least = begin.problem, _MIN_STEP * steps.largest
    while True:
        try:
            along, value, is_last = control, 0.0, False
            first = control(begin.x, begin.p).value
            if steps.by_arc_length:
                unit = _normalize(problem, tangent, steps.parameter_weight)
                along, first = ArcLength(begin, unit, steps.parameter_weight), 0.0
                value = size
            else:
                row = control(begin.x, begin.p)
                unit = begin.tangent(row).scale(np.sign(target - first))
                is_last = size >= abs(target - first) * (1.0 - 1e-9)
                value = target if is_last else first + np.sign(target - first) * size
            reach = abs(value - first)
            x, p = problem.move(begin.x, reach * unit.x), begin.p + reach * unit.p
            end = correct(problem, along, value, x, p)
            segment = Segment(begin, end, along, (first, value))
            moved = _size(problem, reach * unit.x)
            error = _size(problem, problem.difference(end.x, x))
            if error > 0.3 * moved and error > 1e-6:
                raise CurveError("the curve turns within the step")
            row = along(end.x, end.p)
            after = end.tangent(row)
            if steps.by_arc_length:
                cosine = _cosine(problem, unit, after, steps.parameter_weight)
                if cosine < _MIN_COSINE:
                    raise CurveError("the curve turns too sharply for the step")
                segment, is_last = _truncate(segment, control, target)
            found = explain(segment)
        except CurveError:
            size *= _CUT
            if size < least:
                raise
            continue
        is_linear = error <= _AIMED_CORRECTION * moved / _MAX_GROWTH**2
        growth = _MAX_GROWTH if is_linear else np.sqrt(_AIMED_CORRECTION * moved / error)
        grown = min(size * float(np.clip(growth, 0.3, _MAX_GROWTH)), steps.largest)
        return segment, found, grown, after, is_last


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


def _cosine(problem: Problem, one: Tangent, other: Tangent, weight: float) -> float:
    def inner(a: Tangent, b: Tangent) -> float:
        return float((a.x * problem.weights) @ (b.x * problem.weights)) + weight**2 * a.p * b.p

    return inner(one, other) / np.sqrt(inner(one, one) * inner(other, other))
