"""Warnings about runs in which the argument of a table leaves a table that holds its values."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.table_arguments import compile_table_arguments, find_distinct
from beamdae.results.trajectory import Trajectory

# Distances outside a table that is zero or constant there, relative to its range, that are errors
# of units: after a start inside the table, and during the whole run.
_MAX_EXCESS, _MAX_DISTANCE = 300.0, 100.0
_MIN_EXCESS = 1e-3  # distance outside a table relative to its range; less hardly changes its value


def table_range_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning per argument and side of a table that a run leaves.

    Tables over time are exempt, because they usually hold their last value, and so are sides at
    which the table is zero or constant: one-sided forces and limits continue there as they should,
    unless the argument is so far outside that the units seem to be wrong.

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
        times, values = [], []
        for interval in trajectory.intervals:
            if term.part not in interval.inactive:
                times.append(interval.t)
                values.append(term.evaluate(interval.t, interval.branch, interval.state))
        if not times:
            continue
        t, x = np.concatenate(times), np.concatenate(values)
        low, high = term.limits
        excesses = (low - x, x - high)
        for side, row, excess in zip((0, -1), ("first", "last"), excesses, strict=True):
            k = int(np.argmax(excess))
            is_constant = term.continues_as_constant(side)
            # One-sided forces begin far outside, such as the pad under a falling body.
            is_far = excess[0] <= 0.0 and excess[k] > _MAX_EXCESS * (high - low)
            is_far |= float(np.min(excess)) > _MAX_DISTANCE * (high - low)
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
