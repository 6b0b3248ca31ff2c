"""External and proportional damping of beams: Rayleigh damping and quadratic air drag.

Viscous material damping (Kelvin-Voigt) is a property of the section: see `Section.damping`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np

from beamdae.beams.beam import Beam, beams_of, require_beam
from beamdae.beams.elements import NODE_SIZE, PointElement, PointMotion, stiffness_kernel
from beamdae.errors import convert_fields, require_non_negative
from beamdae.parts.forces.load_observables import ObservableBeamLoad
from beamdae.parts.mechanism import Mechanism
from beamdae.symbolic.formula import cache_kernels
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Piece

# Damping of sections [s] that messages recommend for beams without damping. It reduced the steps of
# a press with a steel frame from 2e5 to 1e4.
EXAMPLE_DAMPING = 1e-5


@dataclass(frozen=True, eq=False)
class RayleighDamping(ObservableBeamLoad):
    """Proportional damping of a beam: forces -(`mass` M + `stiffness` K) v.

    M is the mass matrix, K the stiffness matrix of the strains at the deformed beam, and v the
    vector of velocities. The mass term is a force -mass * rho A * (velocity) and a moment
    -mass * rho I * (angular velocity of the section) per length, with velocities relative to the
    inertial frame. Like a viscous fluid, this term also damps the rigid motion of the beam. It
    makes vibrations about a frame at rest decay as exp(-mass t / 2). The stiffness term gives a
    mode of angular frequency w the damping ratio stiffness * w / 2: section forces are
    proportional to the strain rates, with the effect of an equal `Section.damping` (Kelvin-Voigt)
    at all amplitudes. Observed section forces and stresses do not contain it.

    Parameters
    ----------
    name
        Unique name.
    beam
        The beam.
    mass
        Coefficient of the mass matrix [1/s], not negative.
    stiffness
        Coefficient of the stiffness matrix [s], not negative.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `beam` is not a Beam, or a coefficient is negative or not finite.

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    >>> beam = bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip)
    >>> oil = bd.RayleighDamping("oil", beam, mass=0.1)
    """

    name: str
    beam: Beam
    mass: float = 0.0
    stiffness: float = 0.0

    def __post_init__(self) -> None:
        convert_fields(self)
        require_beam(self.name, self.beam)
        convert_fields(self, mass=require_non_negative, stiffness=require_non_negative)

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """Return the damping forces of all elements."""
        return [
            _damping_statement(self.name, self.beam, _rayleigh_kernel, self.mass, self.stiffness)
        ]


@dataclass(frozen=True, eq=False)
class AirDrag(ObservableBeamLoad):
    """Quadratic drag on a strip in still air: the force -coefficient |v_n| v_n per length.

    v_n is the component of the velocity in the inertial frame that lies in the plane of the
    deformed section, across the axis; the force is opposite to this component.

    Parameters
    ----------
    name
        Unique name.
    beam
        The beam.
    coefficient
        Force per length and squared velocity [kg/m^2], not negative: C_d rho_air width / 2, with
        C_d about 2 for a flat strip.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `beam` is not a Beam, or `coefficient` is negative or not finite.

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    >>> beam = bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip)
    >>> air = bd.AirDrag("air", beam, coefficient=2.0 * 1.2 * 0.02 / 2.0)
    """

    name: str
    beam: Beam
    coefficient: float

    def __post_init__(self) -> None:
        convert_fields(self)
        require_beam(self.name, self.beam)
        convert_fields(self, coefficient=require_non_negative)

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """Return the drag forces on all elements."""
        return [_damping_statement(self.name, self.beam, _drag_kernel, self.coefficient)]


def _damping_statement(
    part: str, beam: Beam, kernel: Callable[[PointElement], ForceKernel], *coefficients: float
) -> ForceStatement:
    """Return the statement of a kernel whose data are the element data and `coefficients`."""
    elements = beam.kinematics.data(np.zeros(2))
    repeated = np.repeat(np.array(coefficients)[:, None], elements.shape[1], axis=1)
    data, piece = np.concatenate([elements, repeated]), Piece(beam, beam.kinematics.operator)
    return ForceStatement(part, kernel(beam.kinematics.element), (piece,), data)


@cache_kernels
def _rayleigh_kernel(element: PointElement) -> ForceKernel:
    local, layout = Local(element.size, element.n_data + 2), element.layout
    data, (mass, stiffness) = local.data, ca.vertsplit(local.data[-2:])
    kernel, of_point = _motion_kernel(element.of_point, _inertia_resistance), element.of_point
    points = element.mass_points(kernel, [ca.vertcat(x, mass) for x in layout.split_mass(data)])
    # The coefficient is a retardation time in place of that of the section.
    kernel = stiffness_kernel(replace(of_point, damped=True), has_elasticity=False)
    numbers = [ca.vertcat(x[:-1], stiffness) for x in layout.split_stiffness(data)]
    return ForceKernel.of_points(local, points + element.stiffness_points(kernel, numbers))


@cache_kernels
def _drag_kernel(element: PointElement) -> ForceKernel:
    local = Local(element.size, element.n_data + 1)
    numbers = [ca.vertcat(x, local.data[-1]) for x in element.layout.split_mass(local.data)]
    kernel = _motion_kernel(element.of_point, _drag_resistance)
    return ForceKernel.of_points(local, element.mass_points(kernel, numbers))


@cache
def _motion_kernel(
    element: PointElement, resist: Callable[[PointMotion, SX, SX], SX]
) -> ForceKernel:
    """Return the kernel of a force at an inertia point against its motion.

    `resist` returns the force per length times the coefficient, the last number of the point, from
    the motion and (rhoA, rhoI); forces do work on the rates of the motion.
    """
    first = len(element.layout.mass_point)
    local = Local(element.frame_size + NODE_SIZE, first + 5)
    motion = element.motion_at(local.q, local.v, local.data)
    rhoA, rhoI, _, _, coefficient = ca.vertsplit(local.data[first:])
    resistance = local.data[0] * coefficient * resist(motion, rhoA, rhoI)
    force = ca.jtimes(motion.rates, local.v, resistance, True)
    return ForceKernel(local, force, powers=ca.vertcat(0, ca.dot(resistance, motion.rates)))


def _inertia_resistance(motion: PointMotion, rhoA: SX, rhoI: SX) -> SX:
    return ca.vertcat(rhoA, rhoA, rhoI) * motion.rates


def _drag_resistance(motion: PointMotion, rhoA: SX, rhoI: SX) -> SX:
    normal = ca.vertcat(-ca.sin(motion.rotation), ca.cos(motion.rotation), 0)
    normal_velocity = ca.dot(normal, motion.rates)
    return ca.fabs(normal_velocity) * normal_velocity * normal


def find_undamped_beams(mechanism: Mechanism | None) -> list[str]:
    """Return the names of the beams whose vibrations no material damping reduces."""
    parts = () if mechanism is None else mechanism.parts.values()
    damped = {x.beam for x in parts if isinstance(x, RayleighDamping) and x.stiffness > 0.0}
    return [
        beam.name
        for beam in beams_of(mechanism)
        if beam.section.at(0.0).damping == 0.0 and beam not in damped
    ]
