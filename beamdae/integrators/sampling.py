"""Samples of controllers: their times, and the held values after each sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.smooth_intervals import SAME_TIME
from beamdae.equations.watched_terms import compile_reads

if TYPE_CHECKING:
    from beamdae.parts.control.controller import Controller

Array = np.ndarray

# Increase of a held value that indicates an unstable loop if the run fails.
_UNSTABLE_GROWTH = 1e6
# Largest ratio of the logarithms of two consecutive growth factors. It is 2 for exponential growth,
# because the numbers of the samples double; a set point that leaves zero is a single jump.
_MAX_GROWTH_RATIO = 4.0
_MIN_GROWING_SAMPLES = 3
# Times closer to a sample than this fraction of the sampling interval are equal up to rounding.
_SAME_SAMPLE = 1e-6


class RepeatedSample(NamedTuple):
    """Sample repeated at the end of a run, to detect laws with memory outside the state.

    Attributes
    ----------
    controller
        The controller.
    arguments, result
        Arguments and result of `Controller._next_values`.
    """

    controller: Controller
    arguments: tuple[float, int, Array, Array, int]
    result: Array

    def repeat(self) -> None:
        """Take the sample again; raise BeamdaeError unless the result is the same."""
        self.controller._require_repeatable(*self.arguments, self.result)


def describe_growth(samples: Sequence[RepeatedSample]) -> str:
    """Return a sentence on the driven input that has increased most; "" below a factor of 1e6.

    Inputs that jump once, instead of growing exponentially, are not considered.
    """
    largest_factor, sentence = _UNSTABLE_GROWTH, ""
    for controller in dict.fromkeys(sample.controller for sample in samples):
        values = np.array([x.result for x in samples if x.controller is controller])
        for drive, column in zip(controller.drives, values.T, strict=False):
            used = column[column != 0.0]
            used = used[: np.argmax(np.abs(used)) + 1] if used.size else used
            if len(used) < _MIN_GROWING_SAMPLES:
                continue
            first, last = used[0], used[-1]
            before, latest = np.diff(np.log(np.abs(used[-_MIN_GROWING_SAMPLES:])))
            if latest > _MAX_GROWTH_RATIO * before:
                continue
            if abs(last) >= largest_factor * abs(first):
                largest_factor = abs(last / first)
                unit = "" if drive.unit == "-" else f" {drive.unit}"
                sentence = (
                    f"{controller.name} has changed {drive.name} from {first:.3g}{unit} to "
                    f"{last:.3g}{unit}, so its loop may be unstable; check the signs and sizes of "
                    "its gains, and every="
                )
    return sentence


class Sampler:
    """Samples of all controllers of a run.

    Samples 0, 1, 2, 4, 8, ... are taken twice, and again at the end of the run: pilot runs call the
    law, too, and would change the result in silence if it had memory outside the state.

    Parameters
    ----------
    equations
        Equations of motion.
    repeated
        List of all pilot runs and the main run, to which the sampler appends these samples.

    Attributes
    ----------
    equations, controllers
        The equations, and their controllers; empty if there is nothing to sample.
    """

    def __init__(self, equations: EquationsOfMotion, repeated: list[RepeatedSample]) -> None:
        self.equations, self.controllers = equations, equations.controllers
        self._repeated = repeated
        self._counts = [0 for _ in self.controllers]
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

    def sample(self, t: float, branch: float, state: State) -> State:
        """Return `state` with the values that controllers hold after the samples at `t` [s].

        If no value changes, the object is the same. All controllers read the state before the
        samples.

        Raises
        ------
        BeamdaeError
            If a law fails, does not return finite numbers, or returns other numbers if the sample
            is repeated.
        """
        q = state.q.copy()
        for k, (controller, every, rows, read) in enumerate(self._tasks):
            ratio = t / every
            index = round(ratio)
            if abs(ratio - index) <= _SAME_SAMPLE:
                reads, before = read(t, branch, state.q, state.v), state.q[rows]
                q[rows] = values = controller._next_values(t, index, reads, before, k)
                count = self._counts[k]
                if count & (count - 1) == 0:
                    arguments = t, index, reads.copy(), before.copy(), k
                    sample = RepeatedSample(controller, arguments, values)
                    sample.repeat()
                    self._repeated.append(sample)
                self._counts[k] = count + 1
        return state if np.array_equal(q, state.q) else state._replace(q=q)
