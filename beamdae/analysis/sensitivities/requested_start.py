"""Requested starts of runs of neighboring models, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from beamdae.analysis.sensitivities.implicit import (
    RegularPoint,
    differentiate_equilibrium,
    find_unique_equilibrium,
)
from beamdae.analysis.sensitivities.neighbors import Difference, derivative_call
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.simulation import as_equations

Array = np.ndarray


def differentiate_starts(
    differences: Sequence[Difference], time: Array, at: State
) -> list[tuple[Array, Array]]:
    """Return the derivatives of the requested initial positions and velocities along parameters.

    `time` and `at` are (t, branch) and the state at the start of the run.
    """
    bases = {id(x.base): x.base for x in differences}
    equilibria = {key: find_unique_equilibrium(e) for key, e in bases.items()}
    return [_differentiate_start(x, time, at, equilibria[id(x.base)]) for x in differences]


def _differentiate_start(
    difference: Difference, time: Array, at: State, equilibrium: RegularPoint | None
) -> tuple[Array, Array]:
    base = difference.base
    models = (base, *difference.models)
    if np.array_equal(at.q, base.q0) and not any(start_adds_velocities(e, time) for e in models):
        dq, dv = difference.along(lambda e: e.q0), difference.along(lambda e: e.v0)
    else:

        def start(e: EquationsOfMotion) -> Array:
            return np.concatenate(ConsistencySolver(e).start_state(time, e.q0, e.v0)[:2])

        dq, dv = np.split(difference.along(start), 2)
    return dq if equilibrium is None else differentiate_equilibrium(equilibrium, difference), dv


def assemble_neighbors(base: EquationsOfMotion, start: Any) -> Callable[[Any], EquationsOfMotion]:
    """Return the function that assembles models at neighboring values of parameters.

    If the run starts in a unique equilibrium, that of its neighbors is not searched: they start at
    that of the run, whose derivative follows from the static equations.

    Parameters
    ----------
    base, start
        Equations of the run, and its start; None for that of the model.
    """

    def assemble(mechanism: Any) -> EquationsOfMotion:
        return as_equations(derivative_call(), mechanism, start)

    time = time_on_branch(base.breakpoints, 0.0)
    if (
        base.configurations is not None
        or base.redundant
        or len(base.states)
        or start_adds_velocities(base, time)
        or find_unique_equilibrium(base) is None
    ):
        return assemble

    def assemble_as_drawn(mechanism: Any) -> EquationsOfMotion:
        neighbor = as_equations(derivative_call(), mechanism, AS_DRAWN)
        if neighbor.n != base.n:  # Rejected by the caller.
            return neighbor
        result = replace(neighbor, q0=base.q0, v0=base.v0, start=base.start)
        return assemble(mechanism) if start_adds_velocities(result, time) else result

    return assemble_as_drawn


def start_adds_velocities(equations: EquationsOfMotion, time: Array) -> bool:
    """Return True if bodies are set in motion at the start, see `ConsistencySolver.start_state`."""
    kernels = [joint.kernel for joint in equations.structure.joints]
    if not np.any(equations.v0) and all(x.is_scleronomic for x in kernels):
        return False
    solver = ConsistencySolver(equations)
    return not np.array_equal(
        solver.rigid_velocities(time, equations.q0, equations.v0), equations.v0
    )
