"""Virtual work of elasticity and material damping of one element, whatever its strains are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca

from beamdae.beams.element_data import ElementData, ElementDataLayout
from beamdae.symbolic.statements import SX, Local


def elastic_work(
    points: Sequence[tuple[SX, SX]], data: ElementData, damped: bool, q: Any, v: Any
) -> tuple[SX, SX, SX]:
    """Generalized forces of D (eps + damping eps'), strain energy and dissipated power.

    Eq. (21) of Pan & Liu (2012), D = diag(EA, GA, EI).

    Parameters
    ----------
    points
        Weight and (axial strain, shear strain, kappa11) of each stiffness point, from `q`.
    data
        Stiffnesses and retardation times of the points.
    damped
        Whether there is material damping.
    q, v
        Coordinates the strains depend on, and their rates.
    """
    force, stored, dissipated = SX.zeros(q.shape[0]), SX(0), SX(0)
    for k, (weight, strain) in enumerate(points):
        stiffness = data.elasticity(k)
        section_forces = stiffness * strain
        stored += 0.5 * weight * ca.dot(section_forces, strain)
        if damped:
            strain_rate = ca.jtimes(strain, q, v)
            viscous = data.damping(k) * stiffness * strain_rate
            section_forces += viscous
            dissipated += weight * ca.dot(viscous, strain_rate)
        force += weight * ca.jtimes(strain, q, section_forces, True)
    return force, stored, dissipated


def slice_column(numbers: Any, first: int, count: int) -> Any:
    """So many of the numbers as a column."""
    return ca.vertcat(*(numbers[first + k] for k in range(count)))


class _StrainElement(Protocol):
    """An element type that tells strains; see `InterpolatedStrains`."""

    @property
    def layout(self) -> ElementDataLayout: ...

    def strain_points(self, points: SX, q: SX) -> list[tuple[SX, SX]]: ...


@dataclass(frozen=True)
class InterpolatedStrains:
    """Strains interpolated between the stiffness points of an element.

    Numbers: the share of each point, and one after the other what the formulation has of all points
    besides their weights.
    """

    element: _StrainElement

    def __call__(self, local: Local, numbers: Any) -> SX:
        """From local coordinates."""
        layout = self.element.layout
        count, rows = layout.stiffness_points, range(1, len(layout.stiffness_point))
        points = [ca.vertcat(0, *(numbers[i * count + k] for i in rows)) for k in range(count)]
        found = self.element.strain_points(SX(ca.horzcat(*points)), local.q)
        total = SX.zeros(3)
        for k, (_, strain) in enumerate(found):
            total += numbers[k] * strain
        return total


def fiber_strain(local: Local, strains: Callable[[Local], SX], offset: Callable[[], Any]) -> SX:
    """Longitudinal strain off the axis (eq. 5)."""
    strain = strains(local)
    return strain[0] + offset()[0] * strain[2]


def fiber_stress(local: Local, strains: Callable[[Local], SX], own: Callable[[], Any]) -> SX:
    """Longitudinal stress off the axis of (offset, E, damping)."""
    offset, modulus, damping = (own()[k] for k in range(3))
    strain = fiber_strain(local, strains, lambda: (offset,))
    return modulus * (strain + damping * local.dot(strain))


def section_forces(local: Local, strains: Callable[[Local], SX], own: Callable[[], Any]) -> SX:
    """Section forces on the axis (eqs. 5-7) of (EA, GA, EI, damping)."""
    strain, section = strains(local), own()
    viscous = section[3] * local.dot(strain)
    return ca.vertcat(*(section[k] * (strain[k] + viscous[k]) for k in range(3)))


def identity(local: Local, values: Callable[[Local], SX]) -> SX:
    """What the values are."""
    return values(local)
