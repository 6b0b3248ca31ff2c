"""Numerical data of beam elements: quadrature points, section properties and gravity.

Element kernels contain no numbers. Each element passes one column of `data`: the values at its
inertia points, the values at its stiffness points, the section properties that all points share
(constant sections only), and gravity.
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

# Properties of a constant section in `ElementData.section`, and the slice of each group.
SECTION_VALUES = ("EA", "GA", "EI", "rhoA", "rhoI", "damping")
_STIFFNESSES = slice(SECTION_VALUES.index("EA"), SECTION_VALUES.index("EI") + 1)
_INERTIAS = slice(SECTION_VALUES.index("rhoA"), SECTION_VALUES.index("rhoI") + 1)
_DAMPING = SECTION_VALUES.index("damping")
# Properties of a varying section, appended to the values of each inertia and stiffness point.
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
    varying
        True if the section varies, so that section properties are stored at each point.
    """

    mass_points: int
    stiffness_points: int
    mass_point: tuple[str, ...]
    stiffness_point: tuple[str, ...]
    varying: bool

    @property
    def mass_point_size(self) -> int:
        """Number of values of one inertia point."""
        return len(self.mass_point) + len(INERTIA_VALUES) * self.varying

    @property
    def stiffness_point_size(self) -> int:
        """Number of values of one stiffness point."""
        return len(self.stiffness_point) + len(STIFFNESS_VALUES) * self.varying

    @property
    def size(self) -> int:
        """Number of values of one element, including gravity."""
        section = 0 if self.varying else len(SECTION_VALUES)
        return self._mass_size + self._stiffness_size + section + _GRAVITY_SIZE

    @property
    def _mass_size(self) -> int:
        return self.mass_points * self.mass_point_size

    @property
    def _stiffness_size(self) -> int:
        return self.stiffness_points * self.stiffness_point_size

    def stiffness_values(self, data: Array) -> Array:
        """Return the values of the stiffness points of all elements, (elements, points, values)."""
        values = data[self._mass_size : self._mass_size + self._stiffness_size].T
        return values.reshape(-1, self.stiffness_points, self.stiffness_point_size)

    def split(self, data: SX) -> ElementData:
        """Split the data vector of a kernel into its parts; values after `size` are ignored."""
        mass, points = self._mass_size, self._mass_size + self._stiffness_size
        return ElementData(
            self.varying,
            ca.reshape(data[:mass], self.mass_point_size, self.mass_points),
            ca.reshape(data[mass:points], self.stiffness_point_size, self.stiffness_points),
            data[points : self.size - _GRAVITY_SIZE],
            data[self.size - _GRAVITY_SIZE : self.size],
        )


@dataclass(frozen=True, eq=False)
class ElementData:
    """Symbolic data of one element.

    Attributes
    ----------
    varying
        True if the section properties are stored at each point.
    mass, stiffness
        Values of the inertia points and of the stiffness points, one column per point.
    section
        Properties of a constant section, in the order of `SECTION_VALUES`; empty if `varying`.
    gravity
        Acceleration of gravity (2,) [m/s^2].
    """

    varying: bool
    mass: Any
    stiffness: Any
    section: Any
    gravity: Any

    def inertia(self, k: int) -> SX:
        """Return (rhoA [kg/m], rhoI [kg m]) at inertia point `k`."""
        return self.mass[-2:, k] if self.varying else self.section[_INERTIAS]

    def elasticity(self, k: int) -> SX:
        """Return (EA [N], GA [N], EI [N m^2]) at stiffness point `k`."""
        return self.stiffness[-4:-1, k] if self.varying else self.section[_STIFFNESSES]

    def damping(self, k: int) -> SX:
        """Return the Kelvin-Voigt retardation time [s] at stiffness point `k`."""
        return self.stiffness[-1, k] if self.varying else self.section[_DAMPING]


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
    s = mesh.gauss_arc_lengths(layout.mass_points)
    mass = [*mass, *_sample_varying_section(section, s, INERTIA_VALUES)]
    s = mesh.gauss_arc_lengths(layout.stiffness_points)
    stiffness = [*stiffness, *_sample_varying_section(section, s, STIFFNESS_VALUES)]
    points = [np.stack(x, axis=-1).reshape(mesh.elements, -1).T for x in (mass, stiffness)]
    return np.concatenate(points)


def assemble_element_data(
    points: Array, section: Section | VaryingSection, gravity: Array
) -> Array:
    """Return the data of all elements, one column per element.

    A column contains the values `points` of `assemble_point_data`, the properties of the section
    if it is constant, and `gravity` (2,) [m/s^2].
    """
    constant = attrgetter(*SECTION_VALUES)(section) if isinstance(section, Section) else ()
    values = np.array([*constant, *gravity])
    return np.concatenate([points, np.repeat(values[:, None], points.shape[1], axis=1)])


def _sample_varying_section(
    section: Section | VaryingSection, s: Array, names: tuple[str, ...]
) -> list[Array]:
    """Return one array for each property in `names`, or an empty list for a constant section."""
    if isinstance(section, Section):
        return []
    return list(np.array([attrgetter(*names)(section.at(x)) for x in s.tolist()]).T)


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
