"""Warnings about control loops that grow exponentially or switch between their limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Intervals of the second half of a run in which changes of values are compared. The largest changes
# in equal windows are the envelope of a vibration.
_INTERVALS = 256
# Numbers of windows: many for fast growth, few for slow vibrations.
_WINDOW_COUNTS = (8, 4)
# Growth of the envelope in the second half of a run. Values that increase with the third power of
# time, such as integrals of positions at constant acceleration, grow by a factor of 4, or of 14
# from 0.4 of the run on.
_MIN_GROWTH = 30.0
# Bounds of the exponents of growth from window to window, relative to their mean. They are 1 if the
# growth is exponential, and 0.7 to 1.35 for powers of time from 0.4 of the run on.
_LEAST_EXPONENT, _LARGEST_EXPONENT = 0.75, 1.33
# Changes below this fraction of the largest value are rounding errors.
_ROUNDING = 1e-9
# Held values may grow earlier and stop to grow at a limit of the law or of the motion: ends of such
# growth, which lasts from half of this time on, as fractions of the run.
_ENDS_OF_GROWTH = tuple(2.0 ** (-k / 4) for k in range(1, 13))
# Smallest changes in the last quarter of the run, relative to those at the end of the growth.
_MIN_REMAINING_CHANGE = 0.5
# A loop switches between its limits if a held value is at both of them in turn at least this often
# in the last samples of the run, at least once per this number of samples, ...
_MAX_LAST_SAMPLES = 256
_MIN_REVERSALS = 6
_MAX_SAMPLES_PER_REVERSAL = 6
# ... and if it has at least this number of other values, unlike a switch.
_MIN_VALUES_BETWEEN = 3


def growing_loop_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning if a value that a controller holds, or a state, grows exponentially.

    An unstable loop reaches the end of a run if it grows slowly or the run is short. Values that
    increase like ramps, steps and powers of time have no warning.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    rows = _describe_rows(equations)
    if not rows or not trajectory.end > trajectory.start:
        return
    start, duration = trajectory.start, trajectory.end - trajectory.start

    def values(begin: float, end: float) -> Array:
        times = start + duration * np.linspace(begin, end, _INTERVALS + 1)
        return trajectory.positions_at(times)[:, list(rows)]

    growth = _exponential_growth(values(0.5, 1.0))
    k = int(np.argmax(growth))
    if growth[k] > 0.0:
        name, remedy = list(rows.values())[k]
        yield (
            f"{name} grows exponentially, by a factor of {growth[k]:.2g} in the second half of the "
            f"run, so its loop seems to be unstable; check the signs and sizes of its {remedy}."
        )
    elif equations.controllers:
        yield from _limited_growth_warnings(equations, trajectory, rows, values)


def _limited_growth_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    rows: dict[int, tuple[str, str]],
    values: Callable[[float, float], Array],
) -> Iterator[str]:
    """Yield a warning if limits stop the growth of a held value, which does not decay again.

    `values` returns the rows of the coordinates `rows` at times from one fraction of the run to
    another one.
    """
    every = {
        term.rows.start + k: term.controller.every
        for term in equations.controllers
        for k in range(len(term.controller.drives))
    }
    is_held = np.array([row in every for row in rows])
    remaining = np.abs(np.diff(values(0.75, 1.0), axis=0)).max(axis=0)
    for end in _ENDS_OF_GROWTH:
        growing = values(0.5 * end, end)
        changes = np.abs(np.diff(growing, axis=0)).max(axis=0)
        goes_on = is_held & (remaining >= _MIN_REMAINING_CHANGE * changes)
        growth = np.where(goes_on, _exponential_growth(growing), 0.0)
        k = int(np.argmax(growth))
        if growth[k] > 0.0:
            name, remedy = list(rows.values())[k]
            begin, last = (
                trajectory.start + x * (trajectory.end - trajectory.start) for x in (0.5 * end, end)
            )
            yield (
                f"{name} grows exponentially, by a factor of {growth[k]:.2g} from t = {begin:.3g} "
                f"to {last:.3g} s, and does not decay again, so its loop seems to be unstable; "
                f"check the signs and sizes of its {remedy}."
            )
            return
    if equations.laws:  # which may excite the loop until the end
        return
    for row, period in every.items():
        name, remedy = rows[row]
        limits = _find_switched_limits(trajectory, row, period)
        if limits is not None:
            yield (
                f"{name} switches between its limits, {limits[0]:.4g} and {limits[1]:.4g}, within "
                "a few samples until the end of the run, so its loop seems to be unstable, or to "
                f"amplify noise; check the signs and sizes of its {remedy}."
            )
            return


def _find_switched_limits(
    trajectory: Trajectory, row: int, every: float
) -> tuple[float, float] | None:
    """Return the limits of a held value that switches between them, or None if it does not."""
    count = int((trajectory.end - trajectory.start) / every)
    if count < 2 * _MIN_REVERSALS:
        return None
    at = trajectory.start + every * (np.arange(count) + 0.5)
    held = trajectory.positions_at(at[-2 * _MAX_LAST_SAMPLES :])[:, row]
    last = held[len(held) // 2 :]
    low, high = float(last.min()), float(last.max())
    rounding = _ROUNDING * max(abs(low), abs(high))
    is_low, is_high = last <= low + rounding, last >= high - rounding
    sides = is_high[is_low | is_high]
    reversals = int(np.count_nonzero(np.diff(sides)))
    between = held[(held > low + rounding) & (held < high - rounding)]
    if (
        reversals < max(_MIN_REVERSALS, len(last) / _MAX_SAMPLES_PER_REVERSAL)
        or len(np.unique(between)) < _MIN_VALUES_BETWEEN
    ):
        return None
    return low, high


def _describe_rows(equations: EquationsOfMotion) -> dict[int, tuple[str, str]]:
    """Return name and remedy of the coordinates that controllers hold, and of other states."""
    controllers = {term.controller.name for term in equations.controllers}
    rows = {
        k: (part.name, "gains")
        for part in equations.parts
        if part.is_state and part.name not in controllers
        for k in range(part.rows.start, part.rows.stop)
    }
    for term in equations.controllers:
        for k, drive in enumerate(term.controller.drives):
            name = f"{term.controller.name}: {drive.name}"
            rows[term.rows.start + k] = name, "gains, and every="
    return rows


def _exponential_growth(values: Array) -> Array:
    """Return the growth factor of each column of values (k, size); 0 if not exponential."""
    changes = np.abs(np.diff(values, axis=0))
    rounding = _ROUNDING * np.abs(values).max(axis=0)
    factors = np.zeros(values.shape[1])
    for count in _WINDOW_COUNTS:
        envelope = changes.reshape(count, -1, values.shape[1]).max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            exponents = np.diff(np.log(envelope), axis=0)
            mean = exponents.mean(axis=0)
            relative = exponents / mean
            growth = np.exp(count * mean)
        is_uniform = (relative > _LEAST_EXPONENT) & (relative < _LARGEST_EXPONENT)
        is_growing = (growth > _MIN_GROWTH) & is_uniform.all(axis=0)
        is_growing &= (envelope > rounding).all(axis=0)
        factors = np.maximum(factors, np.where(is_growing, growth, 0.0))
    return factors
