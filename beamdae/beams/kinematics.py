"""Base classes of beam kinematics, and code shared by both formulations.

A subclass of `Kinematics` expresses the motion of the points of a beam by coordinates: in a
floating frame (`floating_frame`), in the inertial frame (`exact`), or otherwise. Beams, damping,
loads, observables and drawings use only this interface.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache, wraps
from typing import Any, NamedTuple, TypeVar, cast

import casadi as ca
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.beams.elements import NODE_SIZE, InterpolatedForces, PointElement, require_free_curve
from beamdae.beams.mesh import Mesh, consists_of_numbers, is_shareable
from beamdae.beams.sections import Section, VaryingSection
from beamdae.beams.shape_functions import (
    gauss_points,
    lagrange_weights,
    node_positions,
    shape_functions,
)
from beamdae.beams.strains import BENDING, slice_column
from beamdae.curves.plane_curves import ARC_LENGTH_TOLERANCE, PlaneCurve
from beamdae.errors import (
    BeamdaeError,
    choice_of,
    convert_fields,
    format_exception,
    set_fields,
    short_repr,
)
from beamdae.read_only import read_only, read_only_data
from beamdae.symbolic.formula import Formula
from beamdae.symbolic.sparse_operators import select_rows
from beamdae.symbolic.statements import (
    SX,
    Local,
    Variable,
)

Array = np.ndarray
T = TypeVar("T")

_MAX_NUMBERS = 1e6  # of the local coordinates at which strains are evaluated together
_MAX_CACHED_GEOMETRIES = 32  # of earlier beams
# Smaller absolute values of shape functions are rounding errors of zero.
_MIN_SHAPE_FUNCTION = 1e-12
# Distances between the ends of a curve, relative to the length of the curve.
_MIN_DEFAULT_CHORD = 0.1  # for smaller distances, "tangent" is the default frame
_MIN_CHORD = 1e-6  # for smaller distances, the direction of the chord is undefined


class MaterialPoint(NamedTuple):
    """Section or reference frame of a beam, and its motion.

    Attributes
    ----------
    reference_position
        Position (x, y) in the reference configuration [m].
    inclination
        Angle of the section or frame in the reference configuration [rad].
    operator
        Sparse matrix that maps the beam coordinates to the local coordinates.
    motion
        Function (a `Formula` or any callable) of the local coordinates that returns (position in
        the inertial frame [m], rotation from the reference configuration [rad]).
    """

    reference_position: tuple[float, float]
    inclination: float
    operator: sp.csr_array
    motion: Callable[[SX], tuple[SX, SX]]


class Placement(NamedTuple):
    """Section of a beam in the reference configuration, and its motion.

    Attributes
    ----------
    reference_position, inclination
        See `MaterialPoint`.
    motion
        Formula of the coordinates of the frame and of those interpolated at the section that
        returns (position in the inertial frame [m], rotation from the reference configuration
        [rad]).
    """

    reference_position: tuple[float, float]
    inclination: float
    motion: Formula


@dataclass(frozen=True)
class InterpolatedMotion:
    """Motion of a section between the nodes of an element.

    `numbers` are the shape functions, then those of the motion `kind` of a `Placement`.
    """

    kind: Callable[..., tuple[SX, SX]]
    frame_size: int
    nodes: int

    def __call__(self, q: SX, numbers: Any) -> tuple[SX, SX]:
        """Return position and rotation from local coordinates."""
        nodal = ca.reshape(q[self.frame_size :], NODE_SIZE, self.nodes)
        interpolated = nodal @ slice_column(numbers, 0, self.nodes)
        return self.kind(ca.vertcat(q[: self.frame_size], interpolated), numbers[self.nodes :])


class PointValues(NamedTuple):
    """Values at a section as a function of the local coordinates, such as strains.

    Attributes
    ----------
    operator
        Sparse matrix that maps the beam coordinates to the local coordinates.
    values
        Function (a `Formula` or any callable) of a `Local` that returns the values.
    """

    operator: sp.csr_array
    values: Callable[[Local], SX]


class Kinematics(ABC):
    """Mapping from the coordinates of a beam to the motion and strains of its points.

    A beam creates an instance by calling the class with (name, mesh, section); the built-in
    formulations accept further settings. The mesh is given in inertial axes. `section.at(s)`
    returns the `Section` at arc length s [m], for constant and varying sections.
    """

    name: str
    mesh: Mesh

    @property
    @abstractmethod
    def element(self) -> PointElement:
        """Element type, the same for all elements."""

    @property
    @abstractmethod
    def coordinates(self) -> tuple[Variable, ...]:
        """Name and unit of each coordinate of the beam."""

    @property
    def rigid_coordinate_count(self) -> int:
        """Number of leading coordinates that describe a rigid motion; 0 by default."""
        return 0

    @property
    def frame_follows_section(self) -> bool:
        """True if the beam has a floating frame that moves with a section; False by default."""
        return False

    @property
    @abstractmethod
    def initial_position(self) -> Array:
        """Coordinates [m, rad] in the reference configuration, shape (n,)."""

    @abstractmethod
    def initial_velocity(self, velocity: tuple[float, float], angular_velocity: float) -> Array:
        """Return the rates of the coordinates (n,) for a rigid motion.

        `velocity` [m/s] refers to the start point, `angular_velocity` [rad/s] to the whole beam.
        """

    @property
    @abstractmethod
    def operator(self) -> sp.csr_array:
        """Matrix that maps beam coordinates to element coordinates, (elements * size, n)."""

    def rows_of_element(self, element: int) -> sp.csr_array:
        """Return the rows of `operator` for one element."""
        size = self.element.size
        return select_rows(self.operator, np.arange(size) + element * size)

    def rigid_motions(self, q: SX) -> SX:
        """Return the rates of the coordinates q (n,) in rigid motions of the beam, (n, 3).

        The motions are the translations along x and y in the inertial frame, and the rotation about
        the start of the beam.

        Raises
        ------
        BeamdaeError
            If the formulation does not define rigid motions.
        """
        raise BeamdaeError(
            f"{self.name}: {type(self).__name__} defines no rigid_motions, so the resultant of a "
            "distributed load is unknown; observe its power."
        )

    @abstractmethod
    def data(self, gravity: Array) -> Array:
        """Return the data of the elements under `gravity` (2,), shape (n_data, elements)."""

    @abstractmethod
    def placement(self, s: float, on_axis: bool = False) -> Placement:
        """Return the section at arc length s [m], on the reference curve.

        If `on_axis`, it is on the axis of its element, which interpolates the curve: inertia is
        integrated along the interpolated axes.
        """

    def material_point(self, s: float) -> MaterialPoint:
        """Return the section at arc length s [m], on the reference curve."""
        return self._interpolate(s, self.placement(s), _MIN_SHAPE_FUNCTION)

    def element_point(self, s: float, on_axis: bool) -> MaterialPoint:
        """Return the section at arc length s [m] in all coordinates of its element."""
        return self._interpolate(s, self.placement(s, on_axis), -1.0)

    def _interpolate(self, s: float, placement: Placement, above: float) -> MaterialPoint:
        """Return a section in the coordinates of nodes with shape functions `above` a value."""
        element, xi = self.mesh.locate(s)
        row = shape_functions(self.mesh.nodes, np.array([xi]))[0]
        nodes, frame = np.flatnonzero(np.abs(row) > above), self.element.frame_size
        nodal = frame + NODE_SIZE * nodes[:, None] + np.arange(NODE_SIZE)
        rows = np.concatenate([np.arange(frame), nodal.ravel()]) + element * self.element.size
        position, inclination, motion = placement
        kind = InterpolatedMotion(motion.kind, frame, len(nodes))
        formula = Formula(kind, (*row[nodes].tolist(), *motion.numbers))
        return MaterialPoint(position, inclination, select_rows(self.operator, rows), formula)

    def section_forces(self, s: float) -> PointValues:
        """Return the function for the section forces at s [m], see `InterpolatedForces`.

        They are interpolated between the stiffness points, where the strains of an element are most
        accurate.
        """
        layout, (element, xi) = self.element.layout, self.mesh.locate(s)
        gauss, _ = gauss_points(layout.stiffness_points)
        values = self.data(np.zeros(2))[layout.stiffness_rows, element]
        numbers = (*lagrange_weights(gauss, xi), *values.tolist())
        formula = Formula(InterpolatedForces(self.element), numbers)
        return PointValues(self.rows_of_element(element), formula)

    def largest_strain(self, q: Array) -> float:
        """Return the largest axial strain of outer fibers [-] in the states q (k, n).

        Returns 0 (default) if the strains are not known.
        """
        return 0.0

    @property
    def floating_frame(self) -> MaterialPoint:
        """Floating frame of the beam.

        Raises
        ------
        BeamdaeError
            If the formulation has no floating frame.
        """
        raise self._missing_frame_error()

    def deformation(self, s: float, axes: str) -> PointValues:
        """Return the function for (u, v, phi) [m, m, rad] at s [m], relative to the frame.

        Displacement (u, v) and rotation phi are relative to the undeformed beam that moves with the
        frame. `axes` selects the axes of (u, v): "inertial", "frame" or "local" (tangent frame at
        s).

        Raises
        ------
        BeamdaeError
            If the formulation has no reference frame.
        """
        raise self._missing_frame_error()

    def _missing_frame_error(self) -> BeamdaeError:
        return BeamdaeError(
            f"{self.name}: {type(self).__name__} has no floating frame; observe "
            "bd.relative_displacement between two sections instead."
        )


class _Geometry:
    """Values derived from the mesh and the settings of a beam, but not from its section."""

    def __init__(self) -> None:
        self._values: dict[Any, Any] = {}

    def derive(self, key: Any, build: Callable[[], T]) -> T:
        """Return the value for a key, read-only; `build` creates it on first use."""
        if key not in self._values:
            self._values[key] = read_only(build())
        return cast("T", self._values[key])


@lru_cache(maxsize=_MAX_CACHED_GEOMETRIES)
def _share_geometry(*settings: Any) -> _Geometry:
    return _Geometry()


def geometric_property(build: Callable[[Any], T]) -> cached_property[T]:
    """Decorate a property that depends on the mesh and settings of a beam, not on its section.

    Beams that are equal except for name and section share the value.
    """

    @wraps(build)
    def derive(self: FormulationKinematics) -> T:
        return self._geometry.derive(build.__name__, lambda: build(self))

    return cached_property(derive)


def chord_vector(curve: PlaneCurve) -> Array:
    """Return the vector from the start to the end of a curve [m], shape (2,)."""
    ends = np.asarray(curve.point(np.array([0.0, curve.length])), float)
    return ends[1] - ends[0]


@read_only_data
@dataclass(frozen=True, eq=False)
class FormulationKinematics(Kinematics):
    """Settings, element data and material points of the built-in formulations.

    `Beam` documents the settings.

    Raises
    ------
    BeamdaeError
        If a setting is invalid, a chord frame is requested for a curve whose ends coincide, or
        `free_curve` is not a curve of nearly the same length.
    """

    name: str
    mesh: Mesh
    section: Section | VaryingSection
    quadrature: str = "reduced"
    frame: str | None = None
    free_curve: PlaneCurve | None = None

    def __post_init__(self) -> None:
        if self.frame is None:
            chord, length = chord_vector(self.mesh.curve), self.mesh.curve.length
            is_open = np.hypot(*chord) >= _MIN_DEFAULT_CHORD * length
            set_fields(self, frame="chord" if is_open else "tangent")
        convert_fields(
            self, frame=choice_of("tangent", "chord"), quadrature=choice_of("reduced", "full")
        )
        _ = self.frame_angle
        if self.free_curve is not None:
            require_free_curve(self.name, self.free_curve, self.mesh.curve)

    @cached_property
    def _geometry(self) -> _Geometry:
        """Geometry, shared with earlier beams that differ in name and section only."""
        if not (is_shareable(self.mesh) and consists_of_numbers(self.free_curve)):
            return _Geometry()
        names = (field.name for field in fields(self) if field.name not in ("name", "section"))
        return _share_geometry(type(self), *(getattr(self, name) for name in names))

    @cached_property
    def frame_angle(self) -> float:
        """Angle of the reference frame in the reference configuration [rad]."""
        curve = self.mesh.curve
        if self.frame == "tangent":
            return float(curve.tangent_angle(0.0))
        chord = chord_vector(curve)
        if np.hypot(*chord) < _MIN_CHORD * curve.length:
            raise BeamdaeError(
                f"{self.name}: frame 'chord' requires a curve with separate ends; use "
                "frame='tangent' for a closed curve."
            )
        return float(np.arctan2(chord[1], chord[0]))

    @property
    @abstractmethod
    def element(self) -> PointElement:
        """Element type, the same for all elements."""

    def fiber_strains(self, q: Array) -> Array:
        """Return strains at the stiffness points in the states q (k, n).

        Returns
        -------
        ndarray
            Axial strain, shear strain, and curvature kappa11 times half the height h of a rectangle
            with the stiffnesses of the section, h = sqrt(12 I / A), (3, elements, points, k). For a
            solid circle, this h is 13 % less than the diameter.
        """
        columns = np.asarray(self.operator @ q.T).reshape(-1, self.element.size, len(q))
        strains = self.element.strains_on_copies(columns, self.data(np.zeros(2)))
        strains[BENDING] *= self._half_heights[..., None]
        return strains

    @cached_property
    def _half_heights(self) -> Array:
        """Half heights of the sections, of a rectangle with the same EI / EA if not known."""
        sections = map(self.section.at, self.mesh.gauss_arc_lengths(self.stiffness_points).tolist())
        heights = [0.5 * x.height if x.height else np.sqrt(3.0 * x.EI / x.EA) for x in sections]
        return np.array(heights).reshape(-1, self.stiffness_points)

    def largest_strain(self, q: Array) -> float:
        """Return the largest axial strain of outer fibers [-] in the states q (k, n)."""
        count = max(int(_MAX_NUMBERS / self.operator.shape[0]), 1)
        largest = 0.0
        for first in range(0, len(q), count):
            axial, _, bending = np.abs(self.fiber_strains(q[first : first + count]))
            largest = max(largest, float(np.max(axial + bending)))
        return largest

    def deformation(self, s: float, axes: str) -> PointValues:
        """Return the deformation at s [m]; see `Kinematics`.

        Raises
        ------
        BeamdaeError
            If the frame is the chord, which follows the ends, and `s` is at an end of the beam.
        """
        length = self.mesh.curve.length
        if self.frame == "chord" and min(s, length - s) <= ARC_LENGTH_TOLERANCE * length:
            raise BeamdaeError(
                f"{self.name}: deformation at s = {s:.6g} m has no transverse component, because "
                "the chord follows the ends of the beam; use deflection(s), which is relative to "
                "the section at s = 0."
            )
        return self._deformation(s, axes)

    @abstractmethod
    def _deformation(self, s: float, axes: str) -> PointValues:
        """Return the deformation at s [m], which is not at an end of a chord."""

    @property
    def stiffness_points(self) -> int:
        """Number of Gauss points of the stiffness terms per element."""
        return self.mesh.nodes if self.quadrature == "full" else self.mesh.nodes - 1

    @property
    @abstractmethod
    def _point_data(self) -> Array:
        """Values of all quadrature points, one column per element."""

    def data(self, gravity: Array) -> Array:
        """Return the data of the elements under `gravity` (2,), shape (n_data, elements)."""
        of_gravity = np.repeat(np.array(gravity)[:, None], self.mesh.elements, axis=1)
        return np.concatenate([self._point_data, of_gravity])

    def rows_of_element(self, element: int) -> sp.csr_array:
        """Return the rows of `operator` for one element."""
        create = super().rows_of_element
        return self._geometry.derive(("element", element), lambda: create(element))

    def material_point(self, s: float) -> MaterialPoint:
        """Return the section at arc length s [m], on the reference curve."""
        # Cached because joints, observables and drawings request the same sections.
        create = super().material_point
        return self._geometry.derive(("section", s), lambda: create(s))

    def element_point(self, s: float, on_axis: bool) -> MaterialPoint:
        """Return the section at arc length s [m] in all coordinates of its element."""
        create = super().element_point
        return self._geometry.derive(("in element", s, on_axis), lambda: create(s, on_axis))


def prolongation_matrix(coarse: Kinematics, fine: Kinematics) -> sp.csc_array:
    """Return the matrix that maps changes of coordinates to a beam with a finer mesh.

    Nodal displacements and rotations are interpolated by the shape functions of the coarse
    elements. The small angles between the axes of coarse and fine elements are neglected, so that
    the result is a start for Newton's method, not a solution.

    Parameters
    ----------
    coarse
        Kinematics of a built-in formulation.
    fine
        Those of the same beam on a mesh whose elements are parts of those of the coarse mesh.
    """
    mesh, nodes = coarse.mesh, coarse.mesh.nodes
    bounds, fine_bounds = mesh.element_bounds, fine.mesh.element_bounds
    middles = 0.5 * (fine_bounds[1:] + fine_bounds[:-1])
    elements = np.searchsorted(bounds, middles) - 1
    frame, places = np.eye(coarse.rigid_coordinate_count), node_positions(fine.mesh.nodes)
    blocks = []
    for k, half, middle in zip(elements, 0.5 * fine.mesh.element_lengths, middles, strict=True):
        start, end = bounds[k : k + 2]
        xi = (2.0 * middle - start - end + 2.0 * half * places) / (end - start)
        nodal = np.kron(shape_functions(nodes, xi), np.eye(NODE_SIZE))
        block = sp.block_diag([frame, nodal])
        blocks.append(sp.kron(np.eye(1, mesh.elements, k), block))
    target = sp.csr_array(sp.vstack(blocks)) @ coarse.operator
    # Elements share nodes, and all share the frame: the equations are consistent up to the
    # neglected angles, and are solved in the least-squares sense.
    operator = sp.csc_array(fine.operator)
    normal = splu(sp.csc_matrix(operator.T @ operator))
    return sp.csc_array(normal.solve((operator.T @ target).toarray()))


def create_custom_kinematics(
    name: str, make: Callable[[str, Mesh, Any], Kinematics], mesh: Mesh, section: Any
) -> Kinematics:
    """Return the kinematics that a user function creates for the beam.

    Raises
    ------
    BeamdaeError
        If `make` is not callable, fails, or does not return a `Kinematics`.
    """
    requirement = f"{name}: kinematics must be a function of (name, mesh, section)"
    if not callable(make):
        raise BeamdaeError(f"{requirement}, got {short_repr(make)}.")
    try:
        kinematics = make(name, mesh, section)
    except BeamdaeError:
        raise
    except Exception as problem:
        raise BeamdaeError(
            f"{requirement}, but the call failed: {format_exception(problem)}."
        ) from problem
    if not isinstance(kinematics, Kinematics):
        raise BeamdaeError(
            f"{requirement} that returns a Kinematics, got {short_repr(kinematics)}."
        )
    return kinematics
