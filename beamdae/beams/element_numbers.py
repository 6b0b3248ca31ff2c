"""The numbers of elements: of their points, of the section there, and of the free shape."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
from typing import Any

import numpy as np

from beamdae.beams.element_data import ELASTICITY, INERTIA, SECTION, Layout
from beamdae.beams.mesh import Mesh
from beamdae.beams.sections import Section
from beamdae.beams.varying_section import VaryingSection
from beamdae.curves.plane_curves import PlaneCurve, require_curve
from beamdae.errors import BeamdaeError

Array = np.ndarray

# Strain of the drawing up to which it counts as a small one.
_MOST_STRETCHED = 0.01


def is_damped(section: Section | VaryingSection, mesh: Mesh, points: int) -> bool:
    """Whether there is Kelvin-Voigt damping at any of so many points an element."""
    if isinstance(section, Section):
        return section.damping > 0.0
    return any(section.at(s).damping > 0.0 for s in mesh.gauss_arc_lengths(points))


def of_section(section: Section | VaryingSection) -> list[float]:
    """What all points of an element share: nothing where the section varies."""
    return list(attrgetter(*SECTION)(section)) if isinstance(section, Section) else []


def of_points(
    mesh: Mesh,
    layout: Layout,
    section: Section | VaryingSection,
    mass: Sequence[Array],
    stiffness: Sequence[Array],
) -> Array:
    """What the elements' numbers are of their points, a column an element.

    `mass` and `stiffness` are what the formulation has of its points, one element after the other.
    """
    s = mesh.gauss_arc_lengths(layout.mass_points)
    mass = [*mass, *_columns(section, s, INERTIA)]
    s = mesh.gauss_arc_lengths(layout.stiffness_points)
    stiffness = [*stiffness, *_columns(section, s, ELASTICITY)]
    points = [np.stack(x, axis=-1).reshape(mesh.elements, -1).T for x in (mass, stiffness)]
    return np.concatenate(points)


def of_elements(points: Array, section: Section | VaryingSection, gravity: Array) -> Array:
    """All numbers of the elements: of their points, of the section, and gravity."""
    values = np.array([*of_section(section), *gravity])
    return np.concatenate([points, np.repeat(values[:, None], points.shape[1], axis=1)])


def _columns(section: Section | VaryingSection, s: Array, names: tuple[str, ...]) -> list[Array]:
    if isinstance(section, Section):
        return []
    return list(np.array([attrgetter(*names)(section.at(x)) for x in s.tolist()]).T)


def free_strains(curve: PlaneCurve, free: PlaneCurve | None, s: Array) -> list[Array]:
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
    if not abs(curve.length - free.length) <= _MOST_STRETCHED * free.length:
        raise BeamdaeError(
            f"{part}: free_curve must be as long as the curve of {curve.length:.6g} m to within "
            f"{_MOST_STRETCHED:.0%}, it is {free.length:.6g} m long."
        )
