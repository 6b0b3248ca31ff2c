"""Derivatives of the laws of sampled controllers, by differences at samples of a run.

A law is a function of the user, which may have limits, switches, delays and rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from beamdae.equations.controller_reads import evaluate_reads
from beamdae.equations.equations_of_motion import ControllerTerm, EquationsOfMotion
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Samples at which a law is evaluated, and those at which its derivatives are tried: those whose
# commands are farthest from their extremes, which may be limits.
_MAX_SAMPLES, _MAX_TRIED_SAMPLES = 60, 12
# Steps of finite differences, relative to the ranges of the arguments in the run. The derivatives
# of two adjacent steps agree unless the law has a limit or a switch there.
_STEPS = np.geomspace(3e-2, 1e-6, 10)
# Numbers of differences for a mean, and largest relative deviations of derivatives that agree.
# Means follow laws that round their readings, as those of encoders.
_DIFFERENCES = ((1, 1e-3), (9, 3e-2))
# Between two samples, the point at which a command is in the middle of its range.
_BISECTIONS, _MIDDLE = 40, (0.25, 0.75)


def differentiate_law(
    equations: EquationsOfMotion, trajectory: Trajectory, term: ControllerTerm, stream: int
) -> tuple[Array, Array] | None:
    """Return the derivatives of the values of a law by its reads and the values before a sample.

    They are those of a sample at which the commands depend on the reads and the law has no limit or
    jump nearby, or between two samples with commands at opposite limits; None if there are
    no such samples, as for relays. Small jumps, by the rounding of readings, are averaged.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    term
        The controller.
    stream
        Its number among the controllers, which selects its random numbers.
    """
    every = term.controller.every
    first, last = np.ceil(trajectory.start / every) + 1, np.floor(trajectory.end / every)
    if not term.controller.reads or last - first < 1:
        return None
    samples = first - 1 + np.geomspace(1, last - first + 1, _MAX_SAMPLES)
    indices = np.unique(samples.astype(int))
    indices = indices[indices <= last]
    times, states = trajectory.at(every * indices)
    before = trajectory.positions_at(every * (indices - 0.5))[:, term.rows]
    reads = evaluate_reads(term, equations.p, times, states)
    law = _SampledLaw(term, stream, indices, np.hstack([reads, before]), reads.shape[1])
    for find_points in (law.points_within_limits, law.points_between_limits):
        points = list(find_points())
        for count, max_deviation in _DIFFERENCES:
            for point in points:
                derivatives = law.differentiate(*point, count, max_deviation)
                if derivatives is not None:
                    return derivatives
    return None


@dataclass(frozen=True, eq=False)
class _SampledLaw:
    """Law of a controller at samples of a run.

    Attributes
    ----------
    term, stream
        See `differentiate_law`.
    indices
        Numbers (m,) of samples.
    arguments
        Reads, then values before the sample (m, n).
    n_reads
        Number of the reads.
    """

    term: ControllerTerm
    stream: int
    indices: Array
    arguments: Array
    n_reads: int

    def evaluate(self, index: int, x: Array) -> Array:
        """Return the values after sample number `index`."""
        controller, n = self.term.controller, self.n_reads
        return controller.next_values(controller.every * index, index, x[:n], x[n:], self.stream)

    @cached_property
    def scales(self) -> Array:
        """Ranges (n,) of the arguments, or typical values of constant ones."""
        ranges = np.ptp(self.arguments, axis=0)
        return np.where(ranges > 0.0, ranges, 1.0 + np.abs(self.arguments[0]))

    @cached_property
    def newest(self) -> slice:
        """The new commands among the values, which delays hold back."""
        controller = self.term.controller
        n_driven = len(controller.drives)
        return slice(n_driven * controller.delay, n_driven * (1 + controller.delay))

    @cached_property
    def commands(self) -> Array:
        """New commands of the samples."""
        samples = zip(self.indices.tolist(), self.arguments, strict=True)
        return np.array([self.evaluate(*x)[self.newest] for x in samples])

    def points_within_limits(self) -> Iterator[tuple[int, Array]]:
        """Yield samples with commands that depend on the reads, the most central ones first."""
        low, high = np.min(self.commands, axis=0), np.max(self.commands, axis=0)
        half_range = np.maximum(0.5 * (high - low), np.finfo(float).tiny)
        extremity = np.max(np.abs(self.commands - 0.5 * (low + high)) / half_range, axis=1)
        for k in np.argsort(extremity, kind="stable")[:_MAX_TRIED_SAMPLES]:
            index, x = int(self.indices[k]), self.arguments[k]
            if self._depends_on_reads(index, x):
                yield index, x

    def _depends_on_reads(self, index: int, x: Array) -> bool:
        """Return False for most laws that do not, or are at a limit, after two calls."""
        change = self.scales * np.where(np.arange(len(x)) < self.n_reads, _STEPS[0], 0.0)
        ends = [self.evaluate(index, x + sign * change)[self.newest] for sign in (1.0, -1.0)]
        return not np.array_equal(ends[0], ends[1])

    def points_between_limits(self) -> Iterator[tuple[int, Array]]:
        """Yield a point between two samples, at which the command that jumps most is half way.

        If all commands are at limits, a saturated law depends on the reads there.
        """
        jumps = np.abs(np.diff(self.commands, axis=0))
        if not np.any(jumps):
            return
        k, drive = np.unravel_index(np.argmax(jumps), jumps.shape)
        index, (begin, end) = int(self.indices[k]), self.arguments[k : k + 2]
        first, last = self.commands[k : k + 2, drive]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (begin + end)
            share = (self.evaluate(index, middle)[self.newest][drive] - first) / (last - first)
            if _MIDDLE[0] < share < _MIDDLE[1]:
                yield index, middle
                return
            begin, end = (middle, end) if share <= _MIDDLE[0] else (begin, middle)

    def differentiate(
        self, index: int, x: Array, count: int, max_deviation: float
    ) -> tuple[Array, Array] | None:
        """Return the derivatives by the reads and by the values before the sample.

        The derivatives are means of `count` differences, which agree for two adjacent steps up to
        `max_deviation`; None if they do not, or if no command depends on the reads.
        """
        coarse = self._scaled_slopes(index, x, _STEPS[0], count)
        derivatives = np.full(coarse.shape[1:], np.nan)
        for step in _STEPS[1:]:
            fine = self._scaled_slopes(index, x, step, count)
            slopes = np.concatenate([coarse, fine])
            # Values have different units.
            sizes = np.max(np.abs(fine), axis=(0, 2))[:, None]
            agrees = np.all(np.ptp(slopes, axis=0) <= max_deviation * sizes, axis=0)
            is_new = agrees & np.isnan(derivatives)
            derivatives = np.where(is_new, np.mean(fine, axis=0), derivatives)
            if np.all(np.isfinite(derivatives)):
                by_reads, by_values = np.split(derivatives / self.scales, [self.n_reads], axis=1)
                return (by_reads, by_values) if np.any(by_reads[self.newest]) else None
            coarse = fine
        return None

    def _scaled_slopes(self, index: int, x: Array, step: float, count: int) -> Array:
        """Return means of `count` backward and forward differences, times the scales.

        The shape is (2, values, arguments).
        """
        steps = step * np.linspace(1.0, 1.5, count)
        at = self.evaluate(index, x)
        columns = []
        for dx in np.diag(self.scales):
            slopes = [
                [(self.evaluate(index, x + h * dx) - at) / h for h in steps * sign]
                for sign in (-1.0, 1.0)
            ]
            columns.append(np.mean(slopes, axis=1))
        return np.stack(columns, axis=2)
