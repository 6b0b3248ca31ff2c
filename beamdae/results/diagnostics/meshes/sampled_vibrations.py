"""Sampling of the vibrations of beams in a run, and the columns that show them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import Beam
from beamdae.beams.dispersion import bending_wave_numbers, element_middles, section_values
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.results.columns import Header
from beamdae.results.diagnostics.resolution.missed_peaks import StepExtremes, select_large_columns
from beamdae.results.section_forces.balance import elastic_axial_forces
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

LARGE_ERROR = 0.95  # larger estimates are meaningless
_UNITS_OF_POSITIONS = ("m", "rad")
_UNITS = (*_UNITS_OF_POSITIONS, "m/s", "rad/s", "Pa", "N", "N m")
# Columns whose half range is smaller, relative to the largest one of their kind, are left out.
_MIN_SHARE = 1e-3
# So are rates, stresses and forces that vary by less, relative to their largest magnitude, such as
# those of steady rotations.
_MIN_VARIATION = 1e-2
# So are positions and angles that vary by less [length of the mechanism, rad], which is rounding:
# those of a blade at constant speed vary by 1e-10.
_MIN_MOTION = 1e-8
# Equally spaced times at which a run is sampled, per step and in total. Spectra need several
# periods.
_SAMPLES_PER_STEP = 2
_MIN_SAMPLES, _MAX_SAMPLES = 512, 8192
MAX_SAMPLED_NUMBERS = 8_000_000  # coordinates, 64 MB
_MIN_STEPS = 50
# Vibrations with fewer periods in half the run are not distinguished from slow motions: the main
# lobe of the window extends to 3 periods.
MIN_PERIODS = 4
_STEPS_PER_PERIOD = 8.0  # fewer steps do not resolve a vibration
_TENSION_SAMPLES = 5
_MAX_OFFSET = 2.0  # of the edges of sections from the axis, in radii of gyration
_REFINEMENT = 1.1  # of the number of elements, in the search for a sufficient one
# Of 4 runs that need more than this factor by the estimate, 3 had errors of 19 % and more with it:
# waves of undamped sudden loads are shorter than the elements of any mesh.
_MAX_REFINEMENT = 8.0
# Frames that turn by more [rad] have no constant matrices.
MAX_TURN = 0.5


def fastest_rate(trajectory: Trajectory) -> float | None:
    """Return the largest angular frequency [rad/s] that steps resolve; None for few steps."""
    n_steps = _count_steps(trajectory)
    # Runs that store few of their steps do not contain fast vibrations.
    if n_steps < _MIN_STEPS or not trajectory.stores_all_steps:
        return None
    return 2.0 * np.pi * n_steps / (_STEPS_PER_PERIOD * (trajectory.end - trajectory.start))


def sample_count(trajectory: Trajectory) -> int:
    """Return the even number of equally spaced times at which a run is sampled.

    Fourier transforms of halves with large prime factors would take several times as long.
    """
    count = _SAMPLES_PER_STEP * _count_steps(trajectory)
    half = int(np.clip(count, _MIN_SAMPLES, _MAX_SAMPLES)) // 2
    unit = 1 << max(half.bit_length() - 4, 0)
    return 2 * unit * -(-half // unit)


def _count_steps(trajectory: Trajectory) -> int:
    return sum(x.step_count for x in trajectory.intervals)


@lru_cache(maxsize=4)
def spectral_window(count: int) -> tuple[Array, Array]:
    """Return equally spaced numbers from -1 to 1 and the window cos^4 at these, (count, 1) each."""
    x = np.linspace(-1.0, 1.0, count)[:, None]
    return x, np.cos(0.5 * np.pi * x) ** 4


def select_beam_columns(
    equations: EquationsOfMotion, beam: Beam, extremes: Mapping[str, StepExtremes]
) -> dict[str, float]:
    """Return half the range of columns that depend on the motion of a beam, by header.

    These are positions, rates, stresses and section forces, but no reactions.
    """
    half_ranges = select_large_columns(list(extremes), extremes, equations.length, _MIN_SHARE)
    rows = coordinates_of(equations, beam)

    def depends_on_beam(operator: sp.csr_array) -> bool:
        indices = operator.indices
        return bool(((indices >= rows.start) & (indices < rows.stop)).any())

    def varies(header: str) -> bool:
        unit, extreme = Header.of(header).unit, extremes[header]
        largest = max(abs(extreme.max), abs(extreme.min))
        if unit in _UNITS_OF_POSITIONS:
            scale = equations.length if unit == "m" else 1.0
            return half_ranges[header] > _MIN_MOTION * scale
        return unit in _UNITS and half_ranges[header] > _MIN_VARIATION * largest

    return {
        header: half_ranges[header]
        for observable in equations.observables
        if depends_on_beam(observable.operator) and observable.rows.start == observable.rows.stop
        for header in observable.headers
        if header in half_ranges and varies(header)
    }


def rotation_factors(
    beam: Beam, rates: Array, tension: Array | float = 0.0
) -> dict[str, Array | float]:
    """Return the amplitudes of columns in bending waves with the amplitude 1 rad, by unit.

    Stresses are those at the largest distance from the axis.

    Parameters
    ----------
    beam, rates, tension
        See `beams.dispersion.bending_wave_numbers`.
    """
    stiffness, area, second_moment = section_values(beam, "EI", "area", "second_moment")
    modulus = stiffness / second_moment
    offset = _MAX_OFFSET * np.sqrt(second_moment / area)
    numbers = bending_wave_numbers(beam, rates, tension)
    return {
        "rad": 1.0,
        "rad/s": rates,
        "Pa": np.max(modulus * offset * numbers, axis=1),
        "N m": np.max(stiffness * numbers, axis=1),
        "N": np.max(stiffness * numbers**2, axis=1),
    }


def recommend_elements(
    beam: Beam, largest: float, refined: Callable[[float], Mapping[str, float]], sufficient: float
) -> str:
    """Return the remedy for elements that are too long, for the end of a warning.

    Parameters
    ----------
    beam
        The beam.
    largest
        The largest error of a column, relative to half its range.
    refined
        Function that returns the errors with a multiple of the number of elements.
    sufficient
        Error that suffices.
    """
    refinement = _REFINEMENT
    while refinement < _MAX_REFINEMENT and max(refined(refinement).values()) >= sufficient:
        refinement *= _REFINEMENT
    if refinement >= _MAX_REFINEMENT:
        count = int(_MAX_REFINEMENT * beam.mesh.elements)
        waves = "or suppress the fastest waves by material damping or slower loads"
        return f"use more than elements={count}, {waves}"
    # Large errors hide further vibrations.
    at_least = "at least " if largest >= LARGE_ERROR else ""
    return f"use {at_least}elements={int(np.ceil(refinement * beam.mesh.elements))}"


def mean_tension(equations: EquationsOfMotion, beam: Beam, trajectory: Trajectory) -> Array:
    """Return the mean tension in the elements of a beam during a run, (elements,) [N]."""
    times = np.linspace(trajectory.start, trajectory.end, _TENSION_SAMPLES)
    _, states = trajectory.at(times)
    forces = [
        elastic_axial_forces(beam, equations, State(*(x[k] for x in states)), element_middles(beam))
        for k in range(len(times))
    ]
    return np.maximum(np.mean(forces, axis=0), 0.0)


def coordinates_of(equations: EquationsOfMotion, beam: Beam) -> range:
    """Return the indices of the coordinates of a beam."""
    part = equations.coordinates_of_part(beam.name)
    return range(part.rows.start, part.rows.stop)


def turning_coordinates(equations: EquationsOfMotion, beam: Beam) -> list[int]:
    """Return the indices of the angle of a beam's frame or, without one, of all its sections."""
    part = equations.coordinates_of_part(beam.name)
    angles = [k for k in coordinates_of(equations, beam) if equations.is_angle[k]]
    return [k for k in angles if part.rigid.start <= k < part.rigid.stop] or angles


def rotation_coordinates(equations: EquationsOfMotion, beam: Beam) -> list[int]:
    """Return the indices of the rotations of a beam's sections relative to its frame."""
    part = equations.coordinates_of_part(beam.name)
    return [k for k in range(part.rigid.stop, part.rows.stop) if equations.is_angle[k]]


def turns(angles: Array) -> bool:
    """Return True if all angles (k, n) turn by more than linear models of a beam permit."""
    return bool(np.min(np.ptp(angles, axis=0)) > MAX_TURN)
