"""Errors of natural modes, measured about the same state with everything refined together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from beamdae.accuracy.errors import Errors, MissingStateError, Refined, measure_errors
from beamdae.accuracy.refinement import Refinement, refine
from beamdae.analysis.continuation.engine import CurveError, prescribe_parameter
from beamdae.analysis.eigenproblems.eigensolution import EigenSolution, solve_eigenproblem
from beamdae.analysis.eigenproblems.linearized_equations import quadratic_forms
from beamdae.analysis.linear_dynamics.linearization import (
    Frame,
    Linearization,
    linearize_about,
    linearize_at_rest,
    load_path_end,
)
from beamdae.analysis.linear_dynamics.natural_modes import Modes
from beamdae.analysis.statics.neutral_motions import hold_neutral_motions
from beamdae.analysis.statics.static_problem import StaticProblem
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

_FURTHER_MODES = 4  # of the companion, because the order of modes may differ
_MIN_MAC = 0.5  # larger ones belong to one pair of orthogonal shapes only
# Rates at which positions at an instant change, relative to the slowest motion: slow, so that beams
# are in equilibrium with the accelerations, but not free motions.
_RATE_RATIO = 1.0 / 30.0
_TOLERANCE, _MAX_ITERATIONS = 1e-8, 15  # of Newton's method, in natural sizes


def measure_modes(modes: Modes) -> Errors:
    """Return the errors of the eigenvalues of natural modes, except free motions.

    The companion's modes are paired by their shapes. Errors are relative to the magnitude of the
    eigenvalue.
    """
    lin, request = modes._linearization, modes._request
    count = len(modes) if request is None else request.assessed
    rows = np.flatnonzero(modes.eigenvalues[:count])
    values, shapes = modes.eigenvalues[rows], modes.shapes[rows].T
    is_vibration = values.imag != 0.0
    headers = [
        f"frequency {k + 1} [Hz]" if x else f"growth rate {k + 1} [1/s]"
        for k, x in zip(rows.tolist(), is_vibration, strict=True)
    ]

    def summarize(samples: Array) -> Array:
        return np.where(is_vibration, samples[:, 0].imag / (2.0 * np.pi), samples[:, 0].real)

    def solve(refinement: Refinement, finer: Linearization) -> Array:
        assert request is not None
        problem = finer.linearized_equations
        solution = solve_eigenproblem(problem, len(modes) + _FURTHER_MODES, request.damping)
        pairs = pair_modes(refinement, finer, shapes, solution)
        return np.append(solution.values, np.nan)[pairs, None]

    samples = values[:, None]
    if request is None:
        reason = "the model is not a mechanism"
        return Errors.unchecked(headers, summarize(samples), reason)
    return measure_about_state(
        lin, request.about, request.t, headers, samples, summarize, modes.eigenvalues, solve
    )


@single_threaded
def measure_about_state(
    lin: Linearization,
    about: Any,
    t: float,
    headers: Sequence[str],
    samples: Array,
    summarize: Callable[[Array], Array],
    eigenvalues: Array,
    solve: Callable[[Refinement, Linearization], Array],
) -> Errors:
    """Return the errors of samples of a linearized mechanism (columns, k).

    Parameters
    ----------
    lin
        The linearized mechanism.
    about, t
        State and time [s] of the linearization; see `modes`.
    headers
        Headers of the columns.
    samples
        Complex values of the columns; the error of a column is the largest change of its samples,
        relative to their largest magnitude.
    summarize
        Function of samples that returns the headlines of the columns.
    eigenvalues
        Eigenvalues of the mechanism [1/s].
    solve
        Function that returns the samples of the companion.
    """
    values = summarize(samples)
    beams = beams_of(lin.full_equations.mechanism)

    def repeat(strains: bool | None) -> tuple[Array, Refined]:
        if strains is None or not beams:
            return samples, Refined()
        companion = _find_companion(lin, about, t, strains, eigenvalues)
        refined = companion[0].refined
        if not refined.has_mesh:
            raise BeamdaeError("no beam can be refined")
        orders = (2 * x.mesh.nodes - 2 for x in beams if x.name in refined.elements)
        return solve(*companion), refined._replace(mesh_order=min(orders, default=2))

    def compare(first: Array, second: Array, refined: Refined) -> Errors:
        sizes = np.max(np.abs(second), axis=1, initial=0.0)
        errors = Errors.of_values(headers, first, second, refined, sizes)
        return replace(errors, values=summarize(first), companions=summarize(second))

    unchecked = Errors.unchecked(headers, values, "no refined model")
    return measure_errors(unchecked, samples, repeat, compare)


def pair_modes(
    refinement: Refinement, finer: Linearization, shapes: Array, solution: EigenSolution
) -> Array:
    """Return the indices of the companion's modes with the same shapes as (n, k), or -1.

    Shapes without a similar one are paired with the remaining modes in ascending order.
    """
    mass, prolonged = finer.tangent.mass, refinement.prolongation @ shapes
    masses, others = (quadratic_forms(mass, x).real for x in (prolonged, solution.shapes))
    mac = np.abs(prolonged.conj().T @ (mass @ solution.shapes)) ** 2 / np.outer(masses, others)
    pairs = np.full(len(mac), -1)
    if not mac.size:
        return pairs
    for k, row in enumerate(mac):
        # Motions at equal rates may have nearly the same shape.
        row[pairs[pairs >= 0]] = 0.0
        best = int(np.argmax(row))
        if row[best] > _MIN_MAC:
            pairs[k] = best
    rest = np.setdiff1d(np.flatnonzero(solution.values), pairs)
    rows = np.flatnonzero(pairs < 0)[: len(rest)]
    pairs[rows] = rest[: len(rows)]
    return pairs


def _find_companion(
    lin: Linearization, about: Any, t: float, strains: bool, eigenvalues: Array
) -> tuple[Refinement, Linearization]:
    """Return the refined mechanism linearized about the same state."""
    if strains not in lin.companions:
        start = about if isinstance(about, Mapping) else AS_DRAWN
        with hold_messages():
            refinement = refine(lin.full_equations, start, strains=strains, friction=False)
            try:
                finer = lin
                if refinement.refined.has_mesh:
                    finer = _linearize_refined(lin, refinement, about, t, eigenvalues)
            except (BeamdaeError, CurveError, SingularMatrixError) as problem:
                raise MissingStateError(
                    f"the state is not found with halved elements ({str(problem).rstrip('.')})"
                ) from problem
        lin.companions[strains] = refinement, finer
    companion: tuple[Refinement, Linearization] = lin.companions[strains]
    return companion


def _linearize_refined(
    lin: Linearization, refinement: Refinement, about: Any, t: float, eigenvalues: Array
) -> Linearization:
    """Linearize about the same state, searched for by its request.

    The beams are in equilibrium with the loads at the end of a path, and with the accelerations at
    an instant of a run.
    """
    if isinstance(about, Equilibrium):
        return _linearize_path_end(lin, refinement, about)
    if isinstance(about, Instant):
        slowest = np.min(np.abs(eigenvalues[eigenvalues != 0.0]), initial=np.inf)
        rate = _RATE_RATIO * float(slowest) if np.isfinite(slowest) else 1.0
        about = _prolong_instant(lin, refinement, about, rate)
    return linearize_about("modes", refinement.equations, about, t)


def _linearize_path_end(
    lin: Linearization, refinement: Refinement, path: Equilibrium
) -> Linearization:
    q = refinement.prolong(lin.state.q)
    fine = replace(refinement.equations, q0=q, v0=np.zeros(len(q)))
    _, system, factor = load_path_end(fine.mechanism, fine, path)
    e = system.equations
    multipliers = dict(zip(lin.equations.lam_names, lin.state.lam, strict=True))
    x = np.append(q, [multipliers.get(name, 0.0) for name in e.lam_names])
    problem = StaticProblem(system)
    start = hold_neutral_motions(problem.point(problem.start(x), factor))
    x = start.problem.correct(prescribe_parameter, factor, start.x, factor).x[: len(x)]
    e = replace(e, q0=x[: e.n], v0=np.zeros(e.n))
    frame = Frame(e, system.loaded.time, partial(system.motion_tangent, factor))
    return linearize_at_rest(frame, fine, lin.about)


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
