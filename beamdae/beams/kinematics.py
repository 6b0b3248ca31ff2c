"""What a beam asks of its kinematics, and what damping asks of its elements.

A kinematics says how the points of a beam follow from its coordinates: in a floating frame
(`floating_frame`), or otherwise. Beams, damping, loads, observables and drawings know this
interface alone.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.beams.mesh import Mesh
from beamdae.errors import BeamdaeError, format_exception, short_repr
from beamdae.symbolic.statements import SX, ForceKernel, Local, Named, RangeKernel

Array = np.ndarray


class InertiaPoint(NamedTuple):
    """A point at which inertia is integrated.

    Attributes
    ----------
    weight
        Length of axis it stands for [m].
    density
        (rhoA, rhoA, rhoI), of the rates below.
    velocity
        Of the axis, (2,) [m/s], in some orthogonal axes.
    angular_velocity
        Of the section [rad/s].
    rotation
        Of the section relative to those axes: its normal is (-sin, cos) in them [rad].
    """

    weight: SX
    density: SX
    velocity: SX
    angular_velocity: SX
    rotation: SX


class StrainRatePoint(NamedTuple):
    """A point at which elasticity is integrated.

    Attributes
    ----------
    weight
        Length of axis it stands for [m].
    stiffness
        (EA, GA, EI).
    rates
        Rates of axial strain, shear strain and curvature of the undeformed beam, linear in the
        velocities.
    """

    weight: SX
    stiffness: SX
    rates: SX


class Element(ABC):
    """One element type in symbols: all numbers are inputs (`local.data`), it is hashable."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of local coordinates."""

    @property
    @abstractmethod
    def n_data(self) -> int:
        """Numbers a copy of the element takes."""

    @abstractmethod
    def kernel(self) -> ForceKernel:
        """Virtual work of inertia, elasticity, material damping and weight; the same object always.

        Elements of several beams that share it are evaluated in one map.
        """

    @abstractmethod
    def inertia_points(self, local: Local) -> list[InertiaPoint]:
        """How the inertia points move; `local.data` may hold more behind the element's numbers."""

    @abstractmethod
    def strain_rate_points(self, local: Local) -> list[StrainRatePoint]:
        """Linear strain rates at the stiffness points; `local.data` as above."""


class MaterialPoint(NamedTuple):
    """A section of the beam.

    Attributes
    ----------
    drawn
        Its place (x, y) in the reference drawing [m].
    inclination
        Its angle there [rad].
    operator
        Rows that pick its local coordinates from those of the beam.
    motion
        Local coordinates -> (position in the inertial frame, turn since the reference drawing), a
        `Formula` or any function.
    """

    drawn: tuple[float, float]
    inclination: float
    operator: sp.csr_array
    motion: Callable[[SX], tuple[SX, SX]]


class PointValues(NamedTuple):
    """Values at a section: rows that pick local coordinates, and the values from these.

    The values are a `Formula` or any function.
    """

    operator: sp.csr_array
    values: Callable[[Local], SX]


class StrainValidity(NamedTuple):
    """How far the strains of a kinematics reach; see `RangeStatement`."""

    kernel: RangeKernel
    data: Array
    error: tuple[float, float] | None = None
    remedies: tuple[str, ...] = ()


class Kinematics(ABC):
    """How the points of one beam follow from its coordinates.

    Made by the beam as `kinematics(name, mesh, section, **settings)`, `mesh` in the axes of the
    drawing; the section at arc length s is `section.at(s)`, whether it varies or not.
    """

    name: str
    mesh: Mesh

    @property
    @abstractmethod
    def element(self) -> Element:
        """The type of all elements."""

    @property
    @abstractmethod
    def coordinates(self) -> tuple[Named, ...]:
        """Name and unit of each coordinate of the beam."""

    @property
    @abstractmethod
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing."""

    @abstractmethod
    def initial_velocity(self, velocity: tuple[float, float], angular_velocity: float) -> Array:
        """Rates of a rigid motion: of the start point [m/s] and of the beam about it [rad/s]."""

    @property
    @abstractmethod
    def operator(self) -> sp.csr_array:
        """From the beam's coordinates to those of all elements, shape (elements * size, n)."""

    @abstractmethod
    def data(self, gravity: Array) -> Array:
        """Numbers of the elements under `gravity` (2,), shape (n_data, elements)."""

    @abstractmethod
    def material_point(self, s: float) -> MaterialPoint:
        """The section at arc length s [m]."""

    def axis_point(self, s: float) -> MaterialPoint:
        """The section at arc length s [m] on the axis of its element, which bears the inertia.

        Elements interpolate the curve, `material_point` lies on it.
        """
        return self.material_point(s)

    @abstractmethod
    def strains(self, s: float) -> PointValues:
        """Axial strain, shear strain and curvature at arc length s [m], shape (3,)."""

    @property
    def curvature_error(self) -> float:
        """Largest error of the elements' curvature, times the length of the beam."""
        return 0.0

    @property
    def strain_validity(self) -> StrainValidity | None:
        """How far its strains reach; its kernel takes the coordinates of an element.

        None where they hold however far the beam bends, and there is nothing to tell.
        """
        return None

    @property
    def floating_frame(self) -> MaterialPoint:
        """The floating frame, if there is one."""
        raise self._without_frame()

    def deformation(self, s: float, axes: str) -> PointValues:
        """(u, v, phi) at arc length s relative to the undeformed beam in its floating frame."""
        raise self._without_frame()

    def _without_frame(self) -> BeamdaeError:
        return BeamdaeError(
            f"{self.name}: {type(self).__name__} has no floating frame to see a deformation from; "
            "bd.relative_displacement sees it from another section."
        )


def create_custom_kinematics(
    name: str, make: Callable[[str, Mesh, Any], Kinematics], mesh: Mesh, section: Any
) -> Kinematics:
    """What a kinematics of the user's own makes of the beam."""
    wanted = f"{name}: kinematics must be a function of (name, mesh, section)"
    if not callable(make):
        raise BeamdaeError(f"{wanted}, got {short_repr(make)}.")
    try:
        made = make(name, mesh, section)
    except BeamdaeError:
        raise
    except Exception as problem:
        raise BeamdaeError(f"{wanted}, it failed, {format_exception(problem)}.") from problem
    if not isinstance(made, Kinematics):
        raise BeamdaeError(f"{wanted} that gives a Kinematics, got {short_repr(made)}.")
    return made
