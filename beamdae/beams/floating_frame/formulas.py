"""Kinds of formulas of beams: how sections in a floating frame move, and what is observed of them.

The numbers of a formula are taken one by one: see `symbolic.formulas`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca

from beamdae.beams.element_data import Layout
from beamdae.beams.floating_frame.element import FRAME, NODE, AxisMotion, rotation
from beamdae.parts.attachments import rotate
from beamdae.symbolic.statements import SX, Local


def listed(numbers: Any, first: int, count: int) -> Any:
    """So many of the numbers as a column."""
    return ca.vertcat(*(numbers[first + k] for k in range(count)))


@dataclass(frozen=True)
class SectionMotion:
    """Position and turn of a section between so many nodes.

    Numbers: undeformed place in the frame, cosine and sine of the angle of the axis there, angle of
    the frame in the drawing, shape functions.
    """

    nodes: int

    def __call__(self, q: SX, numbers: Any) -> tuple[SX, SX]:
        """From local coordinates."""
        axis, row = AxisMotion(q), listed(numbers, 5, self.nodes)
        to_frame = rotation(numbers[2], numbers[3])
        turn = q[2] - numbers[4] + axis.rotation(row)
        return axis.position(row, listed(numbers, 0, 2), to_frame), turn


def frame_motion(q: SX, angle: Any) -> tuple[SX, SX]:
    """Position and turn of the frame; its number is its angle in the drawing."""
    return q[:2], q[2] - angle[0]


class _Strained(Protocol):
    """An element type that tells strains; see `Strains`."""

    @property
    def layout(self) -> Layout: ...

    def strain_points(self, points: SX, q: SX) -> list[tuple[SX, SX]]: ...


@dataclass(frozen=True)
class Strains:
    """Strains interpolated between the stiffness points of an element.

    Numbers: the share of each point, and one after the other what the formulation has of all points
    besides their weights.
    """

    element: _Strained

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


@dataclass(frozen=True)
class Deformation:
    """(u, v, phi) of a section in some axes; numbers: angle of its axis, shape functions."""

    nodes: int
    axes: str

    def __call__(self, local: Local, numbers: Any) -> SX:
        """From local coordinates."""
        row = listed(numbers, 1, self.nodes)
        nodal = ca.reshape(local.q[FRAME:], NODE, self.nodes) @ row
        angle = numbers[0]
        turn = {"inertial": local.q[2] + angle, "frame": angle, "local": 0.0}[self.axes]
        return ca.vertcat(rotate(turn, nodal), nodal[2])


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


def as_it_is(local: Local, values: Callable[[Local], SX]) -> SX:
    """What the values are."""
    return values(local)
