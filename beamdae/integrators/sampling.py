"""Samples of controllers: their times, and the held values after each sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from beamdae.equations.equations_of_motion import ControllerTerm, State

Array = np.ndarray

# Times closer to a sample than this fraction of the sampling interval are equal up to rounding.
_SAME_SAMPLE = 1e-6


def next_sample_time(controllers: Sequence[ControllerTerm], t: float) -> float:
    """Return the time of the first sample after `t` [s]; infinity without controllers."""
    times = (
        (np.floor(t / every + _SAME_SAMPLE) + 1.0) * every
        for every in (term.controller.every for term in controllers)
    )
    return float(min(times, default=np.inf))


def sample(
    controllers: Sequence[ControllerTerm], p: Array, time: Array, state: State
) -> Array | None:
    """Return the coordinates after the samples at `time` = (t, branch); None if none is due.

    All controllers read the state before the samples.

    Raises
    ------
    BeamdaeError
        If a law fails or does not return finite numbers.
    """
    due = [term for term in controllers if _is_due(term, time[0])]
    if not due:
        return None
    q = state.q.copy()
    for term in due:
        index, reads = round(time[0] / term.controller.every), term.measure(p, time, state)
        values = state.q[term.rows]
        q[term.rows] = term.controller.next_values(float(time[0]), index, reads, values)
    return q


def _is_due(term: ControllerTerm, t: float) -> bool:
    samples = t / term.controller.every
    return bool(abs(samples - np.round(samples)) <= _SAME_SAMPLE)
