"""The numbers of one element, and where they stand among its data."""

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

SECTION_VALUES = ("EA", "GA", "EI", "rhoA", "rhoI", "damping")
# Behind those of the points, where the section varies.
INERTIA_VALUES, STIFFNESS_VALUES = ("rhoA", "rhoI"), ("EA", "GA", "EI", "damping")


@dataclass(frozen=True)
class ElementDataLayout:
    """How many numbers an element has, of what.

    Attributes
    ----------
    mass_points, stiffness_points
        How many there are of each.
    mass_point, stiffness_point
        What the formulation has of each, the weight first.
    varying
        Whether each point has section values of its own behind these.
    """

    mass_points: int
    stiffness_points: int
    mass_point: tuple[str, ...]
    stiffness_point: tuple[str, ...]
    varying: bool

    @property
    def per_mass_point(self) -> int:
        """Numbers of an inertia point."""
        return len(self.mass_point) + len(INERTIA_VALUES) * self.varying

    @property
    def per_stiffness_point(self) -> int:
        """Numbers of a stiffness point."""
        return len(self.stiffness_point) + len(STIFFNESS_VALUES) * self.varying

    @property
    def of_points(self) -> tuple[int, int]:
        """Numbers of all inertia points, and of all stiffness points."""
        mass = self.mass_points * self.per_mass_point
        return mass, self.stiffness_points * self.per_stiffness_point

    @property
    def size(self) -> int:
        """Numbers of an element, gravity included."""
        return sum(self.of_points) + (0 if self.varying else len(SECTION_VALUES)) + 2

    def split(self, data: SX) -> ElementData:
        """The data of a kernel as what they are; `data` may hold more behind them."""
        mass, stiffness = self.of_points
        return ElementData(
            self.varying,
            ca.reshape(data[:mass], self.per_mass_point, self.mass_points),
            ca.reshape(
                data[mass : mass + stiffness], self.per_stiffness_point, self.stiffness_points
            ),
            data[mass + stiffness : self.size - 2],
            data[self.size - 2 : self.size],
        )


@dataclass(frozen=True, eq=False)
class ElementData:
    """The numbers of one element: a column a point, values of the section, gravity."""

    varying: bool
    mass: Any
    stiffness: Any
    section: Any
    gravity: Any

    def inertia(self, k: int) -> SX:
        """(rhoA, rhoI) at an inertia point."""
        return self.mass[-2:, k] if self.varying else self.section[3:5]

    def elasticity(self, k: int) -> SX:
        """(EA, GA, EI) at a stiffness point."""
        return self.stiffness[-4:-1, k] if self.varying else self.section[:3]

    def damping(self, k: int) -> SX:
        """Retardation time at a stiffness point."""
        return self.stiffness[-1, k] if self.varying else self.section[5]


Array = np.ndarray

# Strain of the drawing up to which it counts as a small one.
_MAX_INITIAL_STRAIN = 0.01


def is_damped(section: Section | VaryingSection, mesh: Mesh, points: int) -> bool:
    """Whether there is Kelvin-Voigt damping at any of so many points an element."""
    if isinstance(section, Section):
        return section.damping > 0.0
    return any(section.at(s).damping > 0.0 for s in mesh.gauss_arc_lengths(points))


def section_values(section: Section | VaryingSection) -> list[float]:
    """What all points of an element share: nothing where the section varies."""
    return list(attrgetter(*SECTION_VALUES)(section)) if isinstance(section, Section) else []


def assemble_point_data(
    mesh: Mesh,
    layout: ElementDataLayout,
    section: Section | VaryingSection,
    mass: Sequence[Array],
    stiffness: Sequence[Array],
) -> Array:
    """What the elements' numbers are of their points, a column an element.

    `mass` and `stiffness` are what the formulation has of its points, one element after the other.
    """
    s = mesh.gauss_arc_lengths(layout.mass_points)
    mass = [*mass, *_varying_columns(section, s, INERTIA_VALUES)]
    s = mesh.gauss_arc_lengths(layout.stiffness_points)
    stiffness = [*stiffness, *_varying_columns(section, s, STIFFNESS_VALUES)]
    points = [np.stack(x, axis=-1).reshape(mesh.elements, -1).T for x in (mass, stiffness)]
    return np.concatenate(points)


def assemble_element_data(
    points: Array, section: Section | VaryingSection, gravity: Array
) -> Array:
    """All numbers of the elements: of their points, of the section, and gravity."""
    values = np.array([*section_values(section), *gravity])
    return np.concatenate([points, np.repeat(values[:, None], points.shape[1], axis=1)])


def _varying_columns(
    section: Section | VaryingSection, s: Array, names: tuple[str, ...]
) -> list[Array]:
    if isinstance(section, Section):
        return []
    return list(np.array([attrgetter(*names)(section.at(x)) for x in s.tolist()]).T)


def compute_prestrains(curve: PlaneCurve, free: PlaneCurve | None, s: Array) -> list[Array]:
    """Axial strain and kappa11 of a drawing at arc lengths s [m], of a beam that has a free shape.

    Sections stand normal to the axis in the drawing and in the free shape.
    """
    if free is None:
        return []
    ratio = free.length / curve.length
    return [
        np.full(len(s), 1.0 / ratio - 1.0),
        ratio * free.curvature(ratio * s) - curve.curvature(s),
    ]


def require_free_curve(part: str, free: Any, curve: PlaneCurve) -> None:
    """Refuse as free shape what is no curve, or one of another length."""
    free = require_curve(f"{part}, free_curve", free)
    if not abs(curve.length - free.length) <= _MAX_INITIAL_STRAIN * free.length:
        raise BeamdaeError(
            f"{part}: free_curve must be as long as the curve of {curve.length:.6g} m to within "
            f"{_MAX_INITIAL_STRAIN:.0%}, it is {free.length:.6g} m long."
        )
