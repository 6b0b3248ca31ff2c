"""Singular positions of a run, at which the constraints lose rank and the motion may branch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.dependent_constraints import (
    ConstraintJacobian,
    build_constraint_jacobian,
    has_closed_loops,
)
from beamdae.errors import format_count
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# A position is singular if the smallest singular value of G, relative to its largest value over
# the run, is below this ratio. For parallelogram linkages, runs through a singular position reach
# at most 2e-3; motions that miss the position by a ten-thousandth of the bar length stay above
# 7e-3.
_SINGULAR_RATIO = 4e-3

# The number of samples of a run decreases with the cube of the number of constraints.
_MIN_SAMPLES = 24
_MAX_SAMPLES = 400
_SAMPLING_WORK = 2e7  # number of samples times the cube of the number of constraints

_MAX_MINIMA = 64  # maximum number of minima to refine
_REFINEMENTS = 3
_REFINEMENT_SAMPLES = 17  # samples per refinement of a minimum
# A minimum may reach zero between two samples if its neighbors differ by at least this factor.
_STEEP_RATIO = 1.5


@dataclass(frozen=True)
class SingularPosition:
    """Position at which the constraints of a mechanism lose rank.

    Attributes
    ----------
    t
        Time at which the run passed the position [s].
    joints
        Names of the joints whose reactions balance each other and are therefore not unique.
    """

    t: float
    joints: tuple[str, ...]


def find_singular_positions(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> tuple[SingularPosition, ...]:
    """Find the positions of a run at which the constraint Jacobian G is nearly singular.

    In each segment of the run with constant active joints, the smallest singular value of G is
    sampled at up to 401 times, and the time of each minimum that may be zero is refined. Loops that
    are closed by the elasticity of a beam do not lose rank. If redundant constraints are removed, G
    contains only the independent constraints.
    """
    positions: list[SingularPosition] = []
    for _, group in groupby(trajectory.intervals, lambda x: id(x.active_equations(equations))):
        intervals = tuple(group)
        stretch = Trajectory(intervals)
        positions += _find_in_stretch(intervals[0].active_equations(equations), stretch)
    return tuple(positions)


def _find_in_stretch(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> list[SingularPosition]:
    """Find the singular positions of a segment of a run with constant active joints."""
    start, end = trajectory.start, trajectory.end
    if end <= start or not has_closed_loops(equations):
        return []
    first = trajectory.intervals[0]
    regular = (first.times[0], first.state.q[0]) if equations.redundant else None
    jacobian = build_constraint_jacobian(equations, regular)
    samples = int(np.clip(_SAMPLING_WORK / equations.m**3, _MIN_SAMPLES, _MAX_SAMPLES))
    t = np.linspace(start, end, samples + 1)
    values = _smallest_singular_values(jacobian, trajectory, t)
    minima = _select_minima(values)
    if not len(minima):
        return []
    distance = t[1] - t[0]
    at, minimum = _refine_minima(jacobian, trajectory, t[minima], distance)
    singular = at[minimum < _SINGULAR_RATIO * values.max()]
    if not len(singular):
        return []
    times, state = trajectory.at(singular)
    return [
        SingularPosition(float(when), tuple(jacobian.singular_joints(time, q)))
        for when, time, q in zip(singular, times, state.q, strict=True)
    ]


def _select_minima(values: Array) -> Array:
    """Return the indices of at most 64 samples near which the singular value may vanish.

    These are steep minima above the threshold and the first sample of each stretch below it, except
    the first sample of the run.
    """
    is_low = values < _SINGULAR_RATIO * values.max()
    following = np.append(values[1:], np.inf)
    preceding = np.append(np.inf, values[:-1])
    is_minimum = (values <= preceding) & (values < following)
    # A function that vanishes between two samples decreases steeply toward its zero.
    neighbor = np.maximum(preceding, np.where(np.isinf(following), 0.0, following))
    is_steep = _STEEP_RATIO * values < neighbor
    is_first_low = is_low & ~np.append(False, is_low[:-1])
    (samples,) = np.nonzero((is_minimum & is_steep & ~is_low) | is_first_low)
    return samples[samples > 0][:_MAX_MINIMA]


def _smallest_singular_values(
    jacobian: ConstraintJacobian, trajectory: Trajectory, t: Array
) -> Array:
    q = trajectory.positions_at(t)
    return jacobian.smallest_singular_values(trajectory.time_rows(t), q)


def _refine_minima(
    jacobian: ConstraintJacobian, trajectory: Trajectory, at: Array, width: float
) -> tuple[Array, Array]:
    """Return refined times and values of minima, given their times with accuracy `width` [s]."""
    minimum = np.full(len(at), np.inf)
    for _ in range(_REFINEMENTS):
        samples = at[:, None] + width * np.linspace(-1.0, 1.0, _REFINEMENT_SAMPLES)
        samples = np.clip(samples, trajectory.intervals[0].t[0], trajectory.end)
        order = np.argsort(samples, axis=None)
        values = np.empty(samples.shape)
        values.flat[order] = _smallest_singular_values(jacobian, trajectory, samples.ravel()[order])
        best = np.argmin(values, axis=1)[:, None]
        at = np.take_along_axis(samples, best, axis=1).ravel()
        minimum = np.take_along_axis(values, best, axis=1).ravel()
        width *= 2.0 / (_REFINEMENT_SAMPLES - 1)
    return at, minimum


def singularity_warnings(positions: tuple[SingularPosition, ...]) -> tuple[str, ...]:
    """Return a warning about the first singular position, if there is one."""
    if not positions:
        return ()
    first, later = positions[0], ""
    if len(positions) > 1:
        later = f" and at {format_count(len(positions) - 1, 'later time')}"
    return (
        f"{', '.join(first.joints)}: the constraints lose rank near t = {first.t:.5g} s{later}, "
        "where the motion may branch; check that the run continues on the intended branch.",
    )


def unbounded_warnings(names: Sequence[str], trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning about reactions that grow without bounds, given the names of multipliers."""
    rows = [(x.nodes, np.isnan(x.rows.lam)) for x in trajectory.intervals]
    is_unbounded = np.concatenate([x for _, x in rows])
    if is_unbounded.any():
        times = np.concatenate([t for t, _ in rows])[is_unbounded.any(axis=1)]
        involved = np.flatnonzero(is_unbounded.any(axis=0)).tolist()
        joints = dict.fromkeys(names[k].rpartition(".")[0] for k in involved)
        yield (
            f"{', '.join(joints)}: the reactions grow without bounds where the constraints lose "
            f"rank, first near t = {times[0]:.5g} s, because they cannot balance the loads there; "
            "these rows are NaN, and columns with such rows have no extremes."
        )
