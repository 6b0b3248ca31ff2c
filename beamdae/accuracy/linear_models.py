"""Errors of linear models and natural modes: of frequencies, shapes and responses."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from beamdae.accuracy.errors import (
    AIM,
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
from beamdae.analysis.linear_dynamics.bode_diagram import divide_units
from beamdae.analysis.linear_dynamics.linear_model import LinearModel, build_linear_model
from beamdae.analysis.linear_dynamics.linearization import Linearization, linearize_about
from beamdae.analysis.linear_dynamics.natural_modes import Modes, compare_shapes
from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.equations.starts.reduced_equations import select_independent_constraints
from beamdae.errors import BeamdaeError, hold_messages
from beamdae.linear.blas_threads import single_threaded
from beamdae.linear.factorizations import SingularMatrixError, factorize_saddle_point
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.trajectory import Instant

Array = np.ndarray

_SLOWEST = 3  # vibrations of a linear model without a band of frequencies
_EXAMINED = 24  # vibrations for default bands
_MIN_CURVE_SIZE = 20
# A companion has twice as many states and takes eight times as long for each frequency.
_COMPARED_SHARE, _MIN_COMPARED = 0.125, 20
_FIRST_MODES = 10  # to begin with
_FULL_TURN = 2.0 * np.pi

FURTHER_MODES = 4  # of the companion, because the order of modes may differ
_MIN_MAC = 0.5  # larger ones belong to one pair of orthogonal shapes only
# Rates at which positions at an instant change, relative to the slowest motion: slow, so that beams
# are in equilibrium with the accelerations, but not free motions.
_RATE_RATIO = 1.0 / 30.0
_TOLERANCE, _MAX_ITERATIONS = 1e-8, 15  # of Newton's method, in natural sizes


def measure_frequencies(model: LinearModel, count: int = _SLOWEST) -> Errors:
    """Return the errors of the slowest natural frequencies of a linear model.

    They are magnitudes of eigenvalues, without damping unless the model has first-order states.
    """
    return _measure(model, np.zeros(1), np.zeros((1, 0, 0)), count)


def measure_response(model: LinearModel, frequencies: Array, response: Array) -> Errors:
    """Return the errors of responses (k, outputs, inputs) at frequencies [Hz], (k,).

    Of curves of 20 or more frequencies, they are relative to the largest magnitude. Natural
    frequencies are columns as well, and responses are compared at equal ratios to them, so that a
    shifted peak is an error of its frequency only. Fewer frequencies are columns of their own.
    """
    if len(frequencies) < _MIN_CURVE_SIZE:
        return _measure(model, frequencies, response, 0)
    count = max(int(_COMPARED_SHARE * len(frequencies)), _MIN_COMPARED)
    peaks = np.argmax(np.abs(response), axis=0).ravel()
    rows = np.linspace(0, len(frequencies) - 1, count).astype(int)
    rows = np.unique(np.append(rows, peaks))
    return _measure(model, frequencies[rows], response[rows])


def find_resolved_frequency(model: LinearModel, highest: float) -> float:
    """Return the frequency [Hz] up to which natural frequencies have errors of at most 1 %.

    It is in the middle between two of the first 24 ones, and at most `highest`.
    """
    errors = measure_frequencies(model, _EXAMINED)
    if not errors.refined.elements:
        return highest
    wrong = np.append(np.flatnonzero(errors.total > AIM), len(errors.total))[0]
    between = errors.values[max(wrong - 1, 0) : wrong + 1]
    return float(min(highest, np.exp(np.mean(np.log(between)))))


@single_threaded
def _measure(
    model: LinearModel, frequencies: Array, response: Array, count: int | None = None
) -> Errors:
    """Return the errors of responses and of the slowest `count` natural frequencies.

    If it is None, they are those up to the largest frequency, and responses are curves.
    """
    lin, request = model._linearization, model._request
    if request is None:
        return Errors.unchecked((), np.zeros(0), "the model is not a mechanism")
    limit = float(np.max(np.abs(frequencies))) if count is None else np.inf
    vibrations, solved = _find_vibrations(lin, count, limit)
    rates = np.abs(vibrations.values) / _FULL_TURN
    places = [""] if count is None else [f" at {f:.6g} Hz" for f in frequencies]
    headers = [f"frequency {k} [Hz]" for k in range(1, len(rates) + 1)]
    headers += [
        f"{output.name} / {source.name}{place} [{divide_units(output, source)}]"
        for output in model.outputs[: response.shape[1]]
        for source in model.inputs
        for place in places
    ]
    is_noise = np.zeros(response.shape, bool)
    if is_noise.size:
        middle = frequencies[[len(frequencies) // 2]]
        is_noise = np.abs(response) <= model.bound_rounding(middle)

    def join(rates: Array, response: Array) -> Array:
        """Return the largest magnitudes of all columns, and their samples."""
        columns = np.where(is_noise, 0.0, response).reshape(len(response), -1).T
        if count is not None:
            columns = columns.reshape(-1, 1)
        samples = np.vstack([np.tile(rates[:, None], columns.shape[1]), columns])
        return np.column_stack([np.abs(samples).max(axis=1), samples])

    def solve(refinement: Refinement, finer: Linearization) -> Array:
        others = _solve(finer, solved + FURTHER_MODES)
        pairs = pair_modes(refinement, finer, vibrations.shapes, others)
        finer_rates = np.append(np.abs(others.values), np.nan)[pairs] / _FULL_TURN
        if not response.size:
            return join(finer_rates, response)
        known = np.isfinite(finer_rates)
        ratios = np.ones(len(frequencies))
        if known.any():
            shifts = finer_rates[known] / rates[known]
            ratios = np.interp(np.abs(frequencies), rates[known], shifts)
        columns = [x.header for x in model.outputs]
        fine = build_linear_model(
            refinement.equations.mechanism, finer, request._replace(outputs=columns)
        )
        if fine.inputs != model.inputs:
            raise BeamdaeError("the refined model has other inputs")
        return join(finer_rates, fine.evaluate_response((ratios * frequencies).tolist()))

    eigenvalues = vibrations.values if len(rates) else model.poles
    state = lin, request.about, request.t, eigenvalues
    return measure_about_state(*state, headers, join(rates, response), solve)


def _solve(lin: Linearization, count: int) -> EigenSolution:
    return solve_eigenproblem(lin.linearized_equations, count, len(lin.equations.states) > 0)


def _find_vibrations(
    lin: Linearization, most: int | None, limit: float
) -> tuple[EigenSolution, int]:
    """Return the vibrations up to a frequency [Hz], and the number of modes that contain them.

    They ascend; at most `most` are returned.
    """
    e, count = lin.equations, _FIRST_MODES
    while True:
        solution = _solve(lin, count)
        rates = np.abs(solution.values) / _FULL_TURN
        order = np.flatnonzero((solution.values.imag > 0.0) & (rates <= limit))[:most]
        is_complete = len(order) == most or np.max(rates, initial=0.0) > limit
        if is_complete or count >= e.n - e.m:
            return EigenSolution(solution.values[order], solution.shapes[:, order]), count
        count *= 2


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
    errors: Errors = measure_about_state(*state, headers, tabulate(values), solve)
    return replace(errors, has_accuracy=request.has_accuracy)


@single_threaded
def measure_about_state(
    lin: Linearization,
    about: Any,
    t: float,
    eigenvalues: Array,
    headers: Sequence[str],
    samples: Array,
    solve: Callable[[Refinement, Linearization], Array],
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
    return measure_errors(unchecked, samples, repeat, compare)


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
    e = select_independent_constraints(active, time)
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
