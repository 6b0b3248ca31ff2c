"""Singular positions of a run, at which the constraints lose rank and the motion may branch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.dependent_constraints import (
    build_constraint_jacobian,
    has_closed_loops,
)
from beamdae.errors import format_count
from beamdae.results.sampled_functions import find_turns, locate_minima
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# A position is singular if the smallest singular value of G, relative to its largest value over
# the run, is below this ratio. For parallelogram linkages, runs through a singular position reach
# at most 2e-3; motions that miss the position by a ten-thousandth of the bar length stay above
# 7e-3.
_SINGULAR_RATIO = 4e-3

# Number of samples of a run times the cube of the number of constraints, and limits of the number.
_SAMPLING_WORK = 2e7
_SAMPLES = (24, 400)
_MAX_MINIMA = 64  # maximum number of minima to locate


def count_samples(m: int) -> int:
    """Return the number of samples of a run that search for singular positions."""
    return int(np.clip(_SAMPLING_WORK / m**3, *_SAMPLES))


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
    sampled at up to 401 times, and each minimum that may be zero is located. Loops that
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
    t = np.linspace(start, end, count_samples(equations.m) + 1)

    def smallest_at(times: Array) -> Array:
        order = np.argsort(times, axis=None)
        ascending, values = times.ravel()[order], np.empty(times.size)
        q = trajectory.positions_at(ascending)
        values[order] = jacobian.smallest_singular_values(trajectory.time_rows(ascending), q)
        return values.reshape(times.shape)

    values = smallest_at(t)
    limit = _SINGULAR_RATIO * values.max()
    is_low = values < limit
    # Minima that may be zero, and the beginnings of stretches below the limit.
    turns, _ = find_turns(t, values[:, None])
    (entries,) = np.nonzero(is_low[1:] & ~is_low[:-1])
    near = np.union1d(turns[~is_low[turns]], entries + 1)
    near = near[np.diff(near, prepend=-1) > 1][:_MAX_MINIMA]  # neighbors share a minimum
    if not len(near):
        return []
    times = locate_minima(t[near - 1], t[np.minimum(near + 1, len(t) - 1)], smallest_at)
    singular = times[smallest_at(times) < limit]
    rows, state = trajectory.at(singular)
    return [
        SingularPosition(float(when), tuple(jacobian.singular_joints(row, q)))
        for when, row, q in zip(singular, rows, state.q, strict=True)
    ]


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
