"""Ranges of columns up to which forces, strains and motions are rounding errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.sections import Section
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.parts.bodies.point_mass import PointMass
from beamdae.parts.bodies.rigid_body import RigidBody
from beamdae.results.columns import (
    UNITS_OF_POSITIONS,
    ColumnDict,
    Header,
    largest_by,
    mark_vanishing_columns,
)
from beamdae.results.missed_peaks import StepExtremes
from beamdae.results.trajectory import Trajectory

# Strains of geometrically exact beams that fall freely 4 m above the origin, with elements of
# 15 mm, are up to 1e-12; those of beams in floating frames are smaller.
_ROUNDING_STRAIN = 1e-11
# Accelerations in free fall vary by up to 1e-10 of gravity, divided by the length of the mechanism
# for angles.
_ROUNDING_OF_GRAVITY = 1e-9
# Positions of bodies at rest change by less in a step, relative to the length of the mechanism or
# to 1 rad.
_ROUNDING_OF_POSITIONS = 1e-12


def rounding_limits(
    equations: EquationsOfMotion, headers: Sequence[str], step: float = np.inf
) -> np.ndarray:
    """Return the half ranges of columns (columns,) up to which they may be rounding errors.

    In free fall, all strains, stresses and forces of a beam are rounding errors, and so are
    reactions at its joints and changes of accelerations. The limits are a strain of 1e-11, the
    stresses, forces and moments that it causes in the stiffest beam, the acceleration of the
    mechanism by this force or 1e-9 of gravity, and velocities of 1e-12 of the length of the
    mechanism, or 1e-12 rad, in a mean `step` [s] of the run. They are zero for columns in other
    units.
    """
    mechanism = equations.mechanism
    sections = [_middle_section(beam) for beam in beams_of(mechanism)]
    gravity = 0.0 if mechanism is None else float(np.linalg.norm(mechanism.gravity))
    acceleration = _ROUNDING_OF_GRAVITY * gravity
    velocity = _ROUNDING_OF_POSITIONS / step
    limits = {"m/s": velocity * equations.length, "rad/s": velocity}
    if sections:
        limits["-"] = _ROUNDING_STRAIN
        limits["Pa"] = _ROUNDING_STRAIN * max(x.material.E for x in sections)
        limits["N"] = _ROUNDING_STRAIN * max(x.EA for x in sections)
        limits["N m"] = _ROUNDING_STRAIN * max(np.sqrt(x.EA * x.EI) for x in sections)
        mass = _total_mass(equations)
        acceleration = max(acceleration, limits["N"] / mass)
    limits |= {"m/s^2": acceleration, "rad/s^2": acceleration / equations.length}
    return np.array([limits.get(Header.of(x).unit, 0.0) for x in headers])


def _middle_section(beam: Beam) -> Section:
    section: Section = beam.section.at(0.5 * beam.length)
    return section


def _total_mass(equations: EquationsOfMotion) -> float:
    mechanism = equations.mechanism
    beams = [x.length * _middle_section(x).rhoA for x in beams_of(mechanism)]
    parts = [] if mechanism is None else mechanism.parts.values()
    return sum(beams) + sum(x.mass for x in parts if isinstance(x, (PointMass, RigidBody)))


def without_rounding_errors(
    equations: EquationsOfMotion,
    extremes: Mapping[str, StepExtremes],
    step: float,
    mechanism: Mapping[str, float],
) -> ColumnDict:
    """Return the extremes of the columns whose range exceeds the `rounding_limits`.

    Rates and reactions that vanish beside those of the `mechanism`, see `measure_mechanism`, are
    omitted, too.
    """
    headers, values = list(extremes), list(extremes.values())
    half_ranges = np.array([x.half_range for x in values])
    sizes = np.array([max(abs(x.min), abs(x.max)) for x in values])
    is_compared = np.array([Header.of(x).unit in mechanism for x in headers], bool)
    is_noise = half_ranges <= rounding_limits(equations, headers, step)
    vanishes = mark_vanishing_columns(headers, sizes, equations.length, others=mechanism)
    is_noise |= is_compared & vanishes
    items = zip(extremes.items(), is_noise.tolist(), strict=True)
    return ColumnDict({header: x for (header, x), noise in items if not noise})


def measure_mechanism(equations: EquationsOfMotion, trajectory: Trajectory) -> dict[str, float]:
    """Return the sizes of the rates and the reactions of a mechanism in a run, by unit.

    They are the largest half ranges of the velocities and accelerations of the coordinates, and the
    largest magnitudes of the multipliers. A fixed point moves by errors only, and so do reactions
    that vanish by symmetry, even if no other motion or force is observed.
    """
    rows = [interval.rows for interval in trajectory.intervals]
    units = [x.unit for x in equations.coordinates]
    sizes = largest_by(
        (x.unit for x in equations.multipliers), _largest_magnitudes([x.lam for x in rows])
    )
    for per, motions in (("/s", [x.v for x in rows]), ("/s^2", [x.a for x in rows])):
        rates = largest_by(units, _largest_half_ranges(motions))
        sizes |= {f"{unit}{per}": rates[unit] for unit in UNITS_OF_POSITIONS if unit in rates}
    return sizes


def _largest_magnitudes(blocks: Sequence[np.ndarray]) -> list[float]:
    largest = np.max([np.max(np.abs(x), axis=0) for x in blocks], axis=0)
    return list(map(float, largest))


def _largest_half_ranges(blocks: Sequence[np.ndarray]) -> list[float]:
    high = np.max([np.max(x, axis=0) for x in blocks], axis=0)
    low = np.min([np.min(x, axis=0) for x in blocks], axis=0)
    return list(map(float, 0.5 * (high - low)))
