"""Samples of controllers: their times, and the held values after each sample."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import ControllerTerm, EquationsOfMotion, State

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
        self._readers = [_create_reader(term, equations.p) for term in self.controllers]

    def next_time(self, t: float) -> float:
        """Return the time of the first sample after `t` [s]; infinity without controllers."""
        # Of Python, which is faster than NumPy for single numbers.
        times = [
            (math.floor(t / every + _SAME_SAMPLE) + 1.0) * every
            for every in (term.controller.every for term in self.controllers)
        ]
        return min(times, default=math.inf)

    def sample(self, time: Array, state: State) -> Array | None:
        """Return the coordinates after the samples at `time` = (t, branch); None if none is due.

        All controllers read the state before the samples.

        Raises
        ------
        BeamdaeError
            If a law fails or does not return finite numbers.
        """
        t, q = float(time[0]), None
        for term, read in zip(self.controllers, self._readers, strict=True):
            controller = term.controller
            index = round(t / controller.every)
            if abs(t / controller.every - index) > _SAME_SAMPLE:
                continue
            q = state.q.copy() if q is None else q
            values = controller.next_values(t, index, read(time, state), state.q[term.rows])
            q[term.rows] = values
        return q


def _create_reader(term: ControllerTerm, p: Array) -> Callable[[Array, State], Array]:
    """Return a function of (t, branch) and the state that evaluates the reads of a controller.

    A call takes microseconds. Local coordinates are summed without SciPy, whose products take ten
    times as long for few rows.
    """
    if not term.reads:
        return lambda time, state: np.zeros(0)
    operator = sp.coo_array(sp.vstack([o.operator for o in term.reads]))
    weights, row, column = operator.data, operator.row, operator.col
    count = operator.shape[0]
    ends = np.cumsum([0, *(o.operator.shape[0] for o in term.reads)]).tolist()
    functions = [
        (o.function.evaluator(), slice(*rows), p[o.data])
        for o, rows in zip(term.reads, pairwise(ends), strict=True)
    ]

    def read(time: Array, state: State) -> Array:
        q, v = (np.bincount(row, weights * x[column], count) for x in state[:2])
        values = [
            evaluate(time, q[rows], v[rows], data)[0].copy() for evaluate, rows, data in functions
        ]
        return values[0] if len(values) == 1 else np.concatenate(values)

    return read
