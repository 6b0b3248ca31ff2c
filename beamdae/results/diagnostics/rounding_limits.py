"""Ranges of columns up to which forces, strains and motions are rounding errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.sections import Section
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.parts.bodies.point_mass import PointMass
from beamdae.parts.bodies.rigid_body import RigidBody
from beamdae.results.columns import ColumnDict, Header
from beamdae.results.diagnostics.resolution.missed_peaks import StepExtremes

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
    equations: EquationsOfMotion, extremes: Mapping[str, StepExtremes], step: float
) -> ColumnDict:
    """Return the extremes of the columns whose range exceeds the `rounding_limits`."""
    limits = rounding_limits(equations, list(extremes), step).tolist()
    return ColumnDict(
        {
            header: x
            for (header, x), limit in zip(extremes.items(), limits, strict=True)
            if not x.half_range <= limit
        }
    )
