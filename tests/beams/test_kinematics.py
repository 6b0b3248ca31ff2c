"""Properties of all beam kinematics, independent of the coordinates."""

from functools import cache

import numpy as np
import pytest
from conformance import KINEMATICS
from mechanisms import cantilever
from numpy.testing import assert_allclose
from support import ARC, SOFT_MATERIAL, NumericEquations

import beamdae as bd

SECTION = bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05, damping=0.03)
LENGTH = ARC.length
every_kinematics = pytest.mark.parametrize("kind", KINEMATICS)


@cache
def free_beam(kind, gravity=(0.0, 0.0), extra_part=None, **start):
    """Return a free beam whose motion, strains and section forces are observed."""
    mech = bd.Mechanism(gravity=gravity)
    beam = mech.add(
        bd.Beam("beam", ARC, SECTION, elements=3, kinematics=KINEMATICS[kind], **dict(start))
    )
    for s in (0.0, 0.4 * LENGTH, LENGTH):
        mech.observe(f"at {s}", beam.at(s))
    mech.observe("inside", beam.section_forces(0.4 * LENGTH))
    if extra_part is not None:
        mech.add(extra_part(beam))
    return NumericEquations(mech)


@every_kinematics
def test_the_reference_drawing_is_in_equilibrium(kind):
    numeric = free_beam(kind)
    for s in (0.0, 0.4 * LENGTH, LENGTH):
        x, y, angle, *rates = numeric.observed(f"at {s}")
        # The axis interpolates the curve by cubics, with an error of fourth order.
        assert_allclose((x, y), ARC.point(s), atol=1e-4)
        assert_allclose(angle, ARC.tangent_angle(s), atol=1e-3)
        assert_allclose(rates, 0.0, atol=1e-14)
    assert_allclose(numeric.observed("inside"), 0.0, atol=1e-11)
    assert_allclose(numeric.force(), 0.0, atol=1e-11)


@every_kinematics
def test_initial_velocity_is_the_given_rigid_motion(kind):
    speed, spin = (0.3, -0.2), 1.5
    numeric = free_beam(kind, velocity=speed, angular_velocity=spin)
    v = numeric.equations.v0
    kinetic, _, _, _, dissipated = numeric.energies(v=v)
    # Kinetic energy of the rigid arc, by quadrature with 20 points.
    s, weight = np.polynomial.legendre.leggauss(20)
    arm = ARC.point(0.5 * LENGTH * (s + 1.0)) - ARC.point(0.0)
    velocity = np.array(speed) + spin * np.stack([-arm[:, 1], arm[:, 0]], axis=-1)
    rho_a, rho_i = SECTION.rhoA, SECTION.rhoI
    line = rho_a * (velocity**2).sum(axis=1) + rho_i * spin**2
    assert_allclose(kinetic, 0.25 * LENGTH * weight @ line, rtol=1e-4)
    # A rigid motion causes no strain except for interpolation errors.
    assert dissipated < 1e-4 * kinetic


@every_kinematics
def test_rayleigh_damping_of_a_rigid_motion_is_that_of_its_mass(kind):
    numeric = free_beam(
        kind,
        extra_part=lambda beam: bd.RayleighDamping("oil", beam, mass=0.7, stiffness=0.02),
        velocity=(0.3, -0.2),
        angular_velocity=1.5,
    )
    kinetic, _, _, _, dissipated = numeric.energies(v=numeric.equations.v0)
    assert_allclose(dissipated, 2.0 * 0.7 * kinetic, rtol=1e-3)


@every_kinematics
def test_air_drag_of_a_translation_is_that_of_its_normal_velocities(kind):
    """Regression: drag was wrong for other kinematics than the floating frame."""
    velocity = np.array([0.8, -0.5])
    numeric = free_beam(
        kind, extra_part=lambda beam: bd.AirDrag("air", beam, 1.4), velocity=tuple(velocity)
    )
    power = numeric.energies(v=numeric.equations.v0)[4]
    s, weight = np.polynomial.legendre.leggauss(40)
    angle = ARC.tangent_angle(0.5 * LENGTH * (s + 1.0))
    normal = velocity @ np.stack([-np.sin(angle), np.cos(angle)])
    # A few points per element integrate |v_n|^3 with an error of about 1e-3.
    assert_allclose(power, 1.4 * 0.5 * LENGTH * weight @ np.abs(normal) ** 3, rtol=5e-3)


@every_kinematics
def test_deflection_of_a_cantilever_by_castigliano(kind):
    """The tip of a quarter circle carries a small dead force."""
    steel = bd.Section(bd.Material(E=1e6, nu=0.3, rho=1.0), area=0.1, second_moment=1e-3)
    load = 1e-3
    arc = bd.Arc(radius=1.0, length=0.5 * np.pi)
    mech = cantilever(6, arc, steel, (load, 0.0), kinematics=KINEMATICS[kind])
    tip = bd.equilibrium(mech)["tip.x"].iloc[-1] - arc.end[0]
    # Integrals of cos^2 a and sin^2 a over the arc, with the angle a from the clamp.
    compliance = 1.0 / steel.EI + 1.0 / steel.EA + 1.0 / steel.GA
    assert_allclose(tip, load * 0.25 * np.pi * compliance, rtol=2e-3)
