"""Errors of peaks of section forces due to unresolved waves and to coarse times.

No mesh resolves the fronts of the waves that a sudden load sends along an undamped beam. Behind a
front, section forces oscillate at the scale of the mesh and overshoot by 20 to 80 % of the jump;
finer meshes do not reduce the overshoot, but its duration. The oscillations cancel on average over
the period of the shortest waves that the mesh resolves. Therefore, the difference between a peak
and these averages estimates the error of the peak. The same applies to waves that are too short for
the fixed step of an integrator without error control.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from beamdae.beams.beam import Beam

Array = np.ndarray

# Shortest resolved waves, in node intervals. Averages over the periods of these axial waves
# reproduce the plateaus of rods under step loads and impacts within 3 to 13 % of the jump, with 4
# to 32 elements of 2 to 4 nodes. Bending waves of 4 node intervals are longer in time: averages
# over their periods cover the errors of moments after sudden tip loads and impacts on 2 to 16
# elements, and are 1e-2, 6e-4 and 3e-5 of the moment too low in the resolved motion of the hub beam
# on 2, 4 and 8 elements.
_INTERVALS_PER_AXIAL_WAVE = 6
_INTERVALS_PER_BENDING_WAVE = 4
# Fixed steps in the period of the shortest resolved wave. With generalized-alpha and 2 to 40 steps
# in the time in which a wave crosses the rod, averages cover 0.8 to 1.4 times the overshoot.
_STEPS_PER_WAVE = 8
_SAMPLES_PER_PERIOD = 12
# Times, per interval between two rows, at which section forces are compared with their extremes.
_SAMPLES_BETWEEN_ROWS = 3


def shortest_resolved_periods(beam: Beam, step: float) -> Array:
    """Return the periods [s] of the shortest waves in N, Q and M that a run resolves, (3,).

    `step` is the fixed step of the integrator [s], or 0 with error control.
    """
    mesh, bounds = beam.mesh, beam.mesh.element_bounds
    interval = mesh.element_lengths / (mesh.nodes - 1)
    sections = [beam.section.at(s) for s in (0.5 * (bounds[:-1] + bounds[1:])).tolist()]
    EA, GA, EI, rhoA, rhoI = (
        np.array([getattr(section, name) for section in sections])
        for name in ("EA", "GA", "EI", "rhoA", "rhoI")
    )
    axial = _INTERVALS_PER_AXIAL_WAVE * interval * np.sqrt(rhoA / EA)
    k2 = (2.0 * np.pi / (_INTERVALS_PER_BENDING_WAVE * interval)) ** 2
    # Rotary inertia and shear (Timoshenko 1921) limit the speed of short bending waves.
    slowness = 1.0 + k2 * (rhoI / rhoA + EI / GA)
    bending = 2.0 * np.pi * np.sqrt(rhoA / EI * slowness) / k2
    periods = np.array([axial.max(), bending.max(), bending.max()])
    return np.maximum(periods, _STEPS_PER_WAVE * step)


def estimate_wave_errors(
    t: Array, forces: Array, periods: Array, sample: Callable[[Array], Array]
) -> Array:
    """Return the errors of the largest and smallest N, Q and M due to unresolved waves, (3,).

    At the times of the largest and of the smallest value, the values at all sections are compared
    with averages over all periods that include this time. The nearest average counts, so that jumps
    by wave fronts and sudden loads are no errors. The result is the largest difference.

    Parameters
    ----------
    t
        Times (rows,) [s].
    forces
        N, Q and M at these times (3, rows, sections).
    periods
        Lengths of the periods for N, Q and M (3,) [s].
    sample
        Function of ascending times that returns N, Q and M.
    """
    weights = np.ones(_SAMPLES_PER_PERIOD + 1)
    weights[[0, -1]] = 0.5  # trapezoidal rule
    weights /= _SAMPLES_PER_PERIOD
    offsets = np.linspace(-1.0, 1.0, 2 * _SAMPLES_PER_PERIOD + 1)
    errors = np.zeros(3)
    for k, (force, period) in enumerate(zip(forces, periods, strict=True)):
        for row in _rows_of_extremes(force):
            around = sample(t[row] + period * offsets)[k]
            windows = np.lib.stride_tricks.sliding_window_view(around, len(weights), axis=0)
            means = windows @ weights
            nearest = np.clip(force[row], means.min(axis=0), means.max(axis=0))
            errors[k] = max(errors[k], np.max(np.abs(force[row] - nearest)))
    return errors


def estimate_sampling_errors(t: Array, forces: Array, sample: Callable[[Array], Array]) -> Array:
    """Return by how much N, Q and M exceed their extremes between the times of these, (3,).

    N, Q and M are evaluated between the time of an extreme and the two adjacent times.

    Parameters
    ----------
    t, forces, sample
        See `estimate_wave_errors`.
    """
    fractions = np.arange(1, _SAMPLES_BETWEEN_ROWS + 1) / (_SAMPLES_BETWEEN_ROWS + 1)
    errors = np.zeros(3)
    for k, force in enumerate(forces):
        for row in _rows_of_extremes(force):
            adjacent = t[max(row - 1, 0) : row + 2]
            between = (adjacent[:-1, None] + np.diff(adjacent)[:, None] * fractions).ravel()
            if len(between):
                values = sample(between)[k]
                excess = max(values.max() - force.max(), force.min() - values.min())
                errors[k] = max(errors[k], excess)
    return errors


def _rows_of_extremes(force: Array) -> set[int]:
    """Return the rows of the smallest and the largest value."""
    return {int(extreme) // force.shape[1] for extreme in (np.argmin(force), np.argmax(force))}
