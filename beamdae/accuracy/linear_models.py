"""Errors of linear models: of natural frequencies and of frequency responses."""

from __future__ import annotations

import numpy as np

from beamdae.accuracy.errors import AIM, Errors
from beamdae.accuracy.modes import FURTHER_MODES, measure_about_state, pair_modes
from beamdae.accuracy.refinement import Refinement
from beamdae.analysis.eigenproblems.eigensolution import EigenSolution, solve_eigenproblem
from beamdae.analysis.linear_dynamics.bode_diagram import divide_units
from beamdae.analysis.linear_dynamics.linear_model import LinearModel, build_linear_model
from beamdae.analysis.linear_dynamics.linearization import Linearization
from beamdae.errors import BeamdaeError
from beamdae.linear.blas_threads import single_threaded

Array = np.ndarray

_SLOWEST = 3  # vibrations of a linear model without a band of frequencies
_EXAMINED = 24  # vibrations for default bands
_MIN_CURVE_SIZE = 20
# A companion has twice as many states and takes eight times as long for each frequency.
_COMPARED_SHARE, _MIN_COMPARED = 0.125, 20
_FIRST_MODES = 10  # to begin with
_FULL_TURN = 2.0 * np.pi


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
