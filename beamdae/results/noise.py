"""Columns that are noise: rounding errors, drift of constraints, errors of the integration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.parts.bodies.point_mass import PointMass
from beamdae.parts.bodies.rigid_body import RigidBody
from beamdae.results.columns import (
    NO_OTHERS,
    UNITS_OF_ACCELERATIONS,
    UNITS_OF_FORCES,
    Header,
    is_position,
    largest_of_kind,
)
from beamdae.results.run_data import RunData

Array = np.ndarray

# Half ranges of columns at rest.
_REST_TO_OTHERS_RATIO = 1e-9  # relative to the largest half range of a column with the same unit
_REST_TO_VALUES_RATIO = 1e-12  # relative to the largest value of the column: rounding errors
_UNDERFLOW = np.finfo(float).eps ** 2  # rounding errors of rounding errors, in any unit
_REST_TO_SIZE_RATIO = 1e-12  # relative to the size of the mechanism, or to 1 rad: rounding errors

# Strains of geometrically exact beams that fall freely 4 m above the origin, with elements of
# 15 mm, are up to 1e-12; those of beams in floating frames are smaller.
_ROUNDING_STRAIN = 1e-11
# Accelerations in free fall vary by up to 1e-10 of gravity, divided by the length of the mechanism
# for angles.
_ROUNDING_OF_GRAVITY = 1e-9
# Positions of bodies at rest change by less in a step, relative to the length of the mechanism or
# to 1 rad.
_ROUNDING_OF_POSITIONS = 1e-12

# Half ranges of columns that are constant but for errors of the integration. Stresses of a rotating
# blade vary by up to 10 times rtol, its deflections by up to 3e-3 times.
_ERROR_TO_VALUE_RATIO = 10.0  # relative to rtol and the largest value
MAX_ERROR_TO_VALUE_RATIO = 1e-3  # for all rtol
_ERROR_TO_SIZE_RATIO = 3e-3  # relative to rtol and the size of the mechanism, or 1 rad

# Half ranges relative to the largest ones of their kind: of columns that vanish but for rounding
# errors, e.g. by symmetry, and, relative to rtol as well, by errors of the integration. Positions
# that joints hold fixed move by up to 0.002 rtol, their rates by 0.009 rtol; between steps,
# accelerations of fixed points of four-bar linkages reach 1.3 rtol of the largest one.
_VANISHING_TO_OTHERS_RATIO = 8e-7
_ERROR_TO_OTHERS_RATIO, _ERROR_TO_OTHER_ACCELERATIONS_RATIO = 0.01, 3.0
_UNITS_OF_DRIFT = ("m", "rad", "m/s", "rad/s")
_DRIFT_FACTOR = 3.0  # levers may enlarge violations of constraints
_MIN_NOISE_SHARE = 0.5  # difference of two computations of noise, relative to half the range


def mark_noise(
    run: RunData, values: Array, half_range: Array, differences: Array, *others: RunData
) -> Array:
    """Return the mask of the observed columns that vary by errors only.

    These are rounding errors and, where two computations differ by more than a quarter of the
    range, columns whose range and differences do not exceed the errors of the integration, relative
    to the mechanism or to columns of the same kind, and of the constraints.

    Parameters
    ----------
    run
        The run.
    values
        Values of the columns (k, columns), such as their extremes.
    half_range
        Half the range of each column, (columns,).
    differences
        Largest difference of two computations of each column, (columns,).
    others
        Further runs, whose drift of the constraints is considered, too.
    """
    e, rtol = run.equations, run.integrator.get("rtol") or 0.0
    headers, mechanism = e.observed_headers, run._sizes_of_mechanism
    sizes = np.maximum(half_range, 0.5 * differences)
    is_noise = mark_resting_columns(headers, values, sizes, e.length, others=mechanism)
    is_noise |= sizes <= rounding_limits(e, headers, run.trajectory.mean_step)
    is_doubtful = ~is_noise & (differences > _MIN_NOISE_SHARE * half_range)
    units = [Header.of(x).unit for x in headers]
    limits = _limits_of_positions(headers, e.length, rtol)
    ratios = np.where(
        np.isin(units, UNITS_OF_ACCELERATIONS),
        _ERROR_TO_OTHER_ACCELERATIONS_RATIO,
        _ERROR_TO_OTHERS_RATIO,
    )
    # Forces are also compared with constant ones, such as the centrifugal force.
    compared = np.where(np.isin(units, UNITS_OF_FORCES), np.max(np.abs(values), axis=0), half_range)
    largest = largest_of_kind(headers, compared, e.length, mechanism)
    limits = np.maximum(limits, np.maximum(ratios * rtol, _VANISHING_TO_OTHERS_RATIO) * largest)
    moves = is_doubtful & np.isin(units, _UNITS_OF_DRIFT)
    for one in (run, *others):
        if np.any(sizes[moves] > limits[moves]):
            position, velocity = one._drift
            drift = position, position / e.length, velocity, velocity / e.length
            by_unit = dict(zip(_UNITS_OF_DRIFT, drift, strict=True))
            drifts = [_DRIFT_FACTOR * by_unit.get(unit, 0.0) for unit in units]
            limits = np.maximum(limits, drifts)
    return np.asarray(is_noise | (is_doubtful & (sizes <= limits)))


def mark_vanishing_columns(
    headers: Sequence[str], half_range: Array, differences: Array, length: float
) -> Array:
    """Return the mask of the columns that differ by errors only, far below others of their kind.

    `differences` are the largest ones of two computations of each column, (columns,), and `length`
    is that of the mechanism [m], beside which those of positions must be as small: a computation
    that leaves a symmetric path differs by more.
    """
    is_doubtful = differences > _MIN_NOISE_SHARE * half_range
    for sizes, others in ((half_range, NO_OTHERS), (0.5 * differences, {"m": length})):
        largest = largest_of_kind(headers, half_range, length, others)
        is_doubtful &= sizes <= _VANISHING_TO_OTHERS_RATIO * largest
    return np.asarray(is_doubtful)


def mark_resting_columns(
    headers: Sequence[str],
    rows: Array,
    half_range: Array,
    length: float,
    rate: float = 0.0,
    others: Mapping[str, float] = NO_OTHERS,
) -> Array:
    """Return the mask of the columns whose half range is at the level of rounding errors.

    Parameters
    ----------
    headers
        Headers of the columns.
    rows
        Values of the columns (k, columns).
    half_range
        Half the range of each column, (columns,).
    length
        Length of the mechanism [m].
    rate
        Angular frequency [rad/s] of vibrations, whose velocities and accelerations are at rest if
        the positions are; 0 if unknown.
    others
        See `largest_of_kind`.
    """
    rates = {"": 1.0, "/s": rate, "/s^2": rate**2}
    units = (("m", length), ("rad", 1.0))
    sizes = {unit + per: size * x for unit, size in units for per, x in rates.items()}
    size = np.array([sizes.get(Header.of(header).unit, 0.0) for header in headers])
    limits = (
        # Columns without a size of their own, such as the rate of a filter.
        np.full(len(headers), _UNDERFLOW),
        _REST_TO_OTHERS_RATIO * largest_of_kind(headers, half_range, others=others),
        _REST_TO_VALUES_RATIO * np.max(np.abs(rows), axis=0),
        _REST_TO_SIZE_RATIO * size,
    )
    return np.asarray(half_range <= np.maximum.reduce(limits))


def constant_limits(headers: Sequence[str], values: Array, length: float, rtol: float) -> Array:
    """Return the half ranges of columns up to which they are constant but for errors.

    Parameters
    ----------
    headers
        Headers of the columns.
    values
        Values of the columns (k, columns).
    length
        Length of the mechanism [m].
    rtol
        Tolerance of the run; 0 for fixed steps.
    """
    by_value = min(_ERROR_TO_VALUE_RATIO * rtol, MAX_ERROR_TO_VALUE_RATIO)
    # Values of positions and angles depend on the origin.
    are_positions = [is_position(x) for x in headers]
    of_positions = _limits_of_positions(headers, length, rtol)
    return np.where(are_positions, of_positions, by_value * np.max(np.abs(values), axis=0))


def _limits_of_positions(headers: Sequence[str], length: float, rtol: float) -> Array:
    sizes = {"m": _ERROR_TO_SIZE_RATIO * rtol * length, "rad": _ERROR_TO_SIZE_RATIO * rtol}
    return np.array([sizes.get(Header.of(x).unit, 0.0) for x in headers])


def rounding_limits(
    equations: EquationsOfMotion, headers: Sequence[str], step: float = np.inf
) -> Array:
    """Return the half ranges of columns (columns,) up to which they may be rounding errors.

    In free fall, all strains, stresses and forces of a beam are rounding errors, and so are
    reactions at its joints and changes of accelerations. The limits are a strain of 1e-11, the
    stresses, forces and moments that it causes in the stiffest beam, the acceleration of the
    mechanism by this force or 1e-9 of gravity, velocities of 1e-12 of the length of the mechanism,
    or 1e-12 rad, in a mean `step` [s] of the run, and the power of this force at this velocity.
    Those of other units are the rounding errors of first-order states, or zero.
    """
    mechanism, beams = equations.mechanism, beams_of(equations.mechanism)
    parts = [] if mechanism is None else mechanism.parts.values()
    acceleration = _ROUNDING_OF_GRAVITY * float(np.linalg.norm(getattr(mechanism, "gravity", 0.0)))
    velocity = _ROUNDING_OF_POSITIONS / step
    limits = {"m/s": velocity * equations.length, "rad/s": velocity}
    sections = [beam.section.at(0.5 * beam.length) for beam in beams]
    if sections:
        limits["-"] = _ROUNDING_STRAIN
        limits["Pa"] = _ROUNDING_STRAIN * max(x.material.E for x in sections)
        limits["N"] = _ROUNDING_STRAIN * max(x.EA for x in sections)
        limits["N m"] = _ROUNDING_STRAIN * max(np.sqrt(x.EA * x.EI) for x in sections)
        limits["W"] = limits["N"] * limits["m/s"]
        mass = sum(beam.length * x.rhoA for beam, x in zip(beams, sections, strict=True))
        mass += sum(x.mass for x in parts if isinstance(x, (PointMass, RigidBody)))
        acceleration = max(acceleration, limits["N"] / mass)
    limits |= {"m/s^2": acceleration, "rad/s^2": acceleration / equations.length}
    for k in equations.states:
        rounding = float(np.finfo(float).eps * equations.position_scales[k])
        limits.setdefault(equations.coordinates[k].unit, rounding)
    return np.array([limits.get(Header.of(x).unit, 0.0) for x in headers])
