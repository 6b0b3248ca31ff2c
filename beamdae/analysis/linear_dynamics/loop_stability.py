"""Growing modes of control loops, linearized about the start of a run.

Modes of continuous loops, which consist of the outputs of `pid` and the loads that depend on them,
are those of the linearized mechanism. For sampled loops, the exact step of the linearized mechanism
between two samples is combined with the derivatives of the laws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.linalg as la

from beamdae.analysis.linear_dynamics.linear_model import StateReduction
from beamdae.analysis.linear_dynamics.linearization import (
    Linearization,
    active_equations,
    linearize_at_rest,
)
from beamdae.equations.assembly.building import remove_forces
from beamdae.equations.commands import Command, find_commanded_loads
from beamdae.equations.controller_reads import evaluate_reads
from beamdae.equations.equations_of_motion import ControllerTerm, EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.errors import BeamdaeError
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Dense eigenvalue problems of larger mechanisms take more than about a second.
_MAX_COORDINATES = 300
# The loop causes the growth if the mechanism with constant commands grows at less than this
# fraction of its rate.
_MAX_OPEN_RATIO = 0.5
# Growth rates below this fraction of the largest eigenvalue are rounding errors.
_EIGENVALUE_ROUNDING = 1e-13
# Samples at which a law is evaluated, and those at which its derivatives are tried: those whose
# commands are farthest from their extremes, which may be limits.
_MAX_SAMPLES, _MAX_TRIED_SAMPLES = 60, 12
# Steps of finite differences of laws, relative to the ranges of their arguments in the run. The
# derivatives of two adjacent steps agree unless the law has a limit or a switch there.
_LAW_STEPS = np.geomspace(3e-2, 1e-6, 10)
# Numbers of differences for a mean, and largest relative deviations of derivatives that agree.
# Means follow laws that round their readings, as those of encoders.
_DIFFERENCES = ((1, 1e-3), (9, 3e-2))
_BISECTIONS = 40


class GrowingMode(NamedTuple):
    """Mode of a linearized loop that grows as exp(rate t).

    Attributes
    ----------
    rate
        Growth rate [1/s].
    frequency
        Natural frequency [Hz]; zero if the mode does not oscillate.
    """

    rate: float
    frequency: float


def find_growing_mode(
    equations: EquationsOfMotion, trajectory: Trajectory, commands: Sequence[Command]
) -> GrowingMode | None:
    """Return the fastest growing mode of a loop that is stable with constant commands, or None.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    commands
        The commands of continuous loops. They are linearized at the first time at which they are
        all between their limits at rest.
    """
    if equations.n > _MAX_COORDINATES or equations.mechanism is None:
        return None
    try:
        if equations.controllers:
            return _find_sampled_mode(equations, trajectory)
        return _find_continuous_mode(equations, trajectory, commands)
    except (BeamdaeError, np.linalg.LinAlgError):
        # Some states cannot be linearized, such as those of massless points.
        return None


def _find_continuous_mode(
    equations: EquationsOfMotion, trajectory: Trajectory, commands: Sequence[Command]
) -> GrowingMode | None:
    assert equations.mechanism is not None
    loads = find_commanded_loads(equations.mechanism)
    without_loads = remove_forces(equations, loads) if loads else None
    time = _find_time_within_limits(trajectory, commands)
    if without_loads is None or time is None:
        return None
    q = trajectory.positions_at(np.array([time]))[0]
    lin = _linearize(equations, q, time)
    open_equations, _ = active_equations(without_loads, None, time)
    at = lin.time, lin.state
    closed_tangent = compute_tangent(lin.equations, *at)
    open_tangent = compute_tangent(open_equations, *at)
    tangent = lin.tangent._replace(
        stiffness=lin.tangent.stiffness - closed_tangent.stiffness + open_tangent.stiffness,
        damping=lin.tangent.damping - closed_tangent.damping + open_tangent.damping,
    )
    closed_matrix, open_matrix = (
        StateReduction(x, ()).linear_model(()).A for x in (lin, replace(lin, tangent=tangent))
    )
    return _select_mode(*map(np.linalg.eigvals, (closed_matrix, open_matrix)))


def _find_time_within_limits(trajectory: Trajectory, commands: Sequence[Command]) -> float | None:
    """Return the first time of a step at which the commands at rest are between their limits."""
    times = np.unique(np.concatenate([x.t for x in trajectory.intervals]))
    at, state = trajectory.at(times)
    rest = State(state.q, np.zeros_like(state.v), state.a, state.lam)
    is_within = np.ones(len(times), bool)
    for command in commands:
        values = command.evaluate(at, rest)[:, 0]
        is_within &= (values > command.low) & (values < command.high)
    return float(times[np.argmax(is_within)]) if is_within.any() else None


def _find_sampled_mode(equations: EquationsOfMotion, trajectory: Trajectory) -> GrowingMode | None:
    terms = equations.controllers
    every = terms[0].controller.every
    if any(x.controller.every != every for x in terms):
        return None
    laws = []
    for stream, term in enumerate(terms):
        law = _differentiate_law(equations, trajectory, term, stream)
        if law is None:
            return None
        laws.append(law)
    lin = _linearize(equations, trajectory.positions_at(np.array([trajectory.start]))[0])
    reduction = StateReduction(lin, ())
    model = reduction.linear_model([read for term in terms for read in term.reads])
    place = {int(row): k for k, row in enumerate(reduction.x_indices)}
    rows = [[place[k] for k in range(x.rows.start, x.rows.stop)] for x in terms]
    counts = [by_reads.shape[1] for by_reads, _ in laws]
    outputs = np.split(model.C, np.cumsum(counts)[:-1])
    samples = np.eye(len(model.A)), np.eye(len(model.A))
    for k, own in enumerate(rows):
        by_reads, by_values = laws[k]
        for sample in samples:
            sample[own] = 0.0
            sample[np.ix_(own, own)] = by_values
        samples[0][own] += by_reads @ outputs[k]
    step = la.expm(every * model.A)
    multipliers = (np.linalg.eigvals(step @ x).astype(complex) for x in samples)
    # Delays have multipliers of zero.
    closed_poles, open_poles = (
        np.log(np.where(x == 0.0, np.finfo(float).tiny, x)) / every for x in multipliers
    )
    return _select_mode(closed_poles, open_poles)


def _differentiate_law(
    equations: EquationsOfMotion, trajectory: Trajectory, term: ControllerTerm, stream: int
) -> tuple[Array, Array] | None:
    """Return the derivatives of the values of a law by its reads and the values before a sample.

    They are those of a sample at which the commands depend on the reads and the law has no limit or
    jump nearby, or between two samples with commands at opposite limits; None if there are
    no such samples, as for relays. Small jumps, by the rounding of readings, are averaged.
    """
    controller, every = term.controller, term.controller.every
    first, last = np.ceil(trajectory.start / every) + 1, np.floor(trajectory.end / every)
    if not controller.reads or last - first < 1:
        return None
    samples = first - 1 + np.geomspace(1, last - first + 1, _MAX_SAMPLES)
    indices = np.unique(samples.astype(int))
    indices = indices[indices <= last]
    times, states = trajectory.at(every * indices)
    before = trajectory.positions_at(every * (indices - 0.5))[:, term.rows]
    reads = evaluate_reads(term, equations.p, times, states)
    arguments = np.hstack([reads, before])
    n_reads, n_driven = reads.shape[1], len(controller.drives)
    scales = np.ptp(arguments, axis=0)
    scales = np.where(scales > 0.0, scales, 1.0 + np.abs(arguments[0]))
    newest = slice(n_driven * controller.delay, n_driven * (1 + controller.delay))

    def evaluate(index: int, x: Array) -> Array:
        return controller.next_values(every * index, index, x[:n_reads], x[n_reads:], stream)

    def depends_on_reads(index: int, x: Array) -> bool:
        """Return False for most laws that do not, or are at a limit, after two calls."""
        change = scales * np.where(np.arange(len(x)) < n_reads, _LAW_STEPS[0], 0.0)
        ends = [evaluate(index, x + sign * change)[newest] for sign in (1.0, -1.0)]
        return not np.array_equal(ends[0], ends[1])

    def scaled_slopes(index: int, x: Array, step: float, count: int) -> Array:
        """Return means of `count` backward and forward differences, times the scales.

        The shape is (2, values, arguments).
        """
        steps = step * np.linspace(1.0, 1.5, count)
        at = evaluate(index, x)
        columns = []
        for dx in np.diag(scales):
            slopes = [
                [(evaluate(index, x + h * dx) - at) / h for h in steps * sign]
                for sign in (-1.0, 1.0)
            ]
            columns.append(np.mean(slopes, axis=1))
        return np.stack(columns, axis=2)

    def differentiate(
        index: int, x: Array, count: int, max_deviation: float
    ) -> tuple[Array, Array] | None:
        coarse = scaled_slopes(index, x, _LAW_STEPS[0], count)
        derivatives = np.full(coarse.shape[1:], np.nan)
        for step in _LAW_STEPS[1:]:
            fine = scaled_slopes(index, x, step, count)
            slopes = np.concatenate([coarse, fine])
            # Values have different units.
            sizes = np.max(np.abs(fine), axis=(0, 2))[:, None]
            agrees = np.all(np.ptp(slopes, axis=0) <= max_deviation * sizes, axis=0)
            is_new = agrees & np.isnan(derivatives)
            derivatives = np.where(is_new, np.mean(fine, axis=0), derivatives)
            if np.all(np.isfinite(derivatives)):
                by_reads, by_values = np.split(derivatives / scales, [n_reads], axis=1)
                return (by_reads, by_values) if np.any(by_reads[newest]) else None
            coarse = fine
        return None

    values = np.array([evaluate(*x)[newest] for x in zip(indices.tolist(), arguments, strict=True)])
    low, high = np.min(values, axis=0), np.max(values, axis=0)
    half_range = np.maximum(0.5 * (high - low), np.finfo(float).tiny)
    extremity = np.max(np.abs(values - 0.5 * (low + high)) / half_range, axis=1)
    tried = np.argsort(extremity, kind="stable")[:_MAX_TRIED_SAMPLES]
    samples_within = [(int(indices[k]), arguments[k]) for k in tried]
    samples_within = [x for x in samples_within if depends_on_reads(*x)]
    for differences in _DIFFERENCES:
        for sample in samples_within:
            derivatives = differentiate(*sample, *differences)
            if derivatives is not None:
                return derivatives
    # All commands are at limits; between two opposite ones, a saturated law depends on the reads.
    jumps = np.abs(np.diff(values, axis=0))
    if not np.any(jumps):
        return None
    k, drive = np.unravel_index(np.argmax(jumps), jumps.shape)
    index, begin, end = int(indices[k]), arguments[k], arguments[k + 1]
    first_value, last_value = values[k : k + 2, drive]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (begin + end)
        value = evaluate(index, middle)[newest][drive]
        share = (value - first_value) / (last_value - first_value)
        if 0.25 < share < 0.75:
            results = (differentiate(index, middle, *x) for x in _DIFFERENCES)
            return next((x for x in results if x is not None), None)
        begin, end = (middle, end) if share <= 0.25 else (begin, middle)
    return None


def _linearize(equations: EquationsOfMotion, q: Array, t: float = 0.0) -> Linearization:
    """Linearize about rest at positions `q` and time `t` [s]."""
    full_equations = replace(equations, q0=q, v0=np.zeros(equations.n))
    active, time = active_equations(full_equations, None, t)
    rest = linearize_at_rest(active, time, lambda state: compute_tangent(active, time, state))
    return Linearization(active, full_equations, "rest", time, *rest)


def _select_mode(closed_poles: Array, open_poles: Array) -> GrowingMode | None:
    """Return the fastest growing mode of a closed loop, unless the open one grows similarly."""
    pole = closed_poles[np.argmax(closed_poles.real)]
    rounding = _EIGENVALUE_ROUNDING * float(np.max(np.abs(closed_poles.real)))
    is_growing = pole.real > rounding
    if not is_growing or np.max(open_poles.real) > _MAX_OPEN_RATIO * pole.real:
        return None
    return GrowingMode(float(pole.real), abs(float(pole.imag)) / (2.0 * np.pi))
