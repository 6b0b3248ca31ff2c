"""Warnings about tables that the motion leaves, or whose units differ from those of the motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.table_arguments import (
    TableArgumentTerm,
    compile_table_arguments,
    find_distinct,
)
from beamdae.parts.events import have_actions
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_MIN_EXCESS = 1e-3  # outside a table, relative to its range; less hardly changes its value
# An argument is in another unit, such as mm and m, if it moves less than the first multiple of the
# table about zero, or more than the second one: strokes are shorter.
_SMALL_UNIT, _MAX_STROKE = 1e-3, 1e4
_MIN_MOTION = 1e-6  # of arguments that are not at rest, relative to the table
# Distance from a table that is zero there, relative to its range and the motion, if it is never
# entered: stops are nearer.
_MAX_DISTANCE = 2.0
# Quarter turn of tables over an angle, derivative of the argument by an angle in rad that is in the
# other unit, this unit, and the factor between both.
_ANGLES = {
    "degrees": (90.0, 1.0, "rad", "180 / pi"),
    "rad": (0.5 * np.pi, 180.0 / np.pi, "degrees", "pi / 180"),
}
_MAX_QUARTERS = 16
_ANGLE_ROUNDING = 5e-3  # of a range in quarter turns, such as 6.28, and of a derivative
_DIFFERENCE = 1e-5  # [rad], of this derivative


def table_range_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, is_complete: bool
) -> Iterator[str]:
    """Yield a warning per argument of a table that does not fit its range in a run.

    Tables over time are exempt, because they usually hold their last value, and so are sides at
    which the table is zero or constant: one-sided forces and limits continue there as they should.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    is_complete
        True if the run leads from its start to its planned end.
    """
    apart = []
    for term in find_distinct(compile_table_arguments(equations)):
        intervals = [x for x in trajectory.intervals if term.part not in x.inactive]
        if term.is_limited or not term.depends_on_motion or not intervals:
            continue
        t = np.concatenate([x.t for x in intervals])
        x = np.concatenate([term.evaluate(i.t, i.branch, i.state) for i in intervals])
        low, high = term.limits
        length, sides = high - low, {"first": low - x, "last": x - high}
        excess = np.maximum(*sides.values())
        held = {
            row: beyond
            for (row, beyond), side in zip(sides.items(), (0, -1), strict=True)
            if np.max(beyond) > _MIN_EXCESS * length and not term.continues_as_constant(side)
        }
        unit = _find_unit_of_angle(term, equations, trajectory)
        if unit:
            _, _, other, factor = _ANGLES[unit]
            yield (
                f"{term.part}: {term.table.arguments[term.axis]} of {term.table.name} is an angle "
                f"in {other}, but the table seems to be over {unit} ({low:.6g} to {high:.6g}); "
                f"multiply the argument by {factor}."
            )
        elif _has_other_unit(term, x):
            yield _describe_misfit(term, x)
        elif term.table.is_repeated or np.max(excess) <= _MIN_EXCESS * length:
            continue
        elif _covers_turns(term):
            k = int(np.argmax(excess))
            yield (
                f"{term.describe(float(x[k]))} at t = {t[k]:.6g} s, where its value is held; if "
                "the table repeats with each turn, pass outside='repeat'."
            )
        elif held:
            row, beyond = max(held.items(), key=lambda item: float(np.max(item[1])))
            k = int(np.argmax(beyond))
            yield (
                f"{term.describe(float(x[k]))} at t = {t[k]:.6g} s, where its value is held; "
                f"extend the table, repeat its {row} value there if it stays constant, or end "
                "the run there with outside='error'."
            )
        elif length <= np.ptp(x) and np.min(excess) > _MAX_DISTANCE * (length + np.ptp(x)):
            apart.append(_describe_misfit(term, x))
    # Of two such tables, one may be a stop at the other end of a stroke.
    mechanism = equations.mechanism
    if is_complete and len(apart) == 1 and mechanism and not have_actions(mechanism.events):
        yield apart[0]


def _describe_misfit(term: TableArgumentTerm, x: Array) -> str:
    low, high = term.limits
    return (
        f"{term.part}: {term.table.arguments[term.axis]} of {term.table.name} is {x.min():.4g} to "
        f"{x.max():.4g} during the run, but the table is over {low:.6g} to {high:.6g}; check the "
        "units of both and the zero offset of the argument."
    )


def _has_other_unit(term: TableArgumentTerm, x: Array) -> bool:
    """Return True if an argument moves far less or far more than the range of its table."""
    low, high = term.limits
    largest, motion, rows = max(abs(low), abs(high)), float(np.ptp(x)), term.table.axes[term.axis]
    is_small = np.max(np.abs(x)) <= _SMALL_UNIT * largest and motion > _MIN_MOTION * (high - low)
    # Tables with rows in the range of the motion are meant for it.
    is_coarse = not np.any((rows > x.min()) & (rows < x.max()) & (rows != 0.0))
    is_large = motion > _MAX_STROKE * (high - low) and not term.table.is_repeated
    return bool((is_small and is_coarse) or is_large)


def _covers_turns(term: TableArgumentTerm) -> bool:
    """Return True if a table of one argument has whole turns and equal values at its ends."""
    if len(term.table.axes) > 1 or term.table.values[0] != term.table.values[-1]:
        return False
    return any(
        not quarters % 4
        for unit in _ANGLES
        if (quarters := _count_quarters(term, unit)) is not None
    )


def _count_quarters(term: TableArgumentTerm, unit: str) -> int | None:
    """Return the quarter turns that a table covers in a unit, or None if it covers others."""
    quarters = (term.limits[1] - term.limits[0]) / _ANGLES[unit][0]
    count = round(quarters)
    is_whole = 1 <= count <= _MAX_QUARTERS and abs(quarters - count) <= _ANGLE_ROUNDING
    return count if is_whole else None


def _find_unit_of_angle(
    term: TableArgumentTerm, equations: EquationsOfMotion, trajectory: Trajectory
) -> str:
    """Return the unit of a table over an angle whose argument is in the other one, or ""."""
    units = [unit for unit in _ANGLES if _count_quarters(term, unit) is not None]
    columns = [k for k, x in enumerate(equations.coordinates) if x.unit == "rad"]
    if not units or not columns:
        return ""
    first = trajectory.intervals[0]
    state = State(*(np.repeat(x[:1], len(columns) + 1, axis=0) for x in first.state))
    state.q[np.arange(len(columns)), columns] += _DIFFERENCE
    values = term.evaluate(np.full(len(state.q), first.t[0]), first.branch, state)
    slope = float(np.max(np.abs(values[:-1] - values[-1]))) / _DIFFERENCE
    return next((x for x in units if abs(slope / _ANGLES[x][1] - 1.0) < _ANGLE_ROUNDING), "")
