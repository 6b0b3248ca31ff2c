"""Warnings about observed motions that are small compared with the amplitude of their parts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable, State
from beamdae.equations.starts.rank import build_constraint_jacobian
from beamdae.errors import name_with_others
from beamdae.results.columns import mark_constant_columns, remove_unit
from beamdae.results.diagnostics.resolution.missed_peaks import StepExtremes
from beamdae.results.diagnostics.suspected_errors import SuspectedError
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Amplitude of the parts / half the range of a column. Up to this ratio, errors are near the bounds
# stated for positions.
_MIN_RATIO = 300.0
# rtol * amplitude / half range. Errors are 0.02 to 0.3 times this number for half-car models over
# bumps with rtol from 1e-8 to 1e-5, and up to 6 times for 60 periods of an undamped oscillator on
# a train.
_MAX_RELATIVE_TOLERANCE = 3e-3
_RECOMMENDED_RELATIVE_TOLERANCE = 1e-3
_MIN_RTOL = 1e-10
# Columns with a smaller half range, relative to the amplitude of their parts, are at rest.
_RESTING_SHARE = 1e-8
# Estimates by interpolation from which errors may be large, see `_may_be_inaccurate`. With methods
# without stages, errors are up to half the square root of the estimate with second order, and less
# with others: in 91 runs of half-car models and an oscillator on a train with rtol from 1e-3 to
# 1e-7, those of more than 1 % have estimates above 0.01.
_MAX_ESTIMATE = 1e-3
# With stages, that is, with `Radau`, errors are far smaller than the deviations. They grow with the
# sum of deviations^1.5, because the deviations are of fourth and the errors of a step of sixth
# order: in 33 runs of an oscillator on a train and of cars with rtol from 1e-3 to 1e-8, those of
# more than 1 % have sums of 0.74 to 74, and those of less than 0.5 % have sums below 0.27. A leaf
# spring whose 1400 steps follow fast vibrations has sums up to 0.05 and errors of 0.03 to 0.06 %.
_ORDER_RATIO = 1.5
_MAX_SUM_WITH_STAGES = 0.3
_MIN_STEPS = 20  # with fewer steps, deviations are no estimate
_GRADIENT_SAMPLES = 3
_DIFFERENCE_STEP = 1e-6  # of gradients, relative to the scale of a coordinate
# Errors of changes that the constraints allow, relative to all changes.
_ROUNDING = 1e-6
_MAX_SIZE = 2000  # coordinates; the projection of a gradient needs a dense matrix


def small_motion_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    integrator: Mapping[str, Any],
) -> Iterator[SuspectedError]:
    """Yield a warning if the tolerance is coarse for the half range of observed columns.

    The tolerance of a rigid body refers to the amplitude of its motion. Vibrations of a vehicle
    that travels, and the motion of two bodies relative to each other, can be much smaller. Columns
    that joints prescribe are exempt, and so are those that the steps resolve all the same.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    extremes
        Extremes of the observed columns, by header.
    integrator
        Settings of the run, with `rtol` and the `amplitudes` of pilot runs.
    """
    rtol, amplitudes = integrator.get("rtol"), integrator.get("amplitudes")
    if not (rtol and amplitudes and trajectory.end > trajectory.start):
        return
    if equations.n > _MAX_SIZE:
        return
    scales, is_rigid = _coordinate_scales(equations, amplitudes)

    @cache
    def sample() -> tuple[Array, State]:
        inside = np.linspace(trajectory.start, trajectory.end, _GRADIENT_SAMPLES + 2)[1:-1]
        return trajectory.at(inside)

    # Decompositions of large matrices, which serve all observables.
    @cache
    def find_constrained(k: int) -> tuple[Array, Array]:
        times, states = sample()
        return _constrained_directions(equations, times[k], states.q[k], scales)

    small: list[_SmallColumn] = []
    for observable in equations.observables:
        half_ranges = {
            k: extremes[header].half_range
            for k, header in enumerate(observable.headers)
            if header in extremes and observable.columns[k].unit in ("m", "rad")
        }
        if not observable.has_accelerations:
            small += _find_small_columns(
                equations, sample, find_constrained, observable, half_ranges, scales, is_rigid
            )
    coarse = [
        x
        for x in small
        if x.ratio > _MIN_RATIO
        and rtol * x.ratio > _MAX_RELATIVE_TOLERANCE
        and not x.is_constant(equations.length, rtol)
        and _may_be_inaccurate(equations, trajectory, x)
    ]
    if not coarse:
        return
    worst = max(coarse, key=lambda x: x.ratio)
    others = [x.name for x in coarse if x is not worst]
    exponent = math.floor(math.log10(_RECOMMENDED_RELATIVE_TOLERANCE / worst.ratio))
    sufficient = max(10.0**exponent, _MIN_RTOL)
    yield SuspectedError(
        f"{name_with_others(worst.name, others)}: "
        f"half its range, {worst.half_range:.2g} {worst.unit}, is only "
        f"{1.0 / worst.ratio:.1g} of the amplitude of its parts, to which rtol={rtol:g} refers, so "
        f"that its error can be several percent; use rtol={sufficient:.0e}.",
        tuple(x.header for x in coarse),
        {"rtol": sufficient},
    )


class _SmallColumn(NamedTuple):
    """A column of an observable; `ratio` is the amplitude of its parts / half its range."""

    observable: Observable
    number: int
    ratio: float
    half_range: float

    @property
    def header(self) -> str:
        return self.observable.headers[self.number]

    @property
    def name(self) -> str:
        return remove_unit(self.header)

    @property
    def unit(self) -> str:
        return self.observable.columns[self.number].unit

    def is_constant(self, length: float, rtol: float) -> bool:
        """Return True if the column varies by no more than errors of the integration."""
        half_range = np.array([self.half_range])
        return bool(
            mark_constant_columns([self.header], half_range[None], half_range, length, rtol)[0]
        )


def _may_be_inaccurate(
    equations: EquationsOfMotion, trajectory: Trajectory, column: _SmallColumn
) -> bool:
    """Return True unless the steps resolve a column so well that its errors are small.

    Errors of methods with stages are estimated by a sum over the deviations between steps. Phase
    errors and damping of other methods, which have lower orders, grow with the number of swings
    through the range, and are estimated by the largest deviation times the swings squared. Errors
    are unknown if steps are not stored.
    """
    if not trajectory.stores_all_steps:
        return True
    times, values = [], []
    for interval in trajectory.intervals:
        at, state = interval.times[:: interval.nodes_per_step], interval.state
        rows = column.observable.evaluate(equations.p, at, state.q, state.v, state.lam)
        times.append(interval.t)
        values.append(rows[:, column.number])
    # Positions are continuous at events and samples.
    t, steps, counts = np.unique(np.concatenate(times), return_index=True, return_counts=True)
    x = np.concatenate(values)[steps] / column.half_range
    if len(t) < _MIN_STEPS:
        return True
    deviations = _deviations_between_steps(t, x, np.nonzero(counts > 1)[0])
    if trajectory.intervals[0].nodes_per_step > 1:
        return bool(np.sum(deviations**_ORDER_RATIO) > _MAX_SUM_WITH_STAGES)
    swings = 0.5 * np.sum(np.abs(np.diff(x)))
    return bool(np.max(deviations) * swings**2 > _MAX_ESTIMATE)


def _deviations_between_steps(t: Array, x: Array, jumps: Array) -> Array:
    """Return the deviations of values at steps from those at the neighbors, (k - 4,).

    A deviation is the distance from the cubic polynomial through the two steps before and after.
    It is large if the steps do not resolve the motion, and if errors differ from step to step.
    Accelerations jump at the steps `jumps`: polynomials through both sides are avoided if there are
    others on either side.
    """
    inside = np.arange(2, len(t) - 2)
    neighbors = inside + np.array([-2, -1, 1, 2])[:, None]
    nodes, interpolated = t[neighbors], np.zeros(len(inside))
    for k, j in enumerate(neighbors):
        others = np.delete(nodes, k, axis=0)
        weights = np.prod((t[inside] - others) / (nodes[k] - others), axis=0)
        interpolated += weights * x[j]
    deviations = np.abs(x[inside] - interpolated)
    ends = np.concatenate([[0], jumps, [len(t) - 1]])
    piece = np.searchsorted(ends[1:-1], inside, side="right")
    is_smooth = (inside - ends[piece] >= 2) & (ends[piece + 1] - inside >= 2)
    is_long = ends[piece + 1] - ends[piece] >= len(neighbors)
    (kept,) = np.nonzero(is_smooth | ~is_long)
    return np.interp(np.arange(len(inside)), kept, deviations[kept])


def _coordinate_scales(
    equations: EquationsOfMotion, amplitudes: Mapping[str, float]
) -> tuple[Array, Array]:
    """Return the scale of each coordinate [m or rad], and True for those of rigid motions, (n,)."""
    scales, is_rigid = np.zeros(equations.n), np.zeros(equations.n, bool)
    for part in equations.parts:
        if part.is_state:
            continue
        is_rigid[part.rigid] = True
        sizes = np.where(equations.is_angle[part.rows], 1.0, part.size)
        scales[part.rows] = amplitudes.get(part.name, 0.0) * sizes
    return scales, is_rigid


def _find_small_columns(
    equations: EquationsOfMotion,
    sample: Callable[[], tuple[Array, State]],
    find_constrained: Callable[[int], tuple[Array, Array]],
    observable: Observable,
    half_ranges: Mapping[int, float],
    scales: Array,
    is_rigid: Array,
) -> list[_SmallColumn]:
    """Return the columns of an observable that are small beside the amplitude of its parts.

    `sample` returns rows (t, branch) and the states at `_GRADIENT_SAMPLES` times, and
    `find_constrained` returns `_constrained_directions` at one of them. `half_ranges` are those of
    the positions and angles, by number of the column.
    """
    rows = np.unique(observable.operator.indices)
    rows = rows[scales[rows] > 0.0]
    rigid_rows = rows[is_rigid[rows]]
    if not rigid_rows.size:
        return []
    largest_scale = float(np.max(scales[rigid_rows]))
    columns = [k for k, x in half_ranges.items() if _MIN_RATIO * x < largest_scale]
    if not columns:
        return []
    times, states = sample()
    changes = [
        _changes(equations, observable, times[k], State(*(x[k] for x in states)), scales, rows)
        for k in range(_GRADIENT_SAMPLES)
    ]
    # Free changes are zero, or not smaller than this share of all changes.
    smallest = _ROUNDING * np.min([np.max(np.abs(x), axis=1) for x in changes], axis=0)
    columns = [k for k in columns if half_ranges[k] > _RESTING_SHARE * smallest[k]]
    if not columns:
        return []
    amplitudes = np.max(
        [
            _largest_free_change(change, is_rigid, *find_constrained(k))
            for k, change in enumerate(changes)
        ],
        axis=0,
    )
    return [
        _SmallColumn(observable, k, float(amplitudes[k] / half_ranges[k]), half_ranges[k])
        for k in columns
        if half_ranges[k] > _RESTING_SHARE * amplitudes[k] > 0.0
    ]


def _changes(
    equations: EquationsOfMotion,
    observable: Observable,
    time: Array,
    state: State,
    scales: Array,
    rows: Array,
) -> Array:
    """Return the derivatives of the columns by the coordinates, times their scales, (k, n).

    Only derivatives by the coordinates `rows` are computed; the others are zero.
    """
    count = len(rows)
    # Central differences over small angles: joints cancel the derivatives of other points.
    limits = np.where(equations.is_angle[rows], 1.0, np.inf)
    steps = _DIFFERENCE_STEP * np.minimum(scales[rows], limits)
    states = State(*(np.tile(x, (2 * count, 1)) for x in state))
    states.q[np.arange(count), rows] += steps
    states.q[np.arange(count, 2 * count), rows] -= steps
    times = np.tile(time, (2 * count, 1))
    values = observable.evaluate(equations.p, times, states.q, states.v, states.lam)
    changes = np.zeros((values.shape[1], equations.n))
    changes[:, rows] = (values[:count] - values[count:]).T / (2.0 * steps) * scales[rows]
    return changes


def _constrained_directions(
    equations: EquationsOfMotion, time: Array, q: Array, scales: Array
) -> tuple[Array, Array]:
    """Return the coordinates in constraints, and an orthonormal basis of their gradients.

    The coordinates (k,) are relative to their scales; the columns of the basis (k, rank) span the
    changes that the constraints exclude.
    """
    if not equations.m:
        return np.zeros(0, int), np.zeros((0, 0))
    constraints = build_constraint_jacobian(equations)
    (columns,) = np.nonzero(np.diff(constraints.pattern.indptr))
    (jacobian,) = constraints.at(time[None], q[None])
    # Its columns refer to the scales of positions.
    gradients = (jacobian * (scales[columns] / equations.position_scales[columns])).T
    basis, sizes, _ = np.linalg.svd(gradients, full_matrices=False)
    rounding = np.finfo(float).eps * max(gradients.shape) * np.max(sizes, initial=0.0)
    return columns, basis[:, sizes > rounding]


def _largest_free_change(
    changes: Array, is_rigid: Array, columns: Array, constrained: Array
) -> Array:
    """Return the largest change of each column by a rigid motion of the mechanism, (k,).

    It is zero if the constraints allow no change of the column, also not by deformations.
    `columns` and `constrained` are those of `_constrained_directions`.
    """
    count = len(changes)
    changes = np.concatenate([changes, np.where(is_rigid, changes, 0.0)])
    largest = np.max(np.abs(changes), axis=1, keepdims=True)
    constrained_changes = changes[:, columns]
    changes[:, columns] = constrained_changes - constrained_changes @ constrained @ constrained.T
    # Of motions that joints prescribe, rounding errors remain.
    changes[np.abs(changes) < _ROUNDING * largest] = 0.0
    largest_free = np.max(np.abs(changes), axis=1)
    return np.where(largest_free[:count] > 0.0, largest_free[count:], 0.0)
