"""External and proportional damping of beams: Rayleigh's two terms and quadratic air drag.

Viscous material damping (Kelvin-Voigt) belongs to the section, see `Section.damping`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.kinematics import Element
from beamdae.errors import BeamdaeError, require_name, require_non_negative, set_fields, short_repr
from beamdae.parts.part import Part
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Piece


@dataclass(frozen=True, eq=False)
class RayleighDamping(Part):
    """Proportional damping of a beam: forces -(mass M + stiffness K) v.

    The mass part acts on the velocity in the inertial frame, -mass rho A r' per length and
    -mass rho I (theta' + phi') on the sections: it damps the motion of the whole beam as well, like
    a fluid of constant viscosity. A vibration about a still frame decays with exp(-mass t / 2). The
    stiffness part acts on the rates of the nodal coordinates, K the constant stiffness of the
    undeformed beam (linear strains): a mode of frequency w gets the damping ratio stiffness w / 2.

    `Section.damping` (Kelvin-Voigt) is the same for amplitudes small against the radius of gyration
    of the section, and the one to take for thin beams that bend further: K counts the shortening
    of a bent beam as axial strain, and its damping grows with the square of the amplitude.

    Parameters
    ----------
    name
        Unique name.
    beam
        The beam.
    mass
        Coefficient of the mass [1/s].
    stiffness
        Coefficient of the stiffness [s].
    """

    name: str
    beam: Beam
    mass: float = 0.0
    stiffness: float = 0.0

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("RayleighDamping", self.name))
        _require_beam(self.name, self.beam)
        set_fields(
            self,
            mass=require_non_negative(self.name, "mass", self.mass),
            stiffness=require_non_negative(self.name, "stiffness", self.stiffness),
        )

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The damping of all elements."""
        kernel = _rayleigh_kernel(self.beam.kinematics.element)
        return [_damping_statement(self.name, self.beam, kernel, [self.mass, self.stiffness])]


@dataclass(frozen=True, eq=False)
class AirDrag(Part):
    """Quadratic drag on a strip: the force -coefficient |v_n| v_n per length along its normal.

    v_n is the component of the velocity (in the inertial frame, still air) along the normal of the
    deformed axis, its section turned by phi.

    Parameters
    ----------
    name
        Unique name.
    beam
        The beam.
    coefficient
        Force per length and squared velocity [kg/m^2]: C_d rho_air width / 2, C_d about 2 for a
        flat strip.
    """

    name: str
    beam: Beam
    coefficient: float

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("AirDrag", self.name))
        _require_beam(self.name, self.beam)
        set_fields(
            self, coefficient=require_non_negative(self.name, "coefficient", self.coefficient)
        )

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The drag on all elements."""
        kernel = _drag_kernel(self.beam.kinematics.element)
        return [_damping_statement(self.name, self.beam, kernel, [self.coefficient])]


def _require_beam(part: str, beam: Beam) -> None:
    if not isinstance(beam, Beam):
        raise BeamdaeError(f"{part}: beam must be a Beam, got {short_repr(beam)}.")


def _damping_statement(
    part: str, beam: Beam, kernel: ForceKernel, coefficients: list[float]
) -> ForceStatement:
    """One copy an element: the data of the element with the coefficients behind them."""
    elements = beam.kinematics.data(np.zeros(2))
    own = np.repeat(np.array(coefficients)[:, None], elements.shape[1], axis=1)
    piece = Piece(beam, beam.kinematics.operator)
    return ForceStatement(part, kernel, (piece,), np.concatenate([elements, own]))


@cache
def _rayleigh_kernel(element: Element) -> ForceKernel:
    local = Local(element.size, element.n_data + 2)
    on_mass, on_stiffness = local.data[-2], local.data[-1]
    force, dissipated = SX.zeros(element.size), SX(0)
    for inertia in element.inertia_points(local):
        rates = ca.vertcat(inertia.velocity, inertia.angular_velocity)
        resisted = on_mass * inertia.weight * inertia.density * rates
        force += ca.jtimes(rates, local.v, resisted, True)
        dissipated += ca.dot(resisted, rates)
    for elastic in element.strain_rate_points(local):
        resisted = on_stiffness * elastic.weight * elastic.stiffness * elastic.rates
        force += ca.jtimes(elastic.rates, local.v, resisted, True)
        dissipated += ca.dot(resisted, elastic.rates)
    return ForceKernel(local, force, powers=ca.vertcat(0, dissipated), reused=True)


@cache
def _drag_kernel(element: Element) -> ForceKernel:
    local = Local(element.size, element.n_data + 1)
    coefficient = local.data[-1]
    force, dissipated = SX.zeros(element.size), SX(0)
    for point in element.inertia_points(local):
        normal = ca.vertcat(-ca.sin(point.rotation), ca.cos(point.rotation))
        across = ca.dot(normal, point.velocity)
        resisted = coefficient * point.weight * ca.fabs(across) * across
        force += ca.jtimes(across, local.v, resisted, True)
        dissipated += resisted * across
    return ForceKernel(local, force, powers=ca.vertcat(0, dissipated), reused=True)
