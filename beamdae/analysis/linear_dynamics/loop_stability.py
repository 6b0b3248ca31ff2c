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

from beamdae.analysis.linear_dynamics.law_derivatives import differentiate_law
from beamdae.analysis.linear_dynamics.linear_model import StateReduction
from beamdae.analysis.linear_dynamics.linearization import (
    Linearization,
    active_equations,
    linearize_at_rest,
)
from beamdae.equations.assembly.building import remove_forces
from beamdae.equations.commands import Command, find_commanded_loads
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
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
        law = differentiate_law(equations, trajectory, term, stream)
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
