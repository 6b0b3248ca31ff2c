"""Relaxation of beams: the standard linear solid, with strains of dampers as first-order states.

With the states y = c x, c = sqrt(weight ratio D time), for the strain x of a damper at a quadrature
point, forces are derivatives of one energy V, and the states follow y' = -dV/dy: the stiffness is
symmetric, as equilibria assume of elastic forces, and the dissipated power is y'^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import Beam, require_beam
from beamdae.beams.elements import (
    NODE_SIZE,
    RESULTANTS,
    STIFFNESS_VALUES,
    InterpolatedForces,
    PointElement,
)
from beamdae.beams.kinematics import PointValues
from beamdae.beams.shape_functions import gauss_points, lagrange_weights
from beamdae.beams.strains import AXIAL, SHEAR, STRAIN_SIZE, identity
from beamdae.errors import convert_fields, require_positive
from beamdae.parts.forces.load_observables import ObservablePower
from beamdae.parts.part import Part
from beamdae.symbolic.force_kernel import mix_law
from beamdae.symbolic.formula import Formula, cache_kernels
from beamdae.symbolic.sparse_operators import select_rows
from beamdae.symbolic.statements import (
    SX,
    ForceAtPoint,
    ForceKernel,
    ForceStatement,
    Local,
    Piece,
    Quantity,
    Variable,
    formula_quantity,
    rebuilt_for_mesh,
)

Array = np.ndarray
_STRAIN_SCALE = 1e-3  # typical strain of elastic beams
_STATE_UNIT = "J^0.5 s^0.5"
_STATE_NAMES = ("axial", "shear", "bending")


@dataclass(frozen=True, eq=False)
class StandardLinearSolid(ObservablePower):
    """Relaxation of a beam: a spring and a damper in series (Maxwell), parallel to its stiffness.

    The section of the beam has the relaxed stiffness D = diag(EA, GA, EI), which alone acts in
    equilibria. The part adds the section forces ratio D (eps - x), where eps are the strains of
    the axis and x those of the damper, first-order states that follow x' = (eps - x) /
    relaxation_time from x = eps at the start. At an angular frequency w, with the time t, the
    modulus is E (1 + ratio i w t / (1 + i w t)): it increases from E to (1 + ratio) E, and the loss
    factor is largest at w t = 1 / sqrt(1 + ratio), ratio / (2 sqrt(1 + ratio)). Several parts on
    one beam form a Prony series (generalized Maxwell model).

    Quantities of the beam that follow from strains, such as `Beam.stress`, are those of the relaxed
    stiffness; `Solution.section_forces` contains the part, and `section_forces` is its share.

    Parameters
    ----------
    name
        Unique name.
    beam
        The beam; `material` of its section has the relaxed modulus E.
    ratio
        Stiffness of the spring of the Maxwell element, divided by the relaxed stiffness [-].
    relaxation_time
        Time in which the force of the Maxwell element decreases to 1/e at constant strain [s].

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `beam` is not a Beam, or a number is not positive.

    Examples
    --------
    >>> import beamdae as bd
    >>> polymer = bd.Material(E=1.5e9, nu=0.4, rho=1150.0)
    >>> strip = bd.Section.rectangle(polymer, width=0.02, height=0.004)
    >>> beam = bd.Beam("beam", bd.Line((0.0, 0.0), (0.2, 0.0)), strip)
    >>> relaxation = bd.StandardLinearSolid("relaxation", beam, ratio=0.4, relaxation_time=0.02)
    """

    name: str
    beam: Beam
    ratio: float
    relaxation_time: float

    load_distribution = "none"
    is_state = True

    def __post_init__(self) -> None:
        convert_fields(self)
        require_beam(self.name, self.beam)
        convert_fields(self, ratio=require_positive, relaxation_time=require_positive)

    @property
    def scale(self) -> float:
        """States of axial springs with a typical strain."""
        return _STRAIN_SCALE * float(np.mean(self._state_sizes[AXIAL]))

    @property
    def coordinates(self) -> tuple[Variable, ...]:
        """Three states at each stiffness point."""
        points = range(self._state_sizes[AXIAL].size)
        return tuple(Variable(f"{name}{k}", _STATE_UNIT) for k in points for name in _STATE_NAMES)

    @property
    def initial_position(self) -> Array:
        """States of the strains of the reference configuration: the springs are relaxed."""
        kinematics = self.beam.kinematics
        element = kinematics.element
        columns = (kinematics.operator @ kinematics.initial_position).reshape(-1, element.size, 1)
        strains = element.strains_on_copies(columns, self._element_data)[..., 0]
        return np.moveaxis(self._state_sizes * strains, 0, -1).ravel()

    @property
    def _state_sizes(self) -> Array:
        """States per strain of the dampers, (3, elements, points)."""
        layout = self.beam.kinematics.element.layout
        values = np.moveaxis(layout.stiffness_values(self._element_data), -1, 0)
        stiffness = values[-len(STIFFNESS_VALUES) :][:STRAIN_SIZE]
        return np.sqrt(self.ratio * self.relaxation_time * values[0] * stiffness)

    @property
    def initial_velocity(self) -> Array:
        """Zero; the rates follow from the strains."""
        return np.zeros(len(self.coordinates))

    @property
    def _element_data(self) -> Array:
        return self.beam.kinematics.data(np.zeros(2))

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Return the forces of the springs, and the rows y' + dV/dy of the states."""
        kernel, own = (
            _element_kernel(self.beam.kinematics.element),
            (self.ratio, self.relaxation_time),
        )
        columns = enumerate(self._element_data.T)
        return [
            ForceStatement(self.name, kernel, self._pieces(k), np.array([[*column, *own]]).T)
            for k, column in columns
        ]

    def _pieces(self, element: int) -> tuple[Piece, Piece]:
        kinematics, n = self.beam.kinematics, len(self.coordinates)
        size = STRAIN_SIZE * kinematics.element.quadrature
        rows = np.arange(size) + size * element
        states = select_rows(sp.csr_array(sp.eye_array(n)), rows)
        return Piece(self.beam, kinematics.rows_of_element(element)), Piece(self, states)

    @rebuilt_for_mesh
    def section_forces(self, s: float) -> Quantity:
        """Return the share of the Maxwell element in the section forces at `s`.

        Parameters
        ----------
        s
            Arc length [m].

        Returns
        -------
        Quantity
            Columns N [N], Q [N] and M [N m], see `Beam.section_forces`.

        Raises
        ------
        BeamdaeError
            If `s` is outside the beam.
        """
        columns = self.beam.section_forces(s).columns
        pieces, formula = self._forces_at(float(s))
        return formula_quantity(columns, pieces, identity, [formula])

    def _point_values(self, s: float) -> PointValues:
        """Return the function for the `section_forces` at s [m].

        The operator applies to the coordinates of the beam, followed by the states.
        """
        pieces, formula = self._forces_at(s)
        return PointValues(sp.csr_array(sp.block_diag([x.operator for x in pieces])), formula)

    def _forces_at(self, s: float) -> tuple[tuple[Piece, Piece], Formula]:
        element, (number, xi) = self.beam.kinematics.element, self.beam.mesh.locate(s)
        points = element.layout.stiffness_values(self._element_data)[number]
        own = np.tile((self.ratio, self.relaxation_time), (len(points), 1))
        weights = lagrange_weights(gauss_points(element.quadrature)[0], xi)
        numbers = (*weights, *np.hstack([points, own]).ravel().tolist())
        return self._pieces(number), Formula(_MaxwellForces(element), numbers)

    def _prolongation_to(self, fine: Part) -> sp.csc_array:
        """Return the matrix that maps states to those on another mesh, see `Part`.

        The strains of the dampers are interpolated between the stiffness points of coarse elements.
        """
        assert isinstance(fine, StandardLinearSolid)
        mesh, points = self.beam.mesh, self.beam.kinematics.element.quadrature
        s = fine.beam.mesh.gauss_arc_lengths(fine.beam.kinematics.element.quadrature)
        at = np.zeros((len(s), mesh.elements, points))
        for k, (element, xi) in enumerate(map(mesh.locate, s.tolist())):
            at[k, element] = lagrange_weights(gauss_points(points)[0], xi)
        strains = sp.kron(at.reshape(len(s), -1), np.eye(STRAIN_SIZE))
        old, new = (np.moveaxis(x._state_sizes, 0, -1).ravel() for x in (self, fine))
        return sp.csc_array(sp.diags_array(new) @ strains @ sp.diags_array(1.0 / old))


class _MaxwellForces(InterpolatedForces):
    """Section forces of the Maxwell element.

    The local coordinates are those of the element, then the states; the data of each point end with
    ratio and relaxation time.
    """

    def __call__(self, local: Local, numbers: Any) -> SX:
        """Return (N, Q, M)."""
        points = partial(_maxwell_points, self.element)
        return self.interpolate(local, numbers, points, _section_force_function)


class _MaxwellPoint(NamedTuple):
    """Maxwell element at a stiffness point: elongations and forces of its springs.

    The coordinates are those of the point, then the states. The data are those of the point, then
    the ratio and the relaxation time.
    """

    local: Local
    elongation: SX
    forces: SX

    @classmethod
    def of(cls, element: PointElement) -> _MaxwellPoint:
        first, size = len(element.layout.stiffness_point), 2 * NODE_SIZE
        local = Local(size + STRAIN_SIZE, first + len(STIFFNESS_VALUES) + 2)
        stiffness = local.data[-2] * local.data[first : first + STRAIN_SIZE]
        sizes = ca.sqrt(local.data[0] * local.data[-1] * stiffness)
        elongation = element.strain_at(local.q[:size], local.data) - local.q[size:] / sizes
        return cls(local, elongation, stiffness * elongation)


@cache
def _section_force_function(element: PointElement) -> ca.Function:
    local, _, forces = _MaxwellPoint.of(element)
    angle = element.force_rotation_at(local.q[: 2 * NODE_SIZE])
    values = forces + ca.vertcat(ca.sin(angle) * forces[SHEAR], 0, 0)
    return ca.Function("maxwell_forces", [local.q, local.v, local.data], [ca.densify(values)])


@cache
def _point_kernel(element: PointElement) -> ForceKernel:
    local, elongation, forces = _MaxwellPoint.of(element)
    weight, rates = local.data[0], local.v[2 * NODE_SIZE :]
    rest = ca.vertcat(SX.zeros(2 * NODE_SIZE), rates)
    force = weight * ca.jtimes(elongation, local.q, forces, True) + rest
    energy = 0.5 * weight * ca.dot(forces, elongation)
    energies, powers = ca.vertcat(0, energy, 0), ca.vertcat(0, ca.sumsqr(rates))
    mix = partial(mix_law, local, elongation, weight * forces, RESULTANTS, rest)
    return ForceKernel(local, force, energies, powers, mix=mix)


def _maxwell_points(element: PointElement, numbers: Sequence[SX]) -> list[ForceAtPoint]:
    """Return the forces at the stiffness points with the numbers of each point."""
    kernel, count = _point_kernel(element.of_point), STRAIN_SIZE * element.quadrature
    differences = ca.diagcat(element.differences, ca.DM.eye(count))
    states = ca.vertsplit(ca.DM.eye(count), STRAIN_SIZE)
    triples = zip(element.stiffness_weights, states, numbers, strict=True)
    return [ForceAtPoint(differences, ca.diagcat(w, x), kernel, data) for w, x, data in triples]


@cache_kernels
def _element_kernel(element: PointElement) -> ForceKernel:
    size = element.size + STRAIN_SIZE * element.quadrature
    local = Local(size, element.n_data + 2)
    points = element.layout.split_stiffness(local.data)
    numbers = [ca.vertcat(x, local.data[-2:]) for x in points]
    return ForceKernel.of_points(local, _maxwell_points(element, numbers))
