"""Warnings about forces that change within fixed steps, which the steps pass over or blur."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formula_forces import (
    FormulaForceTerm,
    compile_formula_forces,
    name_formula_forces,
)
from beamdae.equations.structure import cache_on_owner
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray

# Missed impulse of a force, relative to its impulse in the run, from which on a run has a warning.
_MIN_SHARE = 8e-3
# A force is sampled in steps longer than this fraction of the run, ...
_SAMPLE_SPACING = 1.0 / 1024.0
# ... and in steps at nodes with a second difference above this fraction of its range, ...
_MIN_BEND = 0.2
# ... but at most in so many steps, with so many samples.
_MAX_BENT_STEPS = 1024
_SAMPLES_OF_BENT_STEP = 15
# Steps with smaller missed values, relative to the largest one, separate pulses.
_QUIET = 1e-3
# A pulse is resolved if it differs less from lines through the nodes, relative to its range.
_MIN_DEVIATION = 0.05
# Entries of a generalized force with smaller ranges, relative to the largest one, are rounding.
_MIN_RANGE = 1e-6


class _MissedImpulse(NamedTuple):
    """Impulse of one force that steps missed.

    Attributes
    ----------
    total, missed
        Integrals of the absolute force, and sums of the absolute values missed by each group of
        steps, per entry of the force (size,).
    largest, t
        Largest missed value of a group, and middle of the step with the largest one [s], per entry.
    """

    total: Array
    missed: Array
    largest: Array
    t: Array


def unresolved_force_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[str]:
    """Yield one warning per formula whose integral in fixed steps is wrong by more than 0.8 %.

    Fixed steps evaluate a force at their ends only. The force is evaluated between them on the
    interpolated motion; peaks shorter than both a step and a thousandth of the run may be missed.

    Parameters
    ----------
    equations
        The equations of motion of all parts.
    trajectory
        The steps of a run with fixed steps. Runs of which only some steps are stored have no
        warnings.
    """
    intervals = [x for x in trajectory.intervals if x.record is None and len(x.nodes) > 1]
    spacing = _SAMPLE_SPACING * (trajectory.end - trajectory.start)
    impulses: dict[tuple[str, int, bool], list[_MissedImpulse]] = {}
    for interval in intervals:
        # Events change laws, and switch parts.
        for name, k, is_rate, term in _name_terms(interval.active_equations(equations)):
            of_interval = _measure(term, interval, spacing, is_rate)
            impulses.setdefault((name, k, is_rate), []).append(of_interval)
    for (name, _, is_rate), of_force in impulses.items():
        total = np.sum([x.total for x in of_force], axis=0)
        is_relevant = total > _MIN_RANGE * np.max(total)
        missed = np.where(is_relevant, np.sum([x.missed for x in of_force], axis=0), 0.0)
        share = missed / np.where(total > 0.0, total, 1.0)
        entry = int(np.argmax(share))
        if not share[entry] > _MIN_SHARE:
            continue
        worst = max(of_force, key=lambda x: x.largest[entry])
        step = max(float(np.diff(x.nodes).max()) for x in intervals)
        integral, cause = (
            ("change of this state", "its rate") if is_rate else ("impulse of this force", "it")
        )
        yield (
            f"{name}: with steps of {step:.2g} s, the {integral} is wrong by "
            f"{_format_percent(share[entry])} %, mostly at t = {worst.t[entry]:.4g} s, because "
            f"{cause} changes within steps; reduce the step, or choose adaptive steps."
        )


@cache_on_owner
def _name_terms(
    equations: EquationsOfMotion,
) -> tuple[tuple[str, int, bool, FormulaForceTerm], ...]:
    """Return the name of the part of each formula, its number in the part, and True for rates."""
    terms = compile_formula_forces(equations)
    names = name_formula_forces(equations) if terms else []
    parts = {} if equations.mechanism is None else equations.mechanism.parts
    states = {name for name, part in parts.items() if part.is_state}
    return tuple((x, names[:k].count(x), x in states, terms[k]) for k, x in enumerate(names))


def _measure(
    term: FormulaForceTerm, interval: Interval, spacing: float, is_rate: bool
) -> _MissedImpulse:
    """Compare the trapezoidal rule on the steps with that on samples between them."""

    def evaluate(t: Array, q: Array, v: Array) -> Array:
        values = term.evaluate(t, interval.branch, q, v)
        if is_rate:
            # The first row is x' - rate, which is zero but for errors.
            values[:, 0] -= np.asarray(term.operator[[0]] @ v.T)[0]
        return values

    rows = interval.rows
    at_nodes = evaluate(interval.nodes, rows.q, rows.v)
    nodes, gaps = interval.nodes, np.diff(interval.nodes)[:, None]
    total = np.sum(0.5 * gaps * (np.abs(at_nodes[1:]) + np.abs(at_nodes[:-1])), axis=0)
    none = np.zeros(at_nodes.shape[1])
    counts = _count_samples(gaps[:, 0], at_nodes, spacing)
    (steps,) = np.nonzero(counts)
    if not len(steps):
        return _MissedImpulse(total, none, none, none)
    step = np.repeat(np.arange(len(gaps)), counts)
    starts = np.cumsum(counts) - counts
    share = (np.arange(len(step)) - starts[step] + 1.0) / (counts[step] + 1.0)
    t = nodes[step] + share * gaps[step, 0]
    state = interval.at(t)
    force = evaluate(t, state.q, state.v)
    share = share[:, None]
    line = (1.0 - share) * at_nodes[step] + share * at_nodes[step + 1]
    size = np.maximum(at_nodes.max(axis=0), force.max(axis=0))
    size -= np.minimum(at_nodes.min(axis=0), force.min(axis=0))
    deviation = np.maximum.reduceat(np.abs(force - line), starts[steps])
    weight = gaps[steps] / (counts[steps] + 1.0)[:, None]
    missed = weight * np.add.reduceat(force - line, starts[steps])
    total += np.sum(weight * np.add.reduceat(np.abs(force) - np.abs(line), starts[steps]), axis=0)
    # Errors of the steps of one pulse cancel; those of pulses with quiet steps between them do not.
    is_loud = (np.abs(missed) > _QUIET * np.max(np.abs(missed), axis=0)).any(axis=1)
    is_first = is_loud & (~np.append(False, is_loud[:-1]) | (np.diff(steps, prepend=-2) > 1))
    if not is_loud.any():
        return _MissedImpulse(total, none, none, none)
    group = np.cumsum(is_first)[is_loud] - 1
    sums, blurred = np.zeros((group[-1] + 1, len(none))), np.zeros((group[-1] + 1, len(none)))
    np.add.at(sums, group, missed[is_loud])
    np.maximum.at(blurred, group, deviation[is_loud])
    of_groups = np.where(blurred > _MIN_DEVIATION * size, np.abs(sums), 0.0)
    worst = steps[is_loud][np.argmax(np.abs(missed[is_loud]), axis=0)]
    middle = nodes[worst] + 0.5 * gaps[worst, 0]
    return _MissedImpulse(total, of_groups.sum(axis=0), of_groups.max(axis=0), middle)


def _count_samples(gaps: Array, at_nodes: Array, spacing: float) -> Array:
    """Return the number of samples in each step."""
    counts = (gaps / spacing).astype(int)
    size = np.ptp(at_nodes, axis=0)
    bend = np.zeros(len(at_nodes))
    if len(at_nodes) > 2:
        bends = np.abs(at_nodes[2:] - 2.0 * at_nodes[1:-1] + at_nodes[:-2])
        bend[1:-1] = np.max(bends / np.where(size > 0.0, size, np.inf), axis=1)
    # A pulse that begins after the first or ends before the last node.
    bend[[0, -1]] = bend[[1, -2]]
    of_step = np.maximum(bend[1:], bend[:-1])
    # The flanks of a pulse compensate for errors at its peak.
    wide = np.convolve(of_step > _MIN_BEND, np.ones(5))[2:-2] > 0.0
    (bent,) = np.nonzero(wide & (gaps > 0.0))
    if len(bent) > _MAX_BENT_STEPS:
        bent = bent[np.argsort(of_step[bent])[-_MAX_BENT_STEPS:]]
    counts[bent] = np.maximum(counts[bent], _SAMPLES_OF_BENT_STEP)
    return counts


def _format_percent(share: float) -> str:
    percent = 100.0 * share
    return f"{percent:.0f}" if percent >= 10.0 else f"{percent:.1f}"
