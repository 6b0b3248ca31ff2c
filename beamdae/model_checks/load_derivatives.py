"""Derivatives of loads about a state of a run, and the loads that may supply energy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formula_forces import name_copies
from beamdae.equations.formulations.sums import term_data
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_ROUNDING = 1e-9  # of derivatives of loads


class RunState(NamedTuple):
    """State of a run: equations of all parts and of the active ones, (t, branch), and the state."""

    whole: EquationsOfMotion
    equations: EquationsOfMotion
    time: Array
    state: State


def read_state(equations: EquationsOfMotion, trajectory: Trajectory, t: float) -> RunState:
    """Return the state of a run at a time [s]."""
    times = np.array([t])
    (time,), state = trajectory.at(times)
    interval = trajectory.intervals[int(trajectory.interval_index(times)[0])]
    if interval.configuration is not None:
        state = state._replace(lam=interval.configuration.select_multipliers(state.lam))
    active = interval.active_equations(equations)
    return RunState(equations, active, time, State(*(x[0] for x in state)))


class LoadDerivatives(NamedTuple):
    """Derivatives dF/dq and dF/dv (n, n) of forces."""

    stiffness: sp.csr_array
    damping: sp.csr_array


def differentiate_loads(at: RunState) -> dict[str, LoadDerivatives]:
    """Return the derivatives of the loads that may supply energy, by part.

    Energy is supplied by circulatory stiffness and negative damping. Forces with inertia, and those
    on first-order states alone, are no loads.
    """
    loads: dict[str, LoadDerivatives] = {}
    for name, load in _differentiate_copies(at):
        before = loads.get(name)
        pairs = [load] if before is None else [before, load]
        loads[name] = LoadDerivatives(*map(sum, zip(*pairs, strict=True)))
    return loads


def _differentiate_copies(at: RunState) -> Iterator[tuple[str, LoadDerivatives]]:
    e, state = at.equations, at.state
    if e.mechanism is None:
        return
    states = {x.name for x in e.parts if x.is_state}
    for term, names in zip(e.forces, name_copies(e), strict=True):
        kernel, count, size = term.kernel, term.count, term.kernel.local.size
        if term.rotation is not None or kernel.has_accelerations or states.issuperset(names):
            continue
        operator = sp.csr_array(term.operator)
        q, v, scales = (
            np.reshape(x, (count, size))
            for x in (operator @ state.q, operator @ state.v, abs(operator) @ e.position_scales)
        )
        rows = np.zeros(0, int) if term.rows is None else term.rows.indices
        lam = state.lam[rows].reshape(count, -1)
        time = np.repeat(at.time[None], count, axis=0)
        values = kernel.motion_derivatives(time, q, v, lam, term_data(e, term).T)
        # Columns are consecutive.
        values = np.swapaxes(values.reshape(count, 2, size, size), 2, 3)
        is_source = _supplies_energy(values * scales[:, None, :, None] * scales[:, None, None])
        for k in np.flatnonzero(is_source).tolist():
            own = operator[k * size : (k + 1) * size]
            stiffness, damping = (sp.csr_array(own.T @ (x @ own)) for x in values[k])
            yield names[k], LoadDerivatives(stiffness, damping)


def _supplies_energy(values: Array) -> Array:
    """Return True (k,) for loads (k, 2, n, n) of circulatory stiffness or negative damping."""
    values = np.where(np.isfinite(values), values, 0.0)
    transposed = np.swapaxes(values, 2, 3)
    largest = np.max(np.abs(values), axis=(2, 3), initial=0.0)
    least = np.min(np.linalg.eigvalsh((values + transposed)[:, 1]), axis=1, initial=0.0)
    skew = np.max(np.abs((values - transposed)[:, 0]), axis=(1, 2), initial=0.0)
    return (skew > _ROUNDING * largest[:, 0]) | (-least > _ROUNDING * largest[:, 1])
