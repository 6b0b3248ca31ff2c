"""Warnings about elements of beams that are too long for vibrations that last many periods."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.dispersion import (
    bending_wave_errors,
    bending_wave_numbers,
    convergence_order,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import format_error, name_with_others
from beamdae.results.columns import Header, remove_unit
from beamdae.results.diagnostics.meshes.sampled_vibrations import (
    LARGE_ERROR,
    MAX_SAMPLED_NUMBERS,
    MIN_PERIODS,
    fastest_rate,
    mean_tension,
    recommend_elements,
    rotation_coordinates,
    rotation_factors,
    sample_count,
    select_beam_columns,
    spectral_window,
)
from beamdae.results.diagnostics.resolution.missed_peaks import StepExtremes
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Errors of the phase at the end of the run, relative to half the range of a column. Of 153 runs of
# 16 mechanisms with 1 to 6 elements, 88 have an estimate above this one, 0.35 to 1.1 times the
# error beside 10 elements with several elements per wave, up to 4 times under undamped harmonic
# loads, and up to 9 times with one element. Their errors are 3.6 % and more; those of the others
# are up to 7 %, or belong to columns that vanish by symmetry or to vibrations that loads maintain.
_MAX_PHASE_ERROR = 0.03
_RECOMMENDED_PHASE_ERROR = 0.01
# Displacement of a point of a bending wave with the wave number k, times k / rotation: 1 between
# nodes, and 1.4 at free ends.
_MAX_SHAPE_FACTOR = 1.5


class _Spectrum(NamedTuple):
    """Mean squares of signals by frequency, in the first and the second half of a run.

    Attributes
    ----------
    rates
        Angular frequencies (k,) [rad/s].
    squares
        Mean squares (2, k, signals).
    ends
        Times from the start of the run to the end of each half, (2,) [s].
    """

    rates: Array
    squares: Array
    ends: Array

    @classmethod
    def of_samples(cls, values: Array, duration: float) -> _Spectrum:
        """Return the spectrum of values (2 k, signals) at equally spaced times of a run.

        The window cos^4 suppresses the leakage of slow motions, whose phase errors are far smaller,
        into higher frequencies.
        """
        count, n_signals = values.shape
        x, window = (column[:, 0] for column in spectral_window(count // 2))
        # One row per half: sums over long rows are faster and more accurate than over short ones.
        halves = values.T.reshape(n_signals, 2, count // 2)
        halves = halves - halves.mean(axis=2, keepdims=True)
        halves -= np.sum(x * halves, axis=2, keepdims=True) / np.sum(x**2) * x
        halves *= window
        amplitudes = np.abs(np.fft.rfft(halves, axis=2))
        squares = np.moveaxis(2.0 * amplitudes**2 / (len(x) * np.sum(window**2)), 0, 2)
        squares[:, :MIN_PERIODS] = 0.0
        rates = 4.0 * np.pi / duration * np.arange(squares.shape[1])
        return cls(rates, squares, duration * np.array([0.5, 1.0]))

    def select(self, signals: list[int]) -> _Spectrum:
        """Return the spectrum of these signals."""
        return self._replace(squares=self.squares[:, :, signals])

    def phase_error(self, frequency_errors: Array, factors: Array | float = 1.0) -> Array:
        """Return the amplitude of the error of each signal by wrong frequencies, (signals,).

        Parameters
        ----------
        frequency_errors
            Relative errors (k,) of the frequencies.
        factors
            Numbers (k,) with which the signals are multiplied.
        """
        phases = self.ends[:, None] * self.rates * frequency_errors
        # Vibrations in opposite phase differ by twice the amplitude.
        shares = (np.minimum(phases, 2.0) * factors) ** 2
        return np.sqrt(2.0 * np.max(np.sum(shares[:, :, None] * self.squares, axis=1), axis=0))


def long_element_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    observe: Callable[[Array], Array],
    is_lightly_damped: Callable[[], bool],
    examined: Collection[str] = (),
) -> Iterator[str]:
    """Yield a warning per beam with elements so long that vibrations drift out of phase.

    Elements of the length h raise the frequency of bending waves with the wave number k by a
    fraction proportional to (k h)^6. The error of the phase grows with every period. It is computed
    from the spectra of the sections' rotations and of the columns, of which the smaller error
    counts: columns contain rigid motions, and rotations are larger than those of a column's point.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    extremes
        Extremes of the observed columns, by header.
    observe
        Function that returns the observed columns (k, n) at ascending times (k,).
    is_lightly_damped
        Function that returns True if errors of vibrations accumulate.
    examined
        Names of beams to leave out; see `forced_vibrations`.
    """
    duration = trajectory.end - trajectory.start
    fastest = fastest_rate(trajectory)
    if fastest is None or not extremes:
        return
    beams = [
        beam
        for beam in beams_of(equations.mechanism)
        if beam.name not in examined
        and duration * fastest * bending_wave_errors(beam, np.array([fastest]))[0]
        > _MAX_PHASE_ERROR
    ]
    count = sample_count(trajectory)
    if not beams or count * equations.n > MAX_SAMPLED_NUMBERS or not is_lightly_damped():
        return
    times = np.linspace(trajectory.start, trajectory.end, count)
    spectrum_of_columns = cache(lambda: _Spectrum.of_samples(observe(times), duration))
    for beam in beams:
        half_ranges = select_beam_columns(equations, beam, extremes)
        columns = rotation_coordinates(equations, beam)
        if not half_ranges or len(columns) < 2:
            continue
        # Sums over long columns are faster and more accurate than over short rows.
        angles = np.asfortranarray(trajectory.positions_at(times, columns))
        rotations = angles[:, 1:] - angles[:, :1]
        vibration = _Vibration(beam, _Spectrum.of_samples(rotations, duration))
        if not vibration.has_errors(half_ranges):
            continue
        vibration = vibration._replace(tension=mean_tension(equations, beam, trajectory))
        if not vibration.has_errors(half_ranges):
            continue
        spectrum = spectrum_of_columns().select(
            [equations.observed_headers.index(x) for x in half_ranges]
        )
        errors = vibration.errors(half_ranges, spectrum)
        if max(errors.values()) > _MAX_PHASE_ERROR:
            yield _describe(vibration, half_ranges, spectrum, errors)


class _Vibration(NamedTuple):
    """Vibration of a beam.

    Attributes
    ----------
    beam
        The beam.
    rotations
        Spectrum of the rotations of its sections relative to the first one [rad].
    tension
        Mean tension in the elements, (elements,) or the same in all [N].
    """

    beam: Beam
    rotations: _Spectrum
    tension: Array | float = 0.0

    def has_errors(self, half_ranges: Mapping[str, float]) -> bool:
        """Return True if errors of the sections are large beside the half range of a column."""
        largest = self._largest_errors(self._frequency_errors())
        return any(
            largest[Header.of(x).unit] > _MAX_PHASE_ERROR * half_ranges[x] for x in half_ranges
        )

    def errors(
        self, half_ranges: Mapping[str, float], columns: _Spectrum, refinement: float = 1.0
    ) -> dict[str, float]:
        """Return the error of each column relative to half its range, by header.

        Parameters
        ----------
        half_ranges
            Half the range of each column, by header.
        columns
            Spectrum of the columns, in this order.
        refinement
            Factor of the number of elements.
        """
        frequency_errors = self._frequency_errors() * refinement ** -convergence_order(self.beam)
        largest = self._largest_errors(frequency_errors)
        pairs = zip(half_ranges.items(), columns.phase_error(frequency_errors), strict=True)
        return {x: min(largest[Header.of(x).unit], float(e)) / size for (x, size), e in pairs}

    def _frequency_errors(self) -> Array:
        return bending_wave_errors(self.beam, self.rotations.rates, self.tension)

    def _largest_errors(self, frequency_errors: Array) -> dict[str, float]:
        """Return the largest error of columns of the beam, by unit."""
        rates, tension = self.rotations.rates, self.tension
        factors = rotation_factors(self.beam, rates, tension)
        numbers = np.mean(bending_wave_numbers(self.beam, rates, tension), axis=1)
        shape = _MAX_SHAPE_FACTOR / np.maximum(numbers, numbers[1])  # no signal has the rate 0
        factors |= {"m": shape, "m/s": rates * shape}
        errors = self.rotations.phase_error
        return {unit: float(np.max(errors(frequency_errors, x))) for unit, x in factors.items()}


def _describe(
    vibration: _Vibration,
    half_ranges: Mapping[str, float],
    spectrum: _Spectrum,
    errors: Mapping[str, float],
) -> str:
    """Return the warning about a beam."""
    names = sorted((x for x in errors if errors[x] > _MAX_PHASE_ERROR), key=lambda x: -errors[x])
    first, *others = map(remove_unit, names)
    largest = errors[names[0]]
    size = format_error(largest, LARGE_ERROR)
    beam, refined = vibration.beam, partial(vibration.errors, half_ranges, spectrum)
    remedy = recommend_elements(beam, largest, refined, _RECOMMENDED_PHASE_ERROR)
    return (
        f"{beam.name}: the elements are too long for its vibration, and the phase error that "
        f"accumulates is {size} of half the range of {name_with_others(first, others)}; "
        f"{remedy}."
    )
