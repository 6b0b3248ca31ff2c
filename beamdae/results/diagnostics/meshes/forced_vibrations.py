"""Errors of vibrations about a mechanism at rest by the lengths of the elements of beams.

Elements of the length h raise the natural frequencies of waves with the wave number k by a fraction
e proportional to (k h)^p; see `beams.dispersion`. A vibration u(t) = Re(q exp(i omega t)) then has
the error

    d = D^-1 (2 e Kb q),    D = K - 2 e Kb + s C + s^2 M,    s = i omega + 1 / T

under the constraints, where Kb is the stiffness of the beam, which is too large by 2 e. Near
resonances, d is a multiple of q. The duration T of the vibration limits it: without damping and
loads, d is the error e omega T q of a phase that is small.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import groupby
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.dispersion import (
    axial_wave_error,
    bending_wave_errors,
    convergence_order,
    element_middles,
    section_values,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import format_error, name_with_others
from beamdae.results.columns import Header, remove_unit
from beamdae.results.diagnostics.meshes.sampled_vibrations import (
    LARGE_ERROR,
    MAX_SAMPLED_NUMBERS,
    MIN_PERIODS,
    coordinates_of,
    fastest_rate,
    mean_tension,
    recommend_elements,
    rotation_factors,
    sample_count,
    select_beam_columns,
    spectral_window,
    turning_coordinates,
    turns,
)
from beamdae.results.diagnostics.resolution.missed_peaks import StepExtremes
from beamdae.results.section_forces.balance import elastic_section_forces
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Error relative to half the range of a column from which on a run has a warning. In 130 runs of
# clamped, hinged, curved and shaken beams and of bars with 1 to 5 elements, the estimate was 0.2 to
# 2 times the error up to 50 %, and 0.8 to 1.2 times near resonances.
_MAX_ERROR = 0.02
_RECOMMENDED_ERROR = 0.004
# Smaller phase errors e omega T [rad], to which no damping adds, are not examined.
_MIN_PHASE_ERROR = 1e-3
_LARGEST_FREQUENCY_ERROR = 0.3  # larger estimates are meaningless
# Factor of the sum of the largest phase errors of the spectrum that bounds the errors of columns.
# In 60 runs of cantilevers, arcs, rods and clamped beams, it was at least twice the estimate.
_BOUND_FACTOR = 2.0
_MAX_ERROR_OF_AMPLITUDE = 10.0  # relative to the amplitude; errors up to 5 were measured
# Peaks of the spectrum with less than this share of the largest strain energy are left out, and
# further ones than these.
_MIN_ENERGY = 1e-6
_MAX_PEAKS = 10
# The first half of a run counts if the vibration decays to less than the inverse of this factor. It
# is measured by second differences of a few samples, which slow motions do not contain.
_MIN_DECAY, _FEW_SAMPLES = 2.0, 100
_SUMS_AT_ONCE = 8  # coordinates
_UNITS_OF_POINTS = ("m", "m/s")
_DIFFERENCE = 1e-5  # change of a coordinate, relative to its scale, for differences


def examine_vibrations(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    observe: Callable[..., Array],
) -> Iterator[tuple[str, tuple[float, str]]]:
    """Yield the name of each beam that vibrates about rest, its error, and a warning or "".

    The warning states that elements are so long that amplitudes or phases are wrong. If events
    switch parts, the longest time between them is examined.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    extremes
        Extremes of the observed columns, by header.
    observe
        Function that returns the observed columns at rows of (t, branch) and of q, v, a, lam.
    """
    trajectory = _longest_stretch(trajectory)
    fastest = fastest_rate(trajectory)
    if fastest is None or not extremes:
        return
    duration = trajectory.end - trajectory.start
    beams = [
        x
        for x in beams_of(equations.mechanism)
        if bending_wave_errors(x, np.array([fastest]))[0] * fastest * duration > _MIN_PHASE_ERROR
    ]
    count = sample_count(trajectory)
    for beam in beams:
        half_ranges = select_beam_columns(equations, beam, extremes)
        rows = coordinates_of(equations, beam)
        if not half_ranges or count * len(rows) > MAX_SAMPLED_NUMBERS:
            continue
        angles = turning_coordinates(equations, beam)
        if turns(np.concatenate([x.rows.q[:, angles] for x in trajectory.intervals])):
            continue
        vibration = _Vibration.of_run(equations, trajectory, beam, count)
        # Most runs need neither the linearization nor the factorizations below.
        if vibration.bound(half_ranges, observe) <= _MAX_ERROR:
            yield beam.name, (0.0, "")
            continue
        measure = partial(vibration.measure, half_ranges, observe)
        try:
            errors, warning = measure(), ""
            if max(errors.values()) > _MAX_ERROR:
                measure = partial(measure, mean_tension(equations, beam, trajectory))
                errors = measure()
                if max(errors.values()) > _MAX_ERROR:
                    warning = _describe(beam, errors, measure)
        except RuntimeError:  # dependent constraints
            continue
        yield beam.name, (max(errors.values()), warning)


def _longest_stretch(trajectory: Trajectory) -> Trajectory:
    """Return the longest part of a run in which no event switches parts."""
    groups = groupby(trajectory.intervals, lambda x: x.inactive)
    stretches = [Trajectory(tuple(intervals)) for _, intervals in groups]
    return max(stretches, key=lambda x: x.end - x.start)


class _Peaks(NamedTuple):
    """Peaks of a spectrum.

    Attributes
    ----------
    rates
        Angular frequencies (k,) [rad/s].
    amplitudes
        Complex amplitudes (k, n).
    forces
        Elastic forces of the beam (k, n).
    """

    rates: Array
    amplitudes: Array
    forces: Array


@dataclass(frozen=True)
class _Vibration:
    """Vibration of a beam about its mean position, in the half of a run in which it is larger.

    Attributes
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    beam
        The beam.
    middle
        Time at which the position of the beam is closest to its mean position [s].
    rates
        Angular frequencies (k,) [rad/s].
    amplitudes
        Complex amplitudes (k, c) of the coordinates of the beam.
    duration
        Time from the start of the run to the end of this half [s].
    """

    equations: EquationsOfMotion
    trajectory: Trajectory
    beam: Beam
    middle: float
    rates: Array
    amplitudes: Array
    duration: float

    @classmethod
    def of_run(
        cls, equations: EquationsOfMotion, trajectory: Trajectory, beam: Beam, count: int
    ) -> _Vibration:
        """Return the vibration, from half of `count` samples of the run."""
        columns = _slice_of(equations, beam)
        start, end = trajectory.start, trajectory.end
        half = 0.5 * (end - start)
        few = trajectory.positions_at(np.linspace(start, end, 2 * _FEW_SAMPLES), columns)
        bends = np.abs(np.diff(few.reshape(2, _FEW_SAMPLES, -1), 2, axis=1)).mean(axis=1)
        first, second = np.max(bends / equations.position_scales[columns], axis=1)
        begin = start if first > _MIN_DECAY * second else start + half
        times = np.linspace(begin, begin + half, count // 2)
        # One row per coordinate: sums over long rows are faster than over short ones.
        q = np.array(trajectory.positions_at(times, columns).T, order="C")
        x, window = (values[:, 0] for values in spectral_window(len(times)))
        q -= q.mean(axis=1, keepdims=True)
        q -= (q @ x / np.sum(x**2))[:, None] * x
        nearest = np.argmin(equations.position_scales[columns] ** -2.0 @ q**2)
        q *= 2.0 / np.sum(window) * window
        amplitudes = np.fft.rfft(q, axis=1).T
        amplitudes[:MIN_PERIODS] = 0.0
        rates = 2.0 * np.pi / half * np.arange(len(amplitudes))
        middle, duration = float(times[nearest]), float(times[-1] - start)
        return cls(equations, trajectory, beam, middle, rates, amplitudes, duration)

    @cached_property
    def _position(self) -> tuple[Array, State]:
        """(t, branch) and the position closest to the mean position, at rest.

        At the mean position, a beam that bends would be compressed.
        """
        rows, state = self.trajectory.at(np.array([self.middle]))
        rest = np.zeros(self.equations.n)
        return rows[0], State(state.q[0], rest, rest, np.zeros(self._active_equations.m))

    def bound(self, half_ranges: Mapping[str, float], observe: Callable[..., Array]) -> float:
        """Return a bound of the errors of columns relative to half their ranges.

        With the phase error e omega T, which no resonance exceeds, of the frequencies at which the
        errors are largest, also of those without a peak, it needs no matrices. Forces and stresses
        are those of bending.

        Parameters
        ----------
        half_ranges
            Half the range of each column, by header.
        observe
            See `examine_vibrations`.
        """
        e, part = self.equations, self.equations.coordinates_of_part(self.beam.name)
        phase_errors = bending_wave_errors(self.beam, self.rates) * self.rates * self.duration
        is_large = phase_errors >= _MIN_PHASE_ERROR
        rates = self.rates[is_large]
        phase_errors = np.minimum(phase_errors[is_large], _MAX_ERROR_OF_AMPLITUDE)
        changes = phase_errors * np.abs(self.amplitudes.T[:, is_large])
        is_angle = e.is_angle[_slice_of(e, self.beam)]
        is_turn = is_angle & (np.arange(len(is_angle)) < part.rigid_count)
        factors = rotation_factors(self.beam, rates) | {"m": 1.0, "m/s": rates}
        units = {x: Header.of(x).unit for x in half_ranges}
        ratios: dict[str, float] = {}
        for unit in dict.fromkeys(units.values()):
            sizes = {x: size for x, size in half_ranges.items() if units[x] == unit}
            is_point = unit in _UNITS_OF_POINTS
            is_kind = ~is_angle if is_point else is_angle
            arm = self.beam.length if is_point else 1.0
            sums = _sum_all(factors[unit], changes)
            error = arm * np.max(sums, where=is_turn, initial=0.0)
            error += np.max(sums, where=is_kind, initial=0.0)
            # Sums over all peaks take a hundredth of the time, and suffice for most units.
            if error > _MAX_ERROR * min(sizes.values()):
                error = arm * _largest_sum(factors[unit], changes, sums, is_turn)
                error += _largest_sum(factors[unit], changes, sums, is_kind)
            ratios |= {x: float(error) / size for x, size in sizes.items()}
        # Motions along the axis are often much smaller than those of other coordinates.
        large = [x for x in ratios if ratios[x] > _MAX_ERROR]
        if large and all(units[x] in _UNITS_OF_POINTS for x in large):
            gradients = self._observe_coordinates(large, observe)
            for header, gradient in zip(large, gradients.T, strict=True):
                errors = _sum_largest(factors[units[header]], changes)
                ratios[header] = float(gradient @ errors) / half_ranges[header]
        return max(ratios.values())

    def _observe_coordinates(self, headers: list[str], observe: Callable[..., Array]) -> Array:
        """Return magnitudes (c, columns) of the derivatives by the coordinates of the beam.

        Those of velocities are the derivatives by the velocities.
        """
        e, (time, state) = self.equations, self._position
        columns = _slice_of(e, self.beam)
        sizes = _DIFFERENCE * e.position_scales[columns]
        steps = np.zeros((len(sizes), e.n))
        steps[:, columns] = np.diag(sizes)
        steps = np.concatenate([steps, -steps])
        still = np.zeros_like(steps)
        states = State(state.q + steps, steps, still, np.zeros((len(steps), e.m)))
        values = observe(np.tile(time, (len(steps), 1)), *states)
        values = values[:, [e.observed_headers.index(x) for x in headers]]
        return np.asarray(np.abs(np.subtract(*np.split(values, 2))) / (2.0 * sizes[:, None]))

    @cached_property
    def _matrices(self) -> tuple[sp.csc_array, sp.csc_array, sp.csc_array]:
        """Return K, C and M."""
        return ConsistencySolver(self._active_equations).linearize_forces(*self._position)

    @property
    def _active_equations(self) -> EquationsOfMotion:
        return self.trajectory.intervals[0].active_equations(self.equations)

    @cached_property
    def _own_stiffness(self) -> sp.csc_array:
        """Return the rows and columns of the beam in K; all others are zero."""
        is_own = np.zeros(self.equations.n)
        is_own[_slice_of(self.equations, self.beam)] = 1.0
        own = sp.diags_array(is_own)
        return sp.csc_array(own @ self._matrices[0] @ own)

    @cached_property
    def _constraint_jacobian(self) -> sp.csc_array:
        time, state = self._position
        return ConsistencySolver(self._active_equations).constraint_matrix(time, state.q)

    @cached_property
    def _peaks(self) -> _Peaks:
        """Return the peaks of the strain energy with phase errors that are not small."""
        columns = _slice_of(self.equations, self.beam)
        forces = (self._own_stiffness[columns, columns] @ self.amplitudes.T).T
        energies = np.sum((self.amplitudes.conj() * forces).real, axis=1)
        padded = np.pad(energies, 1)
        is_peak = (energies >= padded[:-2]) & (energies > padded[2:])
        is_peak &= energies > _MIN_ENERGY * np.max(energies)
        is_peak[[MIN_PERIODS, -1]] = False  # have only one neighbor
        peaks = np.flatnonzero(is_peak)
        peaks = peaks[np.argsort(-energies[peaks])][:_MAX_PEAKS]
        rates = np.array([self._refine(energies, k) for k in peaks.tolist()])
        phase_errors = bending_wave_errors(self.beam, rates) * rates * self.duration
        is_large = phase_errors >= _MIN_PHASE_ERROR
        peaks = peaks[is_large]
        of_peaks = np.zeros((2, len(peaks), self.equations.n), complex)
        of_peaks[:, :, columns] = self.amplitudes[peaks], forces[peaks]
        return _Peaks(rates[is_large], *of_peaks)

    def measure(
        self,
        half_ranges: Mapping[str, float],
        observe: Callable[..., Array],
        tension: Array | float = 0.0,
        refinement: float = 1.0,
    ) -> dict[str, float]:
        """Return the errors of columns relative to half their ranges.

        Parameters
        ----------
        half_ranges
            Half the range of each column, by header.
        observe
            See `examine_vibrations`.
        tension
            Tension in the elements, (elements,) or the same in all [N].
        refinement
            Factor of the number of elements.
        """
        totals = np.zeros(len(half_ranges))
        peaks, beam = self._peaks, self.beam
        if len(peaks.rates):
            errors = bending_wave_errors(beam, peaks.rates, tension)
            is_large = errors * peaks.rates * self.duration >= _MIN_PHASE_ERROR
            for k in np.flatnonzero(is_large).tolist():
                rate, share = float(peaks.rates[k]), self._axial_shares[k]
                error = float(errors[k])
                error += share * (axial_wave_error(beam, rate) - error)
                error *= refinement ** -convergence_order(beam)
                change = self._change(rate, error, peaks.forces[k])
                totals += self._observe(rate, change, half_ranges, observe)
        sizes = np.array(list(half_ranges.values()))
        return dict(zip(half_ranges, (totals / sizes).tolist(), strict=True))

    def _change(self, rate: float, error: float, forces: Array) -> Array:
        """Return the error (n,) of the amplitudes with these forces by the error of frequencies."""
        # Imported here because most runs need no factors.
        from scipy.sparse.linalg import splu

        stiffness, damping, mass = self._matrices
        jacobian = self._constraint_jacobian
        change_of_stiffness = 2.0 * min(error, _LARGEST_FREQUENCY_ERROR)
        s = 1j * rate + 1.0 / self.duration
        dynamic = stiffness - change_of_stiffness * self._own_stiffness + s * damping + s**2 * mass
        right = np.concatenate([change_of_stiffness * forces, np.zeros(jacobian.shape[0])])
        matrix = sp.block_array([[dynamic, jacobian.T], [jacobian, None]], format="csc")
        return np.asarray(splu(matrix).solve(right)[: self.equations.n])

    def _refine(self, energies: Array, k: int) -> float:
        """Return the angular frequency of the peak `k` of the spectrum [rad/s]."""
        before, at, after = np.log(np.maximum(energies[k - 1 : k + 2], 1e-300))
        offset = 0.5 * (before - after) / (before - 2.0 * at + after)
        return float(self.rates[1] * (k + np.clip(offset, -0.5, 0.5)))

    @cached_property
    def _axial_shares(self) -> list[float]:
        """Return the shares of axial strains in the strain energies of the peaks."""
        e, beam, amplitudes = self.equations, self.beam, self._peaks.amplitudes
        count = len(amplitudes)
        scales = _DIFFERENCE / np.max(np.abs(amplitudes) / e.position_scales, axis=1)
        parts = np.concatenate([amplitudes.real, amplitudes.imag])
        steps = np.tile(scales, 2)[:, None] * parts
        # All states at once: sections and operators are prepared only once.
        q = self._position[1].q + np.concatenate([steps, -steps])
        states = State(q, np.zeros_like(q), np.zeros_like(q), np.zeros((len(q), e.m)))
        forces = elastic_section_forces(beam, e, states, element_middles(beam))
        changes = (forces[:, : 2 * count] - forces[:, 2 * count :]) / np.tile(scales, 2)[:, None]
        axial, bending = section_values(beam, "EA", "EI")
        lengths = beam.mesh.element_lengths
        of_axial, of_bending = (
            (changes[k] ** 2 / stiffness @ lengths).reshape(2, count).sum(axis=0)
            for k, stiffness in ((0, axial), (2, bending))
        )
        shares: list[float] = (of_axial / np.maximum(of_axial + of_bending, 1e-300)).tolist()
        return shares

    def _observe(
        self,
        rate: float,
        change: Array,
        half_ranges: Mapping[str, float],
        observe: Callable[..., Array],
    ) -> Array:
        """Return the amplitudes of columns of a change (n,) of the amplitudes.

        Forces of the linear equations are not used: they lack those by which beams that bend
        shorten, so that reactions would be wrong by up to 25 times half their range.
        """
        e, (time, state) = self.equations, self._position
        scale = _DIFFERENCE / np.max(np.abs(change) / e.position_scales)

        def steps(x: Array) -> Array:
            return scale * np.array([x.real, -x.real, x.imag, -x.imag])

        q = state.q + steps(change)
        states = State(q, steps(1j * rate * change), np.zeros_like(q), np.zeros((4, e.m)))
        values = observe(np.tile(time, (4, 1)), *states)
        columns = values[:, [e.observed_headers.index(x) for x in half_ranges]]
        return np.asarray(
            np.hypot(columns[0] - columns[1], columns[2] - columns[3]) / (2.0 * scale)
        )


def _slice_of(equations: EquationsOfMotion, beam: Beam) -> slice:
    rows = coordinates_of(equations, beam)
    return slice(rows.start, rows.stop)


def _sum_all(factors: Array | float, changes: Array) -> Array:
    """Return the sums of changes (c, k) times factors (k,) over all peaks as a bound, (c,)."""
    return np.asarray(_BOUND_FACTOR * (changes @ np.broadcast_to(factors, changes.shape[1])))


def _sum_largest(factors: Array | float, changes: Array) -> Array:
    """Return the bound (c,) of `_sum_all` over the largest peaks of each coordinate."""
    products = factors * changes
    if products.shape[1] > _MAX_PEAKS:
        products = np.partition(products, -_MAX_PEAKS, axis=1)[:, -_MAX_PEAKS:]
    return np.asarray(_BOUND_FACTOR * products.sum(axis=1))


def _largest_sum(factors: Array | float, changes: Array, sums: Array, where: Array) -> float:
    """Return the largest of `_sum_largest` of the coordinates `where`; `sums` is `_sum_all`."""
    (rows,) = np.nonzero(where)
    rows, largest = rows[np.argsort(-sums[rows])], 0.0
    for first in range(0, len(rows), _SUMS_AT_ONCE):
        block = rows[first : first + _SUMS_AT_ONCE]
        if not sums[block[0]] > largest:
            break  # No further sum is larger, even over all peaks.
        largest = max(largest, float(np.max(_sum_largest(factors, changes[block]))))
    return largest


def _describe(
    beam: Beam, errors: Mapping[str, float], refined: Callable[[float], Mapping[str, float]]
) -> str:
    """Return the warning about a beam; `refined` returns the errors with shorter elements."""
    names = sorted((x for x in errors if errors[x] > _MAX_ERROR), key=lambda x: -errors[x])
    first, *others = map(remove_unit, names)
    largest = errors[names[0]]
    size = format_error(largest, LARGE_ERROR)
    remedy = recommend_elements(beam, largest, refined, _RECOMMENDED_ERROR)
    return (
        f"{beam.name}: the elements are too long for its vibration, whose amplitude or phase is "
        f"wrong by {size} of half the range of {name_with_others(first, others)}; {remedy}."
    )
