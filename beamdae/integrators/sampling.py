"""Samples of controllers: their times, and the held values after each sample."""

from __future__ import annotations

import math

import numpy as np

from beamdae.equations.controller_reads import compile_reads
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.smooth_intervals import SAME_TIME

Array = np.ndarray

# Times closer to a sample than this fraction of the sampling interval are equal up to rounding.
_SAME_SAMPLE = 1e-6


class Sampler:
    """Samples of all controllers of a run.

    Attributes
    ----------
    controllers
        The controllers; empty if there is nothing to sample.
    """

    def __init__(self, equations: EquationsOfMotion) -> None:
        self.controllers = equations.controllers
        self._tasks = [
            (term.controller, term.controller.every, term.rows, compile_reads(term, equations.p))
            for term in self.controllers
        ]

    def next_stop(self, t: float, end: float) -> float:
        """Return the time of the first sample after `t` [s]; `end` if none is before `end`."""
        # Of Python, which is faster than NumPy for single numbers.
        for _, every, *_ in self._tasks:
            following = (math.floor(t / every + _SAME_SAMPLE) + 1.0) * every
            if following < end - SAME_TIME * abs(following):
                end = following
        return end

    def update(self, t: float, branch: float, q: Array, v: Array) -> bool:
        """Set the values in `q` that controllers hold after the samples at `t` [s].

        Return False if no held value changes. All controllers read the state before the samples.

        Raises
        ------
        BeamdaeError
            If a law fails or does not return finite numbers; `q` is then unchanged.
        """
        updates = []
        for controller, every, rows, read in self._tasks:
            ratio = t / every
            index = round(ratio)
            if abs(ratio - index) <= _SAME_SAMPLE:
                values = controller.next_values(t, index, read(t, branch, q, v), q[rows])
                updates.append((rows, values))
        has_changed = False
        for rows, values in updates:
            # Lists of few numbers are compared faster than arrays.
            has_changed |= q[rows].tolist() != values.tolist()
            q[rows] = values
        return has_changed

    def sample(self, t: float, branch: float, state: State) -> State:
        """Return `state` with the values held after the samples at `t` [s]; see `update`.

        If no value changes, the object is the same.
        """
        q = state.q.copy()
        return state._replace(q=q) if self.update(t, branch, q, state.v) else state
