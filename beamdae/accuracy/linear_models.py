"""Errors of linear models: of natural frequencies and of frequency responses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamdae.accuracy.errors import AIM, Errors
from beamdae.accuracy.modes import measure_about_state, pair_modes
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
_REACH = 1.5  # of the modes of the companion beyond the band, whose frequencies may be higher


def measure_frequencies(model: LinearModel, count: int = _SLOWEST) -> Errors:
    """Return the errors of the slowest natural frequencies of a linear model.

    They are magnitudes of eigenvalues, without damping unless the model has first-order states.
    """
    return _measure(model, _Band(count), np.zeros(1), np.zeros((1, 0, 0)))


def measure_response(model: LinearModel, frequencies: Array, response: Array) -> Errors:
    """Return the errors of responses (k, outputs, inputs) at frequencies [Hz], (k,).

    Of curves of 20 or more frequencies, they are relative to the largest magnitude. Natural
    frequencies are columns as well, and responses are compared at equal ratios to them, so that a
    shifted peak is an error of its frequency only. Fewer frequencies are columns of their own.
    """
    count = max(int(_COMPARED_SHARE * len(frequencies)), min(_MIN_COMPARED, len(frequencies)))
    peaks = np.argmax(np.abs(response), axis=0).ravel()
    rows = np.linspace(0, len(frequencies) - 1, count).astype(int)
    rows = np.unique(np.append(rows, peaks))
    is_curve = _is_curve(frequencies)
    band = _Band(limit=float(np.max(np.abs(frequencies))) if is_curve else 0.0)
    return _measure(model, band, frequencies[rows], response[rows])


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


def _is_curve(frequencies: Array) -> bool:
    """Return False for single values rather than a curve whose peaks are read."""
    return len(frequencies) >= _MIN_CURVE_SIZE


class _Band(NamedTuple):
    """Largest number of vibrations, and their largest frequency [Hz]."""

    most: float = np.inf
    limit: float = np.inf


@single_threaded
def _measure(model: LinearModel, band: _Band, frequencies: Array, response: Array) -> Errors:
    lin, request = model._linearization, model._request
    if request is None:
        return Errors.unchecked((), np.zeros(0), "the model is not a mechanism")
    vibrations = _find_vibrations(lin, band)
    rates = np.abs(vibrations.values) / (2.0 * np.pi)
    headers = [f"frequency {k} [Hz]" for k in range(1, len(rates) + 1)]
    is_curve = _is_curve(frequencies)
    headers += [
        f"{output.name} / {source.name}{place} [{divide_units(output, source)}]"
        for output in model.outputs[: response.shape[1]]
        for source in model.inputs
        for place in ([""] if is_curve else [f" at {f:.6g} Hz" for f in frequencies])
    ]
    is_noise = np.zeros(response.shape, bool)
    if is_noise.size:
        middle = frequencies[[len(frequencies) // 2]]
        is_noise = np.abs(response) <= model.bound_rounding(middle)

    def join(rates: Array, response: Array) -> Array:
        """Return the samples of all columns."""
        responses = np.where(is_noise, 0.0, response).reshape(len(response), -1).T
        columns = responses if is_curve else responses.reshape(-1, 1)
        return np.vstack([np.tile(rates[:, None], columns.shape[1]), columns])

    def solve(refinement: Refinement, finer: Linearization) -> Array:
        others = _find_vibrations(finer, _Band(band.most + _FIRST_MODES, _REACH * band.limit))
        pairs = pair_modes(refinement, finer, vibrations.shapes, others)
        finer_rates = np.append(np.abs(others.values), np.nan)[pairs] / (2.0 * np.pi)
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

    samples = join(rates, response)
    eigenvalues = vibrations.values if len(rates) else model.poles
    return measure_about_state(
        lin, request.about, request.t, headers, samples, _find_peaks, eigenvalues, solve
    )


def _find_peaks(samples: Array) -> Array:
    return np.abs(samples).max(axis=1)


def _find_vibrations(lin: Linearization, band: _Band) -> EigenSolution:
    """Return the vibrations in a band in ascending order of their frequencies."""
    e, count = lin.equations, _FIRST_MODES
    largest = 2.0 * np.pi * band.limit
    while True:
        solution = solve_eigenproblem(lin.linearized_equations, count, len(e.states) > 0)
        rates = np.abs(solution.values)
        order = np.argsort(rates, kind="stable")
        order = order[(solution.values.imag[order] > 0.0) & (rates[order] <= largest)]
        is_complete = len(order) >= band.most or np.max(rates, initial=0.0) > largest
        if is_complete or count >= e.n - e.m:
            break
        count *= 2
    order = order[: int(min(band.most, len(order)))]
    return EigenSolution(solution.values[order], solution.shapes[:, order])
