"""Errors of natural modes, measured about the same state with everything refined together."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from beamdae.accuracy.errors import (
    CAUSES_AT_REST,
    Errors,
    MissingStateError,
    Refined,
    measure_errors,
)
from beamdae.accuracy.refinement import Refinement, refine
from beamdae.accuracy.statics import refine_end
from beamdae.analysis.continuation.engine import CurveError
from beamdae.analysis.eigenproblems.eigensolution import EigenSolution, solve_eigenproblem
from beamdae.analysis.linear_dynamics.linearization import Linearization, linearize_about
from beamdae.analysis.linear_dynamics.natural_modes import Modes, compare_shapes
from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.equations.starts.reduced_equations import select_independent
from beamdae.errors import BeamdaeError, hold_messages
from beamdae.linear.blas_threads import single_threaded
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.linear.saddle_point import factorize_saddle_point
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.trajectory import Instant

Array = np.ndarray

_FULL_TURN = 2.0 * np.pi
FURTHER_MODES = 4  # of the companion, because the order of modes may differ
_MIN_MAC = 0.5  # larger ones belong to one pair of orthogonal shapes only
# Rates at which positions at an instant change, relative to the slowest motion: slow, so that beams
# are in equilibrium with the accelerations, but not free motions.
_RATE_RATIO = 1.0 / 30.0
_TOLERANCE, _MAX_ITERATIONS = 1e-8, 15  # of Newton's method, in natural sizes


def measure_modes(modes: Modes) -> Errors:
    """Return the errors of the eigenvalues of natural modes, except free motions.

    The companion's modes are paired by their shapes, but vibrations that no mode resembles by their
    rank. Errors are relative to the magnitude of the eigenvalue.
    """
    lin, request = modes._linearization, modes._request
    rows = np.flatnonzero(modes.eigenvalues[: request.assessed])
    values, shapes = modes.eigenvalues[rows], modes.shapes[rows].T
    is_vibration = values.imag != 0.0
    headers = [
        f"frequency {k + 1} [Hz]" if x else f"growth rate {k + 1} [1/s]"
        for k, x in zip(rows.tolist(), is_vibration, strict=True)
    ]

    def tabulate(values: Array) -> Array:
        return np.stack([np.where(is_vibration, values.imag / _FULL_TURN, values.real), values], 1)

    def solve(refinement: Refinement, finer: Linearization) -> Array:
        problem = finer.linearized_equations
        solution = solve_eigenproblem(problem, len(modes) + FURTHER_MODES, request.damping)
        pairs = pair_modes(refinement, finer, shapes, solution)
        _pair_missing(pairs, solution.values, is_vibration)
        return tabulate(np.append(solution.values, np.nan)[pairs])

    if modes.mechanism is None:
        return Errors.unchecked(
            headers, tabulate(values)[:, 0].real, "the model is not a mechanism"
        )
    state = lin, request.about, request.t, modes.eigenvalues
    return measure_about_state(*state, headers, tabulate(values), solve, request.has_accuracy)


@single_threaded
def measure_about_state(
    lin: Linearization,
    about: Any,
    t: float,
    eigenvalues: Array,
    headers: Sequence[str],
    samples: Array,
    solve: Callable[[Refinement, Linearization], Array],
    has_accuracy: bool = True,
) -> Errors:
    """Return the errors of samples of a linearized mechanism.

    Parameters
    ----------
    lin
        The linearized mechanism.
    about, t
        State and time [s] of the linearization; see `modes`.
    eigenvalues
        Eigenvalues of the mechanism [1/s].
    headers
        Headers of the columns.
    samples
        Values of the columns (columns, k), see `Errors.of_values`.
    solve
        Function that returns the samples of the companion.
    has_accuracy
        See `Errors`.
    """
    beams = beams_of(lin.full_equations.mechanism)

    def repeat(causes: Collection[str]) -> tuple[Array, Refined]:
        if not beams:
            return samples, Refined()
        companion = _find_companion(lin, about, t, causes, eigenvalues)
        refined = companion[0].refined
        if not refined.causes:
            raise BeamdaeError("no beam can be refined")
        orders = (2 * x.mesh.nodes - 2 for x in beams if x.name in refined.elements)
        return solve(*companion), refined._replace(mesh_order=min(orders, default=2))

    compare = partial(Errors.of_values, headers)
    unchecked = Errors.unchecked(headers, samples[:, 0].real, "no refined model")
    return measure_errors(unchecked, samples, repeat, compare, has_accuracy=has_accuracy)


def pair_modes(
    refinement: Refinement, finer: Linearization, shapes: Array, solution: EigenSolution
) -> Array:
    """Return the indices of the companion's modes with the same shapes as (n, k), or -1.

    Shapes without a similar one are paired with the remaining modes in ascending order.
    """
    mac = compare_shapes(finer.tangent.mass, refinement.prolongation @ shapes, solution.shapes)
    rows, matches = linear_sum_assignment(-mac)
    is_similar = mac[rows, matches] > _MIN_MAC
    pairs = np.full(len(mac), -1)
    pairs[rows[is_similar]] = matches[is_similar]
    rest = np.setdiff1d(np.flatnonzero(solution.values), pairs)
    rows = np.flatnonzero(pairs < 0)[: len(rest)]
    pairs[rows] = rest[: len(rows)]
    return pairs


def _pair_missing(pairs: Array, values: Array, is_vibration: Array) -> None:
    """Pair vibrations with those of the same rank in the companion that no mode resembles.

    Few elements lack slow vibrations, so that the shapes of the first ones are those of fast ones.
    """
    fastest = np.max(pairs[is_vibration], initial=-1)
    for row, k in zip(np.flatnonzero(is_vibration), np.flatnonzero(values.imag), strict=False):
        if k < fastest and k not in pairs:
            pairs[row] = k


def _find_companion(
    lin: Linearization, about: Any, t: float, causes: Collection[str], eigenvalues: Array
) -> tuple[Refinement, Linearization]:
    """Return the refined mechanism, linearized about the same state.

    The beams are in equilibrium with the loads at the end of a path, and with the accelerations at
    an instant of a run. Other states are searched for by their request.
    """
    refined = CAUSES_AT_REST.intersection(causes)
    if refined not in lin.companions:
        start = about if isinstance(about, Mapping) else AS_DRAWN
        with hold_messages():
            refinement, finer = refine(lin.full_equations, start, refined), lin
            try:
                if refinement.refined.causes:
                    if isinstance(about, Equilibrium):
                        about = refine_end(about, refinement)
                    elif isinstance(about, Instant):
                        slowest = np.min(np.abs(eigenvalues[eigenvalues != 0.0]), initial=np.inf)
                        rate = _RATE_RATIO * float(slowest) if np.isfinite(slowest) else 1.0
                        about = _prolong_instant(lin, refinement, about, rate)
                    finer = linearize_about("modes", refinement.equations, about, t)
            except (BeamdaeError, CurveError, SingularMatrixError) as problem:
                raise MissingStateError(
                    f"the state is not found with halved elements ({str(problem).rstrip('.')})"
                ) from problem
        lin.companions[refined] = refinement, finer
    companion: tuple[Refinement, Linearization] = lin.companions[refined]
    return companion


def _prolong_instant(
    lin: Linearization, refinement: Refinement, instant: Instant, rate: float
) -> Instant:
    """Return the instant of a run in the coordinates of the refined mechanism."""
    active, now, time = refinement.equations, instant.configuration, instant.time
    if now is not None and active.configurations is not None:
        now = active.configurations.configuration_without(active, now.inactive, now.frozen_gaps)
        active = now.equations
    e = select_independent(active, time)
    q, v, a, lam = instant.state
    multipliers = dict(zip(lin.full_equations.lam_names, lam, strict=True))
    lam = np.array([multipliers[name] for name in e.lam_names])
    matrix = refinement.prolongation
    state = _balance(
        e, time, State(refinement.start + matrix @ q, matrix @ v, matrix @ a, lam), rate
    )
    return Instant(time, state, now)


def _balance(e: EquationsOfMotion, time: Array, start: State, rate: float) -> State:
    """Return the state with balanced forces under the same accelerations, by Newton's method.

    Changes of positions x add velocities rate x and accelerations rate^2 x.
    """
    state = start
    for _ in range(_MAX_ITERATIONS):
        tangent = compute_tangent(e, time, state)
        block = tangent.stiffness + rate * tangent.damping + rate**2 * tangent.mass
        rows = tangent.position_jacobian + rate * tangent.velocity_jacobian
        solve = factorize_saddle_point(block, tangent.reactions, rows)
        if solve is None:
            break
        change = -solve(tangent.residual)
        q = state.q + change[: e.n]
        x, lam = q - start.q, state.lam + change[e.n :]
        state = State(q, start.v + rate * x, start.a + rate**2 * x, lam)
        if np.max(np.abs(change[: e.n] / e.position_scales), initial=0.0) < _TOLERANCE:
            return state
    raise BeamdaeError("the forces on the refined beams are not balanced at this instant")
