"""Numerical data of beam elements: quadrature points, section properties and gravity.

Element kernels contain no numbers. Each element passes one column of `data`: the values at its
inertia points, the values at its stiffness points, and gravity. The values of a point are those of
the formulation, then those of the section.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import casadi as ca
import numpy as np

from beamdae.beams.mesh import Mesh
from beamdae.beams.sections import Section, VaryingSection
from beamdae.curves.plane_curves import PlaneCurve, require_curve
from beamdae.errors import BeamdaeError
from beamdae.symbolic.statements import SX

Array = np.ndarray

# Properties of the section, appended to the values of each inertia point and stiffness point: mass
# and rotary inertia per length, stiffnesses, and the Kelvin-Voigt retardation time.
INERTIA_VALUES = ("rhoA", "rhoI")
STIFFNESS_VALUES = ("EA", "GA", "EI", "damping")
_GRAVITY_SIZE = 2

# Axial strain, relative to the length of the free curve; the strain measures assume small strains.
_MAX_INITIAL_STRAIN = 0.01


@dataclass(frozen=True)
class ElementDataLayout:
    """Order and number of the values in the data of one element.

    Attributes
    ----------
    mass_points, stiffness_points
        Numbers of inertia points and of stiffness points.
    mass_point, stiffness_point
        Names of the values that the formulation requires at each point; the first is "weight".
    """

    mass_points: int
    stiffness_points: int
    mass_point: tuple[str, ...]
    stiffness_point: tuple[str, ...]

    @property
    def mass_size(self) -> int:
        """Number of values of all inertia points."""
        return self.mass_points * len(self.mass_point + INERTIA_VALUES)

    @property
    def size(self) -> int:
        """Number of values of one element, including gravity."""
        stiffness_point = len(self.stiffness_point + STIFFNESS_VALUES)
        return self.mass_size + self.stiffness_points * stiffness_point + _GRAVITY_SIZE

    @property
    def stiffness_rows(self) -> slice:
        """Rows of the values of all stiffness points in the data of an element."""
        return slice(self.mass_size, self.size - _GRAVITY_SIZE)

    def stiffness_values(self, data: Array) -> Array:
        """Return the values of the stiffness points of all elements, (elements, points, values)."""
        return data[self.stiffness_rows].T.reshape(data.shape[1], self.stiffness_points, -1)

    def split_mass(self, data: SX) -> list[SX]:
        """Return the values of each inertia point, each followed by gravity (2,) [m/s^2]."""
        points = ca.reshape(data[: self.mass_size], -1, self.mass_points)
        gravity = data[self.size - _GRAVITY_SIZE : self.size]
        return [ca.vertcat(x, gravity) for x in ca.horzsplit(points)]

    def split_stiffness(self, data: SX) -> list[SX]:
        """Return the values of each stiffness point."""
        values = data[self.stiffness_rows]
        return ca.horzsplit(ca.reshape(values, -1, self.stiffness_points))


def is_damped(section: Section | VaryingSection, mesh: Mesh, points: int) -> bool:
    """Return True if the section has Kelvin-Voigt damping at any Gauss point.

    `points` is the number of Gauss points per element.
    """
    if isinstance(section, Section):
        return section.damping > 0.0
    return any(section.at(s).damping > 0.0 for s in mesh.gauss_arc_lengths(points))


def assemble_point_data(
    mesh: Mesh,
    layout: ElementDataLayout,
    section: Section | VaryingSection,
    mass: Sequence[Array],
    stiffness: Sequence[Array],
) -> Array:
    """Return the values of all quadrature points, one column per element.

    `mass` and `stiffness` contain one array for each name in `layout.mass_point` and
    `layout.stiffness_point`, with the values at the points of all elements in order.
    """
    columns = []
    for values, points, names in (
        (mass, layout.mass_points, INERTIA_VALUES),
        (stiffness, layout.stiffness_points, STIFFNESS_VALUES),
    ):
        sections = [section.at(s) for s in mesh.gauss_arc_lengths(points).tolist()]
        of_section = np.array([attrgetter(*names)(x) for x in sections]).T
        columns.append(np.stack([*values, *of_section], axis=-1).reshape(mesh.elements, -1).T)
    return np.concatenate(columns)


def compute_prestrains(curve: PlaneCurve, free: PlaneCurve | None, s: Array) -> list[Array]:
    """Return axial strain [-] and kappa11 [1/m] of the reference configuration at `s` [m].

    Strains are relative to the stress-free shape `free`; the list is empty if `free` is None.
    Cross-sections are normal to the axis in both shapes.
    """
    if free is None:
        return []
    ratio = free.length / curve.length
    return [
        np.full(len(s), 1.0 / ratio - 1.0),
        ratio * free.curvature(ratio * s) - curve.curvature(s),
    ]


def require_free_curve(part: str, free: Any, curve: PlaneCurve) -> None:
    """Raise BeamdaeError unless `free` is a curve that is as long as `curve`, within 1 %."""
    free = require_curve(f"{part}, free_curve", free)
    if not abs(curve.length - free.length) <= _MAX_INITIAL_STRAIN * free.length:
        raise BeamdaeError(
            f"{part}: the length of the curve, {curve.length:.6g} m, must differ by at most "
            f"{100.0 * _MAX_INITIAL_STRAIN:.0f} % from the length of free_curve, "
            f"{free.length:.6g} m; change free_curve."
        )
