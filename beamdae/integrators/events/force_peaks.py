"""Detection of steps that pass over a peak of a force that is a formula.

The force is evaluated between the places at which the method evaluates it, and compared with the
polynomial through its values there. The error test sees what these values show, but no short pulse
and no narrow region of the motion in which the force acts; the run then restarts where the peak
begins.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.watched_terms import FormulaForceTerm, TableArgumentTerm
from beamdae.integrators.error_control import motion_rate
from beamdae.integrators.events.watches import Stop, locate_minima
from beamdae.integrators.run_plan import RunPlan
from beamdae.integrators.step_history import RunSegment
from beamdae.results.trajectory import Interval

Array = np.ndarray

# Samples of a run are at most this fraction of its duration apart.
SAMPLE_SPACING = 1.0 / 1024.0
# A peak differs from the polynomial by more than this fraction of the range of the force, and by
# more than the difference of the force between the nodes around it.
_MIN_PEAK = 0.2
# Smaller differences, relative to the largest value of the force, are rounding errors.
_ROUNDING = 1e-12
# Peaks in one step are separated by samples lower than this fraction of the highest one.
_QUIET = 1e-2
# The run restarts at the last sample before a peak that is lower than this fraction of its height.
_FOOT = 1e-6
# Change of a velocity that matters, relative to the tolerance.
_SIGNIFICANT_CHANGE = 10.0
# Peaks whose impulse, estimated from the samples, has less than this share of that change are not
# examined further.
_MIN_COARSE_WEIGHT = 1e-2
# Peaks are located by repeated sampling between the neighbors of the highest sample.
_REFINEMENTS = 3
_REFINED_SAMPLES = 33
# Corrections of the times at which arguments pass rows of tables, which are interpolated linearly.
_ROW_CORRECTIONS = 3
# Arguments that change by smaller factors between two samples need no further samples.
_MIN_CHANGE = 2.0
# Change of a first-order state, relative to its size, for the derivative of its rate.
_RELATIVE_CHANGE = 1e-6


@dataclass(frozen=True)
class ForcePeakWatch:
    """Watch of peaks of forces that steps passed over.

    Attributes
    ----------
    terms, arguments
        Forces that may have narrow peaks, and the arguments of their tables.
    spacing
        Largest distance of samples [s].
    weigh_at
        Function of the time [s], the branch and the state. It returns a function of an impulse on
        all coordinates (n,) that the steps have missed, which returns the largest change of a
        velocity relative to the change that matters.
    state_scales
        Scales of the first-order states by their indices.
    """

    terms: Sequence[FormulaForceTerm]
    arguments: Sequence[TableArgumentTerm]
    spacing: float
    weigh_at: Callable[[float, float, State], Callable[[Array], float]]
    state_scales: Mapping[int, float]

    def find_first(self, segment: RunSegment, row: int) -> Stop | None:
        """Return the first peak that a step passed over, see `Watch`."""
        # Between frequent samples of controllers, a search would cost more than the steps.
        is_long = self.spacing <= segment.history.longest_gap(row)
        tail = segment.tail(row) if is_long or self.arguments else None
        if tail is None:
            return None
        interval, begin = tail
        first = int(np.searchsorted(interval.nodes, begin))
        gaps = np.diff(interval.nodes[first:])
        counts = (gaps / self.spacing).astype(int)
        inside = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + 1
        spacings = np.repeat(gaps / (counts + 1), counts)
        t = np.repeat(interval.nodes[first:-1], counts) + inside * spacings
        turns = [_locate_turns(self.terms, interval, first, t)] if len(t) else []
        active = (x for x in self.arguments if x.part not in interval.inactive)
        rows = [_locate_rows(x, interval, first) for x in active]
        t = np.unique(np.concatenate([t, *turns, *rows]))
        t = t[t > interval.nodes[first]]
        if not len(t):
            return None
        samples = _Samples(interval, t)
        gap = np.searchsorted(interval.nodes, samples.t) - 1
        peaks = (self._find_first_of_force(x, samples, first, gap) for x in self.terms)
        return min((peak for peak in peaks if peak is not None), default=None)

    def _find_first_of_force(
        self, term: FormulaForceTerm, samples: _Samples, first: int, gap: Array
    ) -> Stop | None:
        """Return the first peak of one force; the samples follow the nodes with the indices `gap`.

        The steps before this peak are kept: an earlier peak, even a lower one, would be lost.
        """
        interval, t = samples.interval, samples.t
        at_nodes = term.evaluate(interval.times, *(x[:, term.columns] for x in interval.rows[:2]))
        force = samples.evaluate(term)
        missed = force - samples.interpolate(at_nodes)
        excess = np.abs(missed)
        threshold = _peak_threshold(force, at_nodes, first, gap)
        is_peak = ((excess > threshold) & np.isfinite(excess)).any(axis=1)
        height = excess.max(axis=1)
        weigh_impulse = None
        for rows, k in _candidates(np.where(is_peak, height, 0.0), height, gap):
            if weigh_impulse is None:
                state = State(*(x[0] for x in interval.at(t[k : k + 1])))
                weigh_impulse = self.weigh_at(float(t[k]), interval.branch, state)
                weigh = self._weigh_missed(term, t[k], interval.branch, state, weigh_impulse)
            before, after = interval.nodes[gap[k]], interval.nodes[gap[k] + 1]
            if rows.start and gap[rows.start - 1] == gap[k]:
                before = t[rows.start - 1]
            if rows.stop < len(t) and gap[rows.stop] == gap[k]:
                after = t[rows.stop]
            times = np.concatenate([[before], t[rows], [after]])
            values = np.pad(missed[rows], ((1, 1), (0, 0)))
            if weigh(times, values) < _MIN_COARSE_WEIGHT:
                continue
            at = k - rows.start + 1
            probe, left, right = float(t[k]), times[at - 1], times[at + 1]
            for _ in range(_REFINEMENTS):
                t_near = np.union1d(np.linspace(left, right, _REFINED_SAMPLES), [probe])
                near = _Samples(interval, t_near)
                of_peak = near.evaluate(term) - near.interpolate(at_nodes)
                highest = int(np.argmax(np.abs(of_peak).max(axis=1)))
                probe = float(t_near[highest])
                times, values = np.append(times, t_near), np.concatenate([values, of_peak])
                left, right = t_near[max(highest - 1, 0)], t_near[min(highest + 1, len(t_near) - 1)]
            if weigh(times, values) > 1.0:
                # Where a smooth peak falls to 1 %, a thousandth of its impulse is still outside.
                same_step = np.flatnonzero(gap[:k] == gap[k])
                feet = same_step[height[same_step] <= _FOOT * height[k]]
                begin = t[feet[-1]] if len(feet) else interval.nodes[gap[k]]
                return Stop(float(begin), probe, force=term.part)
        return None

    def _weigh_missed(
        self,
        term: FormulaForceTerm,
        t: float,
        branch: float,
        state: State,
        weigh: Callable[[Array], float],
    ) -> Callable[[Array, Array], float]:
        """Return a function of times (k,) [s] and the values (k, size) that steps have missed.

        It returns the weight of their impulse. Fast first-order states follow their inputs: missed
        rates change them by the rate over their relaxation rate, not over the whole time.
        """
        relaxation = np.zeros(len(state.q))
        for i in self.state_scales.keys() & set(term.columns.tolist()):
            change = np.zeros((2, len(state.q)))
            change[1, i] = _RELATIVE_CHANGE * max(self.state_scales[i], abs(state.q[i]))
            states = (x[:, term.columns] for x in (state.q + change, np.tile(state.v, (2, 1))))
            values = term.evaluate(np.tile([t, branch], (2, 1)), *states)
            relaxation[i] = abs(term.operator.T @ (values[1] - values[0]))[i] / change[1, i]

        def weigh_missed(times: Array, values: Array) -> float:
            impulse = term.operator.T @ _integrate(times, values)
            return weigh(impulse / (1.0 + np.ptp(times) * relaxation))

        return weigh_missed


def _peak_threshold(force: Array, at_nodes: Array, first: int, gap: Array) -> Array:
    """Return the deviation from a polynomial of samples (k, size) above which there is a peak.

    `at_nodes` are the values at all nodes, and the samples follow the nodes with the indices `gap`.
    """
    seen = at_nodes[first:]
    highest = np.maximum(seen.max(axis=0), force.max(axis=0))
    lowest = np.minimum(seen.min(axis=0), force.min(axis=0))
    size, largest = highest - lowest, np.maximum(np.abs(highest), np.abs(lowest))
    change = np.abs(at_nodes[gap + 1] - at_nodes[gap])
    return np.maximum(np.maximum(_MIN_PEAK * size, _ROUNDING * largest), change)


def _integrate(times: Array, values: Array) -> Array:
    """Return the integral (size,) of values (k, size) at times (k,) [s] in any order."""
    order = np.argsort(times, kind="stable")
    times, values = times[order], values[order]
    return 0.5 * np.diff(times) @ (values[1:] + values[:-1])


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


class _Turns(NamedTuple):
    """Times [s] around turns of arguments of a formula, and its signs there.

    Attributes
    ----------
    left, right
        Times of samples between which an argument turns or passes zero.
    column
        Index of the argument.
    sign
        Its sign before it turns; 0 if it passes zero.
    """

    left: Array
    right: Array
    column: Array
    sign: Array

    @classmethod
    def find(cls, t: Array, arguments: Array) -> _Turns:
        """Find turns towards zero, and passages, between samples (rows, k) of arguments at `t`."""
        signs, distances = np.sign(arguments), np.abs(arguments)
        keeps_sign = signs[1:] == signs[:-1]
        at, neighbors = distances[1:-1], (distances[:-2], distances[2:])
        is_turn = keeps_sign[1:] & keeps_sign[:-1] & (at <= np.minimum(*neighbors))
        # Otherwise, the samples resolve the argument.
        turns, columns = np.nonzero(is_turn & (_MIN_CHANGE * at < np.maximum(*neighbors)))
        passages, others = np.nonzero(~keeps_sign)
        return cls(
            t[np.concatenate([turns, passages])],
            t[np.concatenate([turns + 2, passages + 1])],
            np.concatenate([columns, others]),
            np.concatenate([signs[turns + 1, columns], np.zeros(len(others))]),
        )


def _locate_turns(
    terms: Sequence[FormulaForceTerm], interval: Interval, first: int, t: Array
) -> Array:
    """Return times [s] near samples at `t` at which arguments of formulas turn or pass zero.

    Peaks may be too narrow for samples, such as those of exp(-(x / w)^2), but these arguments
    change as slowly as the motion.
    """
    samples = _Samples(interval, np.union1d(interval.nodes[first:], t))
    turns = [_Turns.find(samples.t, np.nan_to_num(samples.evaluate_arguments(x))) for x in terms]
    left, right, column, sign = map(np.concatenate, zip(*turns, strict=True))
    ends = np.cumsum([0, *(len(x.left) for x in turns)]).tolist()

    def distances(near: Array) -> Array:
        values, count = np.empty_like(near), near.shape[1]
        samples = _Samples(interval, near.ravel())
        for term, (begin, end) in zip(terms, pairwise(ends), strict=True):
            arguments = samples.evaluate_arguments(term, slice(begin * count, end * count))
            arguments = arguments.reshape(end - begin, count, arguments.shape[1])
            values[begin:end] = arguments[np.arange(end - begin), :, column[begin:end]]
        return np.where(sign[:, None] == 0.0, np.abs(values), sign[:, None] * values)

    return locate_minima(left, right, distances) if len(left) else left


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


def watch_forces(
    terms: Sequence[FormulaForceTerm],
    arguments: Sequence[TableArgumentTerm],
    plan: RunPlan,
    rtol: float,
) -> ForcePeakWatch:
    """Return the watch of forces in a run with the tolerance `rtol`.

    An impulse matters if it changes a velocity, or a first-order state, by more than ten
    tolerances.
    """
    limits = _SIGNIFICANT_CHANGE * rtol * plan.scales
    states = np.asarray(plan.equations.states, int)
    rates = np.full(len(limits), motion_rate(plan))
    rates[states] = 1.0

    def weigh_at(t: float, branch: float, state: State) -> Callable[[Array], float]:
        if plan.equations.is_driven:
            return weigh_reactions
        time = np.array([t, branch])

        def weigh(impulse: Array) -> float:
            change, _ = plan.starter.solve_saddle(time, state.q, state.v, impulse, 0.0)
            change[states] = impulse[states]
            return float(np.max(np.abs(change) / (limits * rates)))

        return weigh

    def weigh_reactions(impulse: Array) -> float:
        # Forces that change reactions, but no velocities, always matter; rates of states do not.
        change = np.abs(impulse[states]) / limits[states]
        return math.inf if np.delete(impulse, states).any() else float(np.max(change, initial=0.0))

    state_scales = dict(zip(states.tolist(), plan.scales[states].tolist(), strict=True))
    return ForcePeakWatch(terms, arguments, SAMPLE_SPACING * plan.duration, weigh_at, state_scales)


def _candidates(peak_height: Array, height: Array, gap: Array) -> Iterator[tuple[slice, int]]:
    """Yield the samples of each peak in order of time, and the index of its highest sample.

    `peak_height` is the height of the samples that may belong to a peak, otherwise zero.
    """
    (starts,) = np.nonzero(np.diff(gap, prepend=-1))
    ends, highests = np.append(starts[1:], len(gap)), np.maximum.reduceat(peak_height, starts)
    for k in np.flatnonzero(highests).tolist():
        first, end, highest = int(starts[k]), int(ends[k]), highests[k]
        quiet = first + np.flatnonzero(height[first:end] <= _QUIET * highest)
        for before, after in pairwise([first - 1, *quiet.tolist(), end]):
            rows = slice(before + 1, after)
            if peak_height[rows].any():
                yield rows, rows.start + int(np.argmax(peak_height[rows]))
