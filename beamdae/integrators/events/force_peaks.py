"""Detection of steps that pass over a peak of a force that is a formula.

The force is evaluated between the places at which the method evaluates it, and compared with the
polynomial through its values there. The error test sees what these values show, but no short pulse
and no narrow region of the motion in which the force acts; the run then restarts where the peak
begins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.watched_terms import FormulaForceTerm, TableArgumentTerm
from beamdae.integrators.error_control import motion_rate
from beamdae.integrators.events.watches import Stop
from beamdae.integrators.run_plan import RunPlan
from beamdae.integrators.step_history import RunSegment
from beamdae.results.sampled_functions import find_turns, locate_minima
from beamdae.results.trajectory import Interval

Array = np.ndarray

# Samples of a run are at most this fraction of its duration apart.
SAMPLE_SPACING = 1.0 / 1024.0
# A peak differs from the polynomial by more than this fraction of the range of the force, and by
# more than the difference of the force between the nodes around it.
_MIN_PEAK = 0.2
# Smaller differences, relative to the largest value of the force, are rounding errors.
_ROUNDING = 1e-12
# The run restarts at the last sample before a peak that is lower than this fraction of its height:
# where a smooth peak falls to 1 %, a thousandth of its impulse is still outside.
_FOOT = 1e-6
# Change of a velocity that matters, relative to the tolerance.
_SIGNIFICANT_CHANGE = 10.0
# Peaks are located by repeated sampling between the neighbors of the highest sample.
_REFINEMENTS = 3
_REFINED_SAMPLES = 33
# Corrections of the times at which arguments pass rows of tables, which are interpolated linearly.
_ROW_CORRECTIONS = 3


@dataclass(frozen=True)
class ForcePeakWatch:
    """Watch of peaks of forces that steps passed over.

    A peak matters if its impulse changes a velocity, or a first-order state, by more than ten
    tolerances.

    Attributes
    ----------
    terms, arguments
        Forces that may have narrow peaks, and the arguments of their tables.
    plan, rtol
        Plan of the run and its tolerance.
    """

    terms: Sequence[FormulaForceTerm]
    arguments: Sequence[TableArgumentTerm]
    plan: RunPlan
    rtol: float

    def find_first(self, segment: RunSegment, row: int) -> Stop | None:
        """Return the first peak that a step passed over, see `Watch`."""
        spacing = SAMPLE_SPACING * self.plan.duration
        # Between frequent samples of controllers, a search would cost more than the steps.
        is_long = spacing <= segment.history.longest_gap(row)
        tail = segment.tail(row) if is_long or self.arguments else None
        if tail is None:
            return None
        interval, begin = tail
        first = int(np.searchsorted(interval.nodes, begin))
        nodes = interval.nodes[first:]
        counts = 1 + (np.diff(nodes) / spacing).astype(int)
        gap = np.repeat(np.arange(len(counts)), counts)
        shares = (np.arange(len(gap)) - (np.cumsum(counts) - counts)[gap]) / counts[gap]
        t = np.append(nodes[gap] + shares * np.diff(nodes)[gap], nodes[-1])
        turns = [_locate_turns(self.terms, interval, t)] if len(t) > len(nodes) else []
        active = (x for x in self.arguments if x.part not in interval.inactive)
        rows = [_locate_rows(x, interval, first) for x in active]
        samples = _Samples(interval, np.unique(np.concatenate([t, *turns, *rows])))
        if len(samples.t) <= len(nodes):
            return None
        peaks = (self._find_first_of_force(x, samples, first) for x in self.terms)
        return min((peak for peak in peaks if peak is not None), default=None)

    def _find_first_of_force(
        self, term: FormulaForceTerm, samples: _Samples, first: int
    ) -> Stop | None:
        """Return the first peak of one force; the samples begin at the node with index `first`.

        The steps before this peak are kept: an earlier peak, even a lower one, would be lost.
        """
        interval, t = samples.interval, samples.t
        at_nodes = term.evaluate(interval.times, *(x[:, term.columns] for x in interval.rows[:2]))
        force = samples.evaluate(term)
        missed = force - samples.interpolate(at_nodes)
        height = np.abs(missed).max(axis=1)
        step = np.clip(np.searchsorted(interval.nodes, t) - 1, first, None)
        is_peak = (np.abs(missed) > _peak_threshold(force, at_nodes, first, step)).any(axis=1)
        # Nothing is missed at nodes, so that a peak is between two of them.
        is_peak &= np.isfinite(height) & ~np.isin(t, interval.nodes)
        (rows,) = np.nonzero(is_peak)
        for peak in np.split(rows, 1 + np.flatnonzero(np.diff(rows) > 1)) if len(rows) else ():
            k = peak[np.argmax(height[peak])]
            around = slice(peak[0] - 1, peak[-1] + 2)
            times, values = t[around], missed[around]
            left, probe, right = t[k - 1 : k + 2]
            for _ in range(_REFINEMENTS):
                near = _Samples(
                    interval, np.union1d(np.linspace(left, right, _REFINED_SAMPLES), probe)
                )
                of_peak = near.evaluate(term) - near.interpolate(at_nodes)
                times, values = np.append(times, near.t), np.concatenate([values, of_peak])
                highest = int(np.argmax(np.abs(of_peak).max(axis=1)))
                last = len(near.t) - 1
                left, probe, right = (near.t[np.clip(highest + x, 0, last)] for x in (-1, 0, 1))
            order = np.argsort(times, kind="stable")
            times, values = times[order], values[order]
            impulse = 0.5 * np.diff(times) @ (values[1:] + values[:-1])
            if self._weigh(term, t[k], interval, impulse) > 1.0:
                (feet,) = np.nonzero(height[:k] <= _FOOT * height[k])
                begin = max(t[feet].max(initial=-np.inf), interval.nodes[step[k]])
                return Stop(float(begin), float(probe), force=term.part)
        return None

    def _weigh(self, term: FormulaForceTerm, t: float, interval: Interval, missed: Array) -> float:
        """Return the largest change of a velocity, relative to the change that matters.

        `missed` is the impulse of the force at `t` [s] that the steps have missed, (size,).
        """
        e, impulse = self.plan.equations, term.operator.T @ missed
        change, states = np.zeros(e.n), np.asarray(e.states, int)
        if not e.is_driven:
            q, v = (x[0] for x in interval.at(np.array([t]))[:2])
            time = np.array([t, interval.branch])
            change = self.plan.starter.solve_saddle(time, q, v, impulse, 0.0)[0]
        elif np.delete(impulse, states).any():
            # Forces that change reactions, but no velocities, always matter.
            return math.inf
        change[states] = impulse[states]
        return float(np.max(np.abs(change) / self._changes_that_matter))

    @cached_property
    def _changes_that_matter(self) -> Array:
        changes = _SIGNIFICANT_CHANGE * self.rtol * self.plan.scales
        rates = np.full(len(changes), motion_rate(self.plan))
        rates[list(self.plan.equations.states)] = 1.0
        return changes * rates


def _peak_threshold(force: Array, at_nodes: Array, first: int, step: Array) -> Array:
    """Return the deviation from a polynomial of samples (k, size) above which there is a peak.

    `at_nodes` are the values at all nodes; the samples are in the steps after the nodes `step`.
    """
    seen = at_nodes[first:]
    highest = np.maximum(seen.max(axis=0), force.max(axis=0))
    lowest = np.minimum(seen.min(axis=0), force.min(axis=0))
    size, largest = highest - lowest, np.maximum(np.abs(highest), np.abs(lowest))
    change = np.abs(at_nodes[step + 1] - at_nodes[step])
    return np.maximum(np.maximum(_MIN_PEAK * size, _ROUNDING * largest), change)


class _Samples:
    """Motion of an interval at times inside its steps."""

    def __init__(self, interval: Interval, t: Array) -> None:
        self.interval, self.t = interval, t
        self._weights = interval.weights_at(t)

    def evaluate(self, term: FormulaForceTerm) -> Array:
        """Return a force on the polynomials of the motion, (samples, size)."""
        return term.evaluate(self.interval.with_branch(self.t), *self._move(term))

    def evaluate_arguments(self, term: FormulaForceTerm, rows: slice = slice(None)) -> Array:
        """Return `FormulaForceTerm.evaluate_arguments` at some of the samples."""
        motion = (x[rows] for x in self._move(term))
        return term.evaluate_arguments(self.interval.with_branch(self.t[rows]), *motion)

    def _move(self, term: FormulaForceTerm) -> tuple[Array, Array]:
        q, v = (x[:, term.columns] for x in self.interval.rows[:2])
        weights = self._weights
        positions = weights.positions @ q + weights.positions_by_velocities @ v
        return positions, weights.velocities @ v

    def interpolate(self, values: Array) -> Array:
        """Return the polynomials through values at the nodes, (nodes, size)."""
        return np.asarray(self._weights.velocities @ values)


def _locate_turns(terms: Sequence[FormulaForceTerm], interval: Interval, t: Array) -> Array:
    """Return times [s] near samples at `t` at which arguments of formulas turn or pass zero.

    Peaks may be too narrow for samples, such as those of exp(-(x / w)^2), but these arguments
    change as slowly as the motion.
    """
    samples = _Samples(interval, t)
    left, right, columns, signs = [], [], [], []
    for term in terms:
        arguments = np.nan_to_num(samples.evaluate_arguments(term))
        turns, of_turns = find_turns(t, arguments)
        passages, of_passages = np.nonzero(np.diff(np.sign(arguments), axis=0))
        left.append(t[np.concatenate([turns - 1, passages])])
        right.append(t[np.concatenate([turns, passages]) + 1])
        columns.append(np.concatenate([of_turns, of_passages]))
        # The distance from zero is a signed one until an argument has passed zero.
        signs.append(np.append(np.sign(arguments[turns, of_turns]), np.zeros(len(passages))))
    ends = np.cumsum([0, *map(len, left)]).tolist()
    if not ends[-1]:
        return np.zeros(0)
    column, sign = np.concatenate(columns), np.concatenate(signs)[:, None]

    def distances(near: Array) -> Array:
        values, count = np.empty_like(near), near.shape[1]
        samples = _Samples(interval, near.ravel())
        for term, (begin, end) in zip(terms, pairwise(ends), strict=True):
            arguments = samples.evaluate_arguments(term, slice(begin * count, end * count))
            arguments = arguments.reshape(end - begin, count, arguments.shape[1])
            values[begin:end] = arguments[np.arange(end - begin), :, column[begin:end]]
        return np.where(sign == 0.0, np.abs(values), sign * values)

    return locate_minima(np.concatenate(left), np.concatenate(right), distances)


def _locate_rows(term: TableArgumentTerm, interval: Interval, first: int) -> Array:
    """Return times [s] at which an argument passes rows of its table, if a step passes several."""
    t, motion = interval.nodes[first:], State(*(x[first:] for x in interval.rows))
    x = term.argument.values(interval.times[first:], motion)
    knots = term.table.list_knots(term.axis, float(x.min()), float(x.max()))
    place = np.searchsorted(knots, x)
    # A peak lies between two other rows.
    (passed,) = np.nonzero((np.abs(np.diff(place)) > 1) & (np.diff(t) > 0.0))
    ranges = [np.arange(*sorted(place[k : k + 2])) for k in passed]
    k = np.repeat(passed, [len(rows) for rows in ranges])
    levels = knots[np.concatenate([np.zeros(0, int), *ranges])]
    rates = (x[k + 1] - x[k]) / (t[k + 1] - t[k])
    times = t[k] + (levels - x[k]) / rates
    for _ in range(_ROW_CORRECTIONS if len(k) else 0):
        values = term.argument.values(interval.with_branch(times), interval.at(times))
        times = np.clip(times + (levels - values) / rates, t[k], t[k + 1])
    return times
