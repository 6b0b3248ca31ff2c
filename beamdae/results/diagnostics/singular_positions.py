"""Singular positions a run passed, where its joints lose rank and motions branch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.rank import (
    ConstraintJacobian,
    build_constraint_jacobian,
    has_closed_loops,
)
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray

# Smallest singular value of the joints, over the largest it has in the run, that is none. On
# parallelograms runs come to 2e-3 at most where they pass it, and motions that miss the singular
# position by a ten-thousandth of a bar stay above 7e-3.
_NONE = 4e-3
# Velocities jump where they change between two looks so many times as much as they mostly do there,
# and by more than this share of themselves. Measured on parallelograms: 2 where a run goes on, 40
# and more where it goes over to another branch.
_TIMES, _SHARE = 10.0, 0.1
# Where it is looked for that, in looks at the run.
_AROUND = np.linspace(-2.0, 2.0, 25)
# Looks at a run: between, with the cube of the number of constraints, and how many dips are seen
# through, by how many looks each time.
_LEAST_LOOKS, _MOST_LOOKS, _WORK = 24, 400, 2e7
_DIPS, _INTO = 64, 17
# Ratio of two neighboring looks at the bottom of a dip from which on it may go down to nothing.
_STEEP = 1.5


@dataclass(frozen=True)
class SingularPosition:
    """A position in which the joints of a mechanism lose rank.

    Attributes
    ----------
    t
        When it was passed [s].
    joints
        Those whose reactions balance each other there.
    jump
        Whether the velocity jumped there: the run went over to another branch of the motion.
    """

    t: float
    joints: tuple[str, ...]
    jump: bool


def find_singular_positions(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> tuple[SingularPosition, ...]:
    """Singular positions of a run: dips of the smallest singular value of G to nothing.

    It is looked at up to 400 times of the run; dips are then seen through. A beam in a loop that
    its elasticity decides loses no rank. Where parts are switched each stretch of the run is looked
    at with the joints that are active in it; where redundant constraints are spared it is the
    smallest singular value that is none of theirs.
    """
    return tuple(
        position
        for own, stretch in _stretches(equations, trajectory)
        for position in _of_stretch(own, stretch)
    )


def _stretches(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[tuple[EquationsOfMotion, Trajectory]]:
    """What is run through with the same joints, with the equations of these."""

    def own(interval: Interval) -> EquationsOfMotion:
        active = interval.configuration
        return equations if active is None else active.equations

    for _, some in groupby(trajectory.intervals, lambda interval: id(own(interval))):
        intervals = tuple(some)
        yield own(intervals[0]), Trajectory(intervals)


def _of_stretch(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> tuple[SingularPosition, ...]:
    start, end = trajectory.intervals[0].t[0], trajectory.end
    if end <= start or not has_closed_loops(equations):
        return ()
    matrix = build_constraint_jacobian(equations)
    if equations.redundant:
        matrix = matrix.of_rank_at(*_first(trajectory))
    looks = int(np.clip(_WORK / equations.m**3, _LEAST_LOOKS, _MOST_LOOKS))
    t = np.linspace(start, end, looks + 1)
    values = _smallest(matrix, trajectory, t)
    largest = values.max()
    dips = _dips(values)
    if not len(dips):
        return ()
    width = t[1] - t[0]
    at, value = _seen_through(matrix, trajectory, t[dips], width)
    passed = at[value < _NONE * largest]
    if not len(passed):
        return ()
    times, state = trajectory.at(passed)
    jumps = _jumps(equations, trajectory, passed, width)
    return tuple(
        SingularPosition(float(when), tuple(matrix.losing(time, q)), bool(jump))
        for when, time, q, jump in zip(passed, times, state.q, jumps, strict=True)
    )


def _first(trajectory: Trajectory) -> tuple[Array, Array]:
    first = trajectory.intervals[0]
    return first.times[0], first.state.q[0]


def _dips(values: Array) -> Array:
    """Looks nearest to where values may have come to nothing, the first of each stretch of them."""
    low = values < _NONE * values.max()
    beside = np.append(values[1:], np.inf)
    before = np.append(np.inf, values[:-1])
    bottom = (values <= before) & (values < beside)
    # What comes to nothing between two looks falls as steeply up to there.
    steep = _STEEP * values < np.maximum(before, np.where(np.isinf(beside), 0.0, beside))
    entered = low & ~np.append(False, low[:-1])
    (found,) = np.nonzero((bottom & steep & ~low) | entered)
    return found[found > 0][:_DIPS]


def _smallest(matrix: ConstraintJacobian, trajectory: Trajectory, t: Array) -> Array:
    times, state = trajectory.at(t)
    return matrix.smallest(times, state.q)


def _seen_through(
    matrix: ConstraintJacobian, trajectory: Trajectory, at: Array, width: float
) -> tuple[Array, Array]:
    """Time and value of the bottom of dips that are known to +- width [s]."""
    value = np.full(len(at), np.inf)
    begin, end = trajectory.intervals[0].t[0], trajectory.end
    for _ in range(3):
        looks = at[:, None] + width * np.linspace(-1.0, 1.0, _INTO)
        looks = np.clip(looks, begin, end)
        order = np.argsort(looks, axis=None)
        found = np.empty(looks.size)
        found[order] = _smallest(matrix, trajectory, looks.ravel()[order])
        values = found.reshape(looks.shape)
        best = np.argmin(values, axis=1)[:, None]
        at = np.take_along_axis(looks, best, axis=1).ravel()
        value = np.take_along_axis(values, best, axis=1).ravel()
        width *= 2.0 / (_INTO - 1)
    return at, value


def _jumps(
    equations: EquationsOfMotion, trajectory: Trajectory, passed: Array, width: float
) -> Array:
    """Whether velocities jump near each time, by looks in this distance [s]."""
    steps, first = np.unique(
        np.concatenate([interval.t for interval in trajectory.intervals]), return_index=True
    )
    rates = np.concatenate([interval.state.v for interval in trajectory.intervals])[first]
    t = np.clip(passed[:, None] + width * _AROUND, steps[0], steps[-1])
    # Straight from step to step: a polynomial of higher degree would ring about a jump.
    v = _straight(steps, rates / equations.position_scales, t)
    changes = np.linalg.norm(np.diff(v, axis=1), axis=2)
    most, mostly = changes.max(axis=1), np.median(changes, axis=1)
    return (most > _TIMES * mostly) & (most > _SHARE * np.linalg.norm(v, axis=2).max(axis=1))


def _straight(steps: Array, values: Array, t: Array) -> Array:
    """Values at times t (., .) on straight lines between rows of values at the steps."""
    k = np.clip(np.searchsorted(steps, t) - 1, 0, len(steps) - 2)
    share = ((t - steps[k]) / (steps[k + 1] - steps[k]))[..., None]
    return (1.0 - share) * values[k] + share * values[k + 1]


def singularity_warnings(found: tuple[SingularPosition, ...]) -> tuple[str, ...]:
    """A sentence on what was passed, and one on where a run left its branch."""
    if not found:
        return ()
    first, count = found[0], len(found)
    more = f", and at {count - 1} later times" if count > 1 else ""
    passed = (
        f"{', '.join(first.joints)}: these joints lose rank near t = {first.t:.5g} s{more}, where "
        "motions branch; the one computed is one of two."
    )
    jumps = [position for position in found if position.jump]
    if not jumps:
        return (passed,)
    left = (
        f"{', '.join(jumps[0].joints)}: near t = {jumps[0].t:.5g} s, where these joints lose rank, "
        "the velocity jumps and the run goes over to another branch; take a formulation that holds "
        "positions and velocities, such as 'stabilized-index1', or shorter steps."
    )
    return (passed, left)
