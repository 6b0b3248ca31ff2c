"""Smooth intervals of time between breakpoints, and the times that select branches of laws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Array = np.ndarray

SAME_TIME = 1e-12  # relative difference of equal times with different rounding
# Assumed duration of the motion [s] if no end time is given.
_DEFAULT_DURATION = 1.0


def interval_ends(breakpoints: Sequence[float], start: float, end: float) -> tuple[float, ...]:
    """Return the ends [s] of the smooth intervals from `start` to `end`, in ascending order."""
    tolerance = SAME_TIME * max(abs(start), abs(end))
    inner: list[float] = []
    for breakpoint_time in breakpoints:
        previous = inner[-1] if inner else start
        if breakpoint_time - previous > tolerance and end - breakpoint_time > tolerance:
            inner.append(breakpoint_time)
    return (*inner, end)


def branch_time(start: float, end: float) -> float:
    """Return the midpoint of an interval [s], by which laws select their branch."""
    return 0.5 * (start + end)


def time_on_branch(breakpoints: Sequence[float], t: float, end: float | None = None) -> Array:
    """Return (t, branch): `t` and a time inside the smooth interval that starts at `t` [s].

    Parameters
    ----------
    breakpoints
        Breakpoints of the equations [s].
    t
        Time [s].
    end
        End of the motion [s]; defaults to one second after `t`.
    """
    end = t + _DEFAULT_DURATION if end is None else end
    return np.array([t, branch_time(t, interval_ends(breakpoints, t, end)[0])])
