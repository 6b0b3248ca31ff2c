"""Warnings about runs in which the argument of a table leaves it, or hardly uses its range."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.table_arguments import (
    TableArgumentTerm,
    compile_table_arguments,
    find_distinct,
)
from beamdae.errors import format_percent
from beamdae.parts.events import have_actions
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Distances outside a table that is zero or constant there, relative to its range, that are errors
# of units: after a start inside the table, during the whole run, and at any time if the argument
# is not in m. Strokes of 1 m are 125 times the length of an end zone of 8 mm, and 1000 times that
# of a pad of 1 mm; with the argument in mm by mistake, these are 1.25e5 and 1e6.
_MAX_EXCESS, _MAX_DISTANCE, _MAX_EXCESS_OF_OTHER_UNIT = 300.0, 100.0, 2000.0
# Derivative of an argument by a coordinate in m, above which it is in mm or cm. Distances to
# a point at 45 deg have 0.7 per m, and levers multiply it by less.
_MIN_SLOPE_OF_OTHER_UNIT = 30.0
# Distance outside a table that is zero there, relative to its range and to the motion of the
# argument during the whole run, of tables that are never entered by mistake, as by a missing zero
# offset. Bumpers and stops are nearer, or the argument moves by less than the range.
_MAX_DISTANCE_OF_MOTION = 2.0
_MIN_EXCESS = 1e-3  # distance outside a table relative to its range; less hardly changes its value
# Arguments in wrong units, such as m in a table over mm, stay near zero: within this share of the
# range inside the table and of its largest row, and within this one outside. Smaller motions than
# the last share are those of parts at rest.
_MAX_USED_SHARE, _MAX_MOTION, _MIN_USED_SHARE = 0.01, 0.03, 1e-6
# Characteristics through zero, such as those of springs, are often made for larger motions. There,
# the share is that of a unit that is 1000 times as large.
_MAX_SHARE_AROUND_ZERO = 1e-3
# Rows between the least and the largest argument: tables with more rows there are meant for it.
_MAX_USED_ROWS = 1
# Tables over one or several turns, in rad or degrees, such as those of a press or an engine.
_TURNS = np.outer((2.0 * np.pi, 360.0), (1.0, 2.0, 4.0))
_TURN_TOLERANCE = 1e-3  # relative difference of a table from whole turns
# Quarter turn, in the unit of a table, and the derivative of an argument in the other unit by an
# angle in rad.
_QUARTERS = {"degrees": (90.0, 1.0), "rad": (0.5 * np.pi, 180.0 / np.pi)}
_DIFFERENCE, _MAX_ERROR_OF_DERIVATIVE = 1e-5, 1e-4
_MAX_TURN_ERROR = 5e-3  # of a table, in quarter turns; covers 6.28
_MAX_QUARTERS = 16
_MIN_TURN_EXCESS = 0.05  # distance outside a table of turns relative to its range


def table_range_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning per argument and side of a table that a run leaves, or hardly uses.

    Tables over time are exempt, because they usually hold their last value, and so are sides at
    which the table is zero or constant: one-sided forces and limits continue there as they should,
    unless the argument is so far outside that the units seem to be wrong. Tables of whole turns
    that the argument passes probably repeat.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    for term in find_distinct(compile_table_arguments(equations)):
        if term.is_limited or not term.depends_on_motion:
            continue
        intervals = [x for x in trajectory.intervals if term.part not in x.inactive]
        if not intervals:
            continue
        t = np.concatenate([x.t for x in intervals])
        x = np.concatenate([term.evaluate(x.t, x.branch, x.state) for x in intervals])
        if sentence := _describe_unit_of_angle(term, equations, trajectory):
            yield sentence
            continue
        yield from _unused_range_warnings(term, x)
        if term.table.is_repeated:
            continue
        low, high = term.limits
        excesses = (low - x, x - high)
        if _covers_turns(term) and np.max(excesses) > _MIN_TURN_EXCESS * (high - low):
            k = int(np.argmax(np.maximum(*excesses)))
            yield (
                f"{term.describe(float(x[k]))} at t = {t[k]:.6g} s, where its value is held; if "
                "the table repeats with each turn, pass outside='repeat'."
            )
            continue
        for side, row, excess in zip((0, -1), ("first", "last"), excesses, strict=True):
            k = int(np.argmax(excess))
            is_constant = term.continues_as_constant(side)
            # One-sided forces begin far outside, such as the pad under a falling body.
            is_far = excess[0] <= 0.0 and excess[k] > _MAX_EXCESS * (high - low)
            is_far |= float(np.min(excess)) > _MAX_DISTANCE * (high - low)
            if excess[k] > _MAX_EXCESS_OF_OTHER_UNIT * (high - low):
                slope = _largest_slope(term, equations, trajectory, "m")
                is_far |= slope > _MIN_SLOPE_OF_OTHER_UNIT
            if is_constant and is_far:
                yield (
                    f"{term.describe(float(x[k]))} at t = {t[k]:.6g} s by "
                    f"{excess[k] / (high - low):.2g} times its length; check the units of the "
                    "table and of its argument."
                )
            elif excess[k] > _MIN_EXCESS * (high - low) and not is_constant:
                yield (
                    f"{term.describe(float(x[k]))} at t = {t[k]:.6g} s, where its value is held; "
                    f"extend the table, repeat its {row} value there if it stays constant, or end "
                    "the run there with outside='error'."
                )


def unentered_table_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning if the argument of a table that is zero outside moves, but never enters it.

    Several such tables may be stops at both ends of a stroke, and are exempt like those in models
    with events that act.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    intervals = trajectory.intervals
    if equations.mechanism is None or have_actions(equations.mechanism.events):
        return
    sentences = []
    for term in find_distinct(compile_table_arguments(equations)):
        is_partial = any(term.part in x.inactive for x in intervals)
        if term.is_limited or term.table.is_repeated or not term.depends_on_motion or is_partial:
            continue
        x = np.concatenate([term.evaluate(x.t, x.branch, x.state) for x in intervals])
        low, high = term.limits
        first, last = float(x.min()), float(x.max())
        distance, side = max((low - last, 0), (first - high, -1))
        length, motion = high - low, last - first
        if (
            length <= motion
            and _MAX_DISTANCE_OF_MOTION * (length + motion) < distance
            and distance <= _MAX_DISTANCE * length  # `table_range_warnings` reports larger ones
            and term.continues_as_zero(side)
        ):
            sentences.append(
                f"{term.part}: {term.table.arguments[term.axis]} of {term.table.name} is "
                f"{first:.4g} to {last:.4g} during the whole run, outside the range {low:.6g} to "
                f"{high:.6g} of the table, where its value is zero; check the zero offset and the "
                "unit of the argument."
            )
    if len(sentences) == 1:
        yield sentences[0]


def _covers_turns(term: TableArgumentTerm) -> bool:
    """Return True if a table of one argument has whole turns and equal values at its ends."""
    low, high = term.limits
    if len(term.table.axes) > 1 or term.table.values[0] != term.table.values[-1]:
        return False
    return bool(np.any(np.abs(_TURNS - (high - low)) <= _TURN_TOLERANCE * _TURNS))


def _describe_unit_of_angle(
    term: TableArgumentTerm, equations: EquationsOfMotion, trajectory: Trajectory
) -> str:
    """Return a warning if an angle in rad enters a table over degrees, or vice versa, or ""."""
    low, high = term.limits
    for unit, (quarter, slope) in _QUARTERS.items():
        turns = (high - low) / quarter
        if not 1 <= round(turns) <= _MAX_QUARTERS or abs(turns - round(turns)) > _MAX_TURN_ERROR:
            continue
        largest_slope = _largest_slope(term, equations, trajectory, "rad")
        if abs(largest_slope / slope - 1.0) < _MAX_ERROR_OF_DERIVATIVE:
            other, factor = ("rad", "180 / pi") if unit == "degrees" else ("degrees", "pi / 180")
            return (
                f"{term.part}: {term.table.arguments[term.axis]} of {term.table.name} is an angle "
                f"in {other}, but the table seems to be over {unit} ({low:.6g} to {high:.6g}); "
                f"multiply the argument by {factor}."
            )
    return ""


def _largest_slope(
    term: TableArgumentTerm, equations: EquationsOfMotion, trajectory: Trajectory, unit: str
) -> float:
    """Return the largest derivative of an argument by the coordinates in a unit, at the start."""
    columns = [k for k, x in enumerate(equations.coordinates) if x.unit == unit]
    first = trajectory.intervals[0]
    state = State(*(np.repeat(x[:1], len(columns) + 1, axis=0) for x in first.state))
    state.q[np.arange(len(columns)), columns] += _DIFFERENCE
    values = term.evaluate(np.full(len(state.q), first.t[0]), first.branch, state)
    return float(np.max(np.abs(values[:-1] - values[-1]), initial=0.0) / _DIFFERENCE)


def _unused_range_warnings(term: TableArgumentTerm, values: Array) -> Iterator[str]:
    """Yield a warning if an argument moves in a table, but so little that its unit seems wrong."""
    (low, high), rows = term.limits, term.table.axes[term.axis]
    inside = np.clip(values, low, high)
    first, last = float(inside.min()), float(inside.max())
    share, size = (last - first) / (high - low), max(abs(low), abs(high))
    max_share = _MAX_SHARE_AROUND_ZERO if low < 0.0 < high else _MAX_USED_SHARE
    is_near_zero = max(abs(first), abs(last)) <= max_share * size
    is_small = np.ptp(values) < _MAX_MOTION * (high - low)
    used_rows = np.count_nonzero((rows > first) & (rows < last))
    if (
        is_near_zero
        and is_small
        and _MIN_USED_SHARE < share < max_share
        and used_rows <= _MAX_USED_ROWS
    ):
        yield (
            f"{term.part}: {term.table.arguments[term.axis]} of {term.table.name} is "
            f"{first:.4g} to {last:.4g} during the whole run, {format_percent(share)} of the range "
            f"{low:.6g} to {high:.6g} of the table; check the units of the table and of its "
            "argument."
        )
