"""Errors of linear models: of natural frequencies and of frequency responses."""

from __future__ import annotations

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
# Fewer frequencies are single values rather than a curve whose peaks are read.
_MIN_CURVE_SIZE = 20
# A companion has twice as many states and takes eight times as long for each frequency.
_COMPARED_SHARE, _MIN_COMPARED = 0.125, 20
# Magnitudes below this share of the bound by the norms of matrices are rounding errors.
_NOISE_SHARE = 1e-9
_FIRST_MODES = 10  # to begin with
_REACH = 1.5  # of the modes of the companion beyond the band, whose frequencies may be higher


def measure_frequencies(model: LinearModel, limit: float | None = None) -> Errors:
    """Return the errors of the natural frequencies of a linear model up to a limit [Hz].

    By default, those of the three slowest vibrations. They are undamped frequencies, unless the
    model has first-order states.
    """
    return _measure(model, limit, np.zeros(1), np.zeros((1, 0, 0)))


def measure_response(model: LinearModel, frequencies: Array, response: Array) -> Errors:
    """Return the errors of responses (k, outputs, inputs) at frequencies [Hz], (k,).

    They are relative to the largest magnitude at these frequencies. Of curves of 20 or more
    frequencies, natural frequencies are columns as well, and responses are compared at equal ratios
    to them, so that a shifted peak is an error of its frequency only.
    """
    count = max(int(_COMPARED_SHARE * len(frequencies)), min(_MIN_COMPARED, len(frequencies)))
    peaks = np.argmax(np.abs(response), axis=0).ravel()
    rows = np.linspace(0, len(frequencies) - 1, count).astype(int)
    rows = np.unique(np.append(rows, peaks))
    is_curve = len(frequencies) >= _MIN_CURVE_SIZE
    limit = float(np.max(np.abs(frequencies))) if is_curve else 0.0
    return _measure(model, limit, frequencies[rows], response[rows])


def find_resolved_frequency(model: LinearModel, highest: float) -> float:
    """Return the frequency [Hz] up to which natural frequencies have errors of at most 1 %.

    It is in the middle between two of them, and at most `highest`.
    """
    errors = measure_frequencies(model, highest)
    wrong = np.flatnonzero(errors.total > AIM)
    if not len(wrong):
        return highest
    between = errors.values[max(wrong[0] - 1, 0) : wrong[0] + 1]
    return float(min(highest, np.exp(np.mean(np.log(between)))))


@single_threaded
def _measure(
    model: LinearModel, limit: float | None, frequencies: Array, response: Array
) -> Errors:
    lin, request = model._linearization, model._request
    if lin is None or request is None:
        return Errors.unchecked((), np.zeros(0), "the model is not a mechanism")
    vibrations = _find_vibrations(lin, limit)
    rates = vibrations.values.imag / (2.0 * np.pi)
    headers = [f"frequency {k} [Hz]" for k in range(1, len(rates) + 1)]
    headers += [
        f"{output.name} / {source.name} [{divide_units(output, source)}]"
        for output in model.outputs[: response.shape[1]]
        for source in model.inputs
    ]
    is_noise = np.zeros(response.shape[1:], bool)
    if is_noise.size:
        middle = frequencies[[len(frequencies) // 2]]
        is_noise = np.abs(response).max(axis=0) <= _NOISE_SHARE * model.bound_magnitudes(middle)

    def join(rates: Array, response: Array) -> Array:
        curves = np.where(is_noise, 0.0, response).reshape(len(response), -1).T
        return np.vstack([np.tile(rates[:, None], len(response)), curves])

    def solve(refinement: Refinement, finer: Linearization) -> Array:
        others = _find_vibrations(finer, None if limit is None else _REACH * limit, _FIRST_MODES)
        pairs = pair_modes(refinement, finer, vibrations.shapes, others)
        finer_rates = np.append(others.values.imag, np.nan)[pairs] / (2.0 * np.pi)
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


def _find_vibrations(
    lin: Linearization, limit: float | None, slowest: int = _SLOWEST
) -> EigenSolution:
    """Return the vibrations up to a frequency [Hz], or the slowest ones if it is None."""
    e, count = lin.equations, _FIRST_MODES
    is_damped = len(e.states) > 0
    largest = np.inf if limit is None else 2.0 * np.pi * limit
    solution = solve_eigenproblem(lin.linearized_equations, count, is_damped)
    while limit is not None and count < e.n - e.m and solution.values[-1].imag <= largest:
        count *= 2
        solution = solve_eigenproblem(lin.linearized_equations, count, is_damped)
    rates = solution.values.imag
    order = np.argsort(rates, kind="stable")
    order = order[(rates[order] > 0.0) & (rates[order] <= largest)]
    order = order[: None if limit is not None else slowest]
    return EigenSolution(solution.values[order], solution.shapes[:, order])
