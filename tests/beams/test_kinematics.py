"""Properties of all beam kinematics, and those of the geometrically exact beam alone."""

from functools import cache

import numpy as np
import pytest
from conformance import KINEMATICS
from mechanisms import cantilever, rectangle
from numpy.testing import assert_allclose
from support import ARC, SOFT_MATERIAL, NumericEquations

import beamdae as bd

SECTION = bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05, damping=0.03)
# Nodes, quadrature, shape, section.
SETTINGS = [
    {},
    {"quadrature": "full"},
    {"nodes": 3},
    {"nodes": 6},
    {"nodes": 2},
    {"nodes": 2, "quadrature": "full"},
    {"elements_shape": "straight"},
    {
        "section": lambda s: bd.Section(
            SOFT_MATERIAL, area=0.9 - 0.2 * s, second_moment=0.05, damping=0.1
        )
    },
    {"section": bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05)},
    {"free_curve": bd.Line((0.0, 0.0), (ARC.length * 1.004, 0.0))},
]
every_setting = pytest.mark.parametrize(
    "settings", SETTINGS, ids=lambda x: " ".join(map(str, x)) or "default"
)


def beam(curve=ARC, elements=3, name="beam", **settings):
    section = settings.pop("section", SECTION)
    return bd.Beam(name, curve, section, elements, formulation="exact", **settings)


def free_beam(gravity=(0.0, 0.0), **settings):
    mech = bd.Mechanism(gravity=gravity)
    body = mech.add(beam(**settings))
    for s in (0.0, 0.4, 1.0):
        mech.observe(f"forces {s}", body.section_forces(s * body.length))
        mech.observe(f"at {s}", body.at(s * body.length))
    return NumericEquations(mech)


def rotate_coordinates(q, angle, shift=(0.0, 0.0)):
    """Return the nodal coordinates after a rigid motion."""
    nodes = q.reshape(-1, 3)
    c, s = np.cos(angle), np.sin(angle)
    place = nodes[:, :2] @ np.array([[c, s], [-s, c]]) + shift
    return np.column_stack([place, nodes[:, 2] + angle]).ravel()


def deformed_coordinates(numeric, seed=0, size=0.4):
    """Return random coordinates far from the reference drawing."""
    rng = np.random.default_rng(seed)
    return numeric.equations.q0 + size * rng.standard_normal(numeric.n)


@every_setting
def test_rigid_motion_causes_no_strain(settings):
    numeric = free_beam(**settings)
    at_rest = numeric.energies()[1]
    for angle in (0.7, 3.0, -40.0):
        q = rotate_coordinates(numeric.equations.q0, angle, (3.0, -1.0))
        for s in (0.0, 0.4, 1.0):
            here, there = (numeric.observed(f"forces {s}", q=x) for x in (None, q))
            # Rounding errors of strains, times stiffnesses of order 50; rotations up to 40 rad.
            assert_allclose(there, here, atol=1e-11)
        assert_allclose(numeric.energies(q)[1], at_rest, atol=1e-12 * max(1.0, at_rest))


def test_the_mass_matrix_is_constant_and_inertia_has_no_quadratic_terms():
    numeric = free_beam()
    rng = np.random.default_rng(3)
    here, there = numeric.equations.q0, deformed_coordinates(numeric)
    v, a = rng.standard_normal((2, numeric.n))
    mass = numeric.mass(here)
    assert_allclose(numeric.mass(there, v, a), mass, atol=1e-15)
    undamped = free_beam(section=bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05))
    for q in (here, there):
        inertia = undamped.force(q, v, a) - undamped.force(q)
        assert_allclose(inertia, undamped.mass(q) @ a, atol=1e-12)


def test_strains_and_section_forces_are_reissners():
    """A straight beam, rotated by 2 rad, has uniform stretch e, shear g and curvature b."""
    e, g, b, turn = 0.2, 0.1, 0.9, 2.0
    numeric = free_beam(curve=bd.Line((0.0, 0.0), (1.5, 0.0)), elements=8)
    s = np.linspace(0.0, 1.5, numeric.n // 3)
    psi = turn + b * s
    # Integrals of (1 + e) t + g n over s.
    x = ((1 + e) * (np.sin(psi) - np.sin(turn)) + g * (np.cos(psi) - np.cos(turn))) / b
    y = (-(1 + e) * (np.cos(psi) - np.cos(turn)) + g * (np.sin(psi) - np.sin(turn))) / b
    q = np.column_stack([x, y, psi]).ravel()
    expected = (SECTION.EA * e, SECTION.GA * g, -SECTION.EI * b)
    for place in (0.0, 0.4, 1.0):
        # Interpolation errors of slopes with a curvature of 0.17 rad per element.
        assert_allclose(numeric.observed(f"forces {place}", q=q), expected, rtol=2e-4)
    energy = 0.75 * (SECTION.EA * e**2 + SECTION.GA * g**2 + SECTION.EI * b**2)
    assert_allclose(numeric.energies(q)[1], energy, rtol=1e-5)


@pytest.mark.parametrize("frame", ["tangent", "chord"])
def test_deformation_is_relative_to_the_reference_frame(frame):
    """The frame is attached to the start section or to the chord."""
    mech = bd.Mechanism()
    body = mech.add(beam(frame=frame))
    mech.observe("seen from", body.floating_frame)
    for axes in ("inertial", "frame", "local"):
        mech.observe(axes, body.deformation(0.7, axes))
    mech.observe("at", body.at(0.7))
    mech.observe("root", bd.relative_displacement(of=body.at(0.7), on=body.start))
    numeric = NumericEquations(mech)
    q = rotate_coordinates(deformed_coordinates(numeric, size=0.1), 5.0, (1.0, -3.0))
    x, y, angle = numeric.observed("seen from", q=q)[:3]
    place, section = numeric.observed("at", q=q)[:2], numeric.observed("at", q=q)[2]
    reference_angle = (
        ARC.angle if frame == "tangent" else np.arctan2(*(ARC.point(2.0) - ARC.start)[::-1])
    )
    turn = angle - reference_angle
    c, s = np.cos(turn), np.sin(turn)
    rigid = (x, y) + np.array([[c, -s], [s, c]]) @ (ARC.point(0.7) - ARC.start)
    inertial = numeric.observed("inertial", q=q)
    assert_allclose(inertial[:2], place - rigid, atol=1e-13)
    at_rest = numeric.observed("at")[2]
    assert_allclose(inertial[2], section - at_rest - turn, atol=1e-13)
    for axes, in_axes in (("frame", angle), ("local", turn + at_rest)):
        c, s = np.cos(in_axes), np.sin(in_axes)
        back = np.array([[c, s], [-s, c]]) @ inertial[:2]
        assert_allclose(numeric.observed(axes, q=q)[:2], back, atol=1e-13)
    if frame == "tangent":
        assert_allclose(inertial, numeric.observed("root", q=q), atol=1e-13)
    else:
        ends = q.reshape(-1, 3)[[0, -1], :2]
        assert_allclose(
            np.exp(1j * angle), np.exp(1j * np.arctan2(*np.diff(ends, axis=0)[0][::-1]))
        )
    for axes in ("inertial", "frame", "local"):
        assert_allclose(numeric.observed(axes), 0.0, atol=1e-14)


def test_regression_a_distant_beam_has_no_initial_strain():
    mech, section = bd.Mechanism(), rectangle(0.004)
    begin = 2.0**20
    line = bd.Line((begin, begin), (begin + 3.0, begin))
    mech.add(bd.Beam("strut", line, section, 1, formulation="exact"))
    assert np.max(np.abs(NumericEquations(mech).force())) < 1e-17 * section.EA


# Properties of all beam kinematics, independent of the coordinates.

LENGTH = ARC.length
every_kinematics = pytest.mark.parametrize("kind", KINEMATICS)


@cache
def observed_beam(kind, gravity=(0.0, 0.0), extra_part=None, **start):
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
    numeric = observed_beam(kind)
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
    numeric = observed_beam(kind, velocity=speed, angular_velocity=spin)
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
    numeric = observed_beam(
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
    numeric = observed_beam(
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
