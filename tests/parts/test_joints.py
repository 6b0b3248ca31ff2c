"""Joints: constraint levels along motions, virtual work of reactions, error messages."""

from __future__ import annotations

import numpy as np
import pytest
from conformance import JOINTS, NONHOLONOMIC, TIP
from numpy.testing import assert_allclose
from support import (
    ARC,
    EXACT_VARIANT,
    VARIANTS,
    NumericEquations,
    assert_derivative,
    directional_derivative,
)

import beamdae as bd
from beamdae.equations.starts.consistent_start import ConsistencySolver

TANGENT, CHORD = VARIANTS[0], VARIANTS[2]


def parts(variant=TANGENT):
    """Return a mechanism with a disk and a beam that are not connected, and both bodies."""
    mech = bd.Mechanism(gravity=(0.2, -1.5))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(variant.beam(ARC))
    return mech, disk, beam


every_joint = pytest.mark.parametrize("make", JOINTS.values(), ids=list(JOINTS))
# Joints between points of bodies; for sliders on beams see test_sliding.
OF_POINTS = {x: make for x, make in JOINTS.items() if not x.startswith("sliding")} | NONHOLONOMIC
every_joint_of_points = pytest.mark.parametrize("make", OF_POINTS.values(), ids=list(OF_POINTS))
every_frame = pytest.mark.parametrize(
    "variant",
    [TANGENT, EXACT_VARIANT, pytest.param(CHORD, marks=pytest.mark.slow)],
    ids=["tangent", "exact", "chord"],
)


def jointed(make, variant=TANGENT):
    mech, disk, beam = parts(variant)
    joint = mech.add(make(mech, disk, beam))
    mech.observe("reaction", joint.reaction)
    return NumericEquations(mech), mech


@every_joint
@every_frame
def test_drawn_position_is_closed(make, variant):
    numeric, _ = jointed(make, variant)
    # Rounding error of coordinates in the drawing; joints of the beam lie on its interpolated axis.
    assert_allclose(numeric.levels[0](time=[0.0, 0.0]), 0.0, atol=1e-14)


@pytest.mark.parametrize("phase", [0.5, 2.0])
@every_joint
@every_frame
def test_levels_are_time_derivatives_along_a_motion(make, variant, phase):
    """`phase` is before or after the end of the run-up; the motion is an arbitrary smooth one."""
    numeric, _ = jointed(make, variant)
    rng = np.random.default_rng(0)
    size, rate, start = rng.uniform(0.2, 1.0, (3, numeric.n))

    def motion(t, order):
        phase = rate * t + start + 0.5 * np.pi * order
        return size * rate**order * np.sin(phase) + (numeric.equations.q0 if order == 0 else 0.0)

    def level(k, t):
        q, v, a = (motion(t, order) for order in range(3))
        return np.atleast_1d(numeric.levels[k](q, v, a, time=[t, phase]))

    for t in (0.3, 1.1):
        for k in (0, 1):
            expected = directional_derivative(
                lambda x, k=k: level(k, x[0]), np.array([t]), np.ones(1)
            )
            # Error of five-point differences of step 1e-3 of quantities of order ten.
            assert_allclose(level(k + 1, t), expected, atol=1e-10)


@every_joint
@every_frame
def test_reactions_do_virtual_work_on_the_constraints_only(make, variant):
    numeric, _ = jointed(make, variant)
    rng = np.random.default_rng(1)
    q = numeric.equations.q0 + 0.3 * rng.standard_normal(numeric.n)
    lam = rng.standard_normal(numeric.m)
    matrix = numeric.constraint_matrix(q)
    assert_derivative(matrix, lambda x: np.atleast_1d(numeric.levels[0](x)), q)
    # The same product with another order of summation.
    assert_allclose(numeric.reaction(q, lam=lam), matrix.T @ lam, atol=1e-13)


@every_joint_of_points
@every_frame
def test_reactions_on_all_bodies_are_equivalent_to_the_constraint_forces(make, variant):
    """G^T lam equals the generalized forces of the reported loads, in both kinds of axes."""
    _, mech = jointed(make, variant)
    joint = mech.part("j")
    places = joint.points
    both = [(place, axes) for place in places for axes in ("inertial", "body")]
    for place, axes in both:
        mech.observe(f"{place} {axes}", joint.reaction_on(place, axes))
    numeric = NumericEquations(mech)
    rng = np.random.default_rng(2)
    q = numeric.equations.q0 + 0.3 * rng.standard_normal(numeric.n)
    lam = rng.standard_normal(numeric.m)
    reactions = {both: numeric.observed(" ".join(both), q=q, lam=lam) for both in both}
    for axes in ("inertial", "body"):
        loaded = bd.Mechanism(gravity=tuple(mech.gravity))
        loaded.ground = mech.ground
        for body in ("disk", "beam"):
            loaded.add(mech.part(body))
        for name, place in places.items():
            if place.body is mech.ground:
                continue
            *force, moment = reactions[name, axes].tolist()
            loaded.add(bd.Force(f"force {name}", place, tuple(force), axes))
            loaded.add(bd.Moment(f"moment {name}", place, moment))
        by_loads = NumericEquations(loaded).force(q) - numeric.force(q)
        assert_allclose(by_loads, numeric.reaction(q, lam=lam), atol=1e-12)  # rounding
    reported = numeric.observed("reaction", q=q, lam=lam)
    names = [column.name for column in joint.reaction.columns]
    assert_allclose(reported, -lam, rtol=1e-15)
    of_b = reactions.get(("b", "inertial"), (0.0, 0.0, 0.0))
    on_b = dict(zip(("Fx", "Fy", "M"), of_b, strict=True))
    for name, value in zip(names, reported, strict=True):
        if name in on_b:
            assert_allclose(on_b[name], value, atol=1e-14)  # rounding


def test_reaction_of_a_rotating_line():
    """Force F n on the point, -F n at the same place on the body that carries the line."""
    numeric, _ = jointed(JOINTS["turning line"])
    rng = np.random.default_rng(3)
    q = numeric.equations.q0 + 0.3 * rng.standard_normal(numeric.n)
    (reported,) = numeric.observed("reaction", q=q, lam=[0.7])
    disk = q[:3]
    angle = disk[2] + np.pi  # the direction is (-1, 0)
    normal = np.array([-np.sin(angle), np.cos(angle)])
    mech, _, beam = parts()
    mech.observe("tip", beam.end)
    arm = NumericEquations(mech).observed("tip", q=q)[:2] - disk[:2]
    on_disk = -reported * np.array([*normal, arm[0] * normal[1] - arm[1] * normal[0]])
    assert reported == -0.7
    assert_allclose(-numeric.reaction(q, lam=[0.7])[:3], on_disk, atol=1e-13)  # rounding
    assert_allclose(-numeric.reaction(q, lam=[0.7])[3:5], reported * normal, atol=1e-13)


def test_weld_carries_a_hanging_weight():
    """Mass 2 kg with its center 1.5 m off the weld: force m g up, moment m g 1.5 m."""
    for ground_first in (True, False):
        mech = bd.Mechanism(gravity=(0.0, -9.81))
        arm = mech.add(bd.RigidBody("arm", mass=2.0, inertia=0.3, center=(1.5, 0.0)))
        ends = [mech.ground.at(0.0, 0.0), arm.at(0.0, 0.0)]
        weld = mech.add(bd.Weld("wall", *(ends if ground_first else ends[::-1])))
        mech.observe("wall", weld.reaction)
        numeric = NumericEquations(mech)
        state = ConsistencySolver(numeric.equations).state(np.zeros(2), *_drawn_state(numeric))
        sign = 1.0 if ground_first else -1.0
        expected = sign * np.array([0.0, 2.0 * 9.81, 2.0 * 9.81 * 1.5])
        # Rounding of a saddle-point solution.
        assert_allclose(numeric.observed("wall", q=state.q, lam=state.lam), expected, atol=1e-12)


def _drawn_state(numeric):
    return numeric.equations.q0, numeric.equations.v0


def test_a_driver_rotates_a_wheel():
    """Moment J theta'' and power J theta'' theta' of a run-up, closed forms of its law."""
    inertia, speed, duration, t = 0.7, 3.0, 0.5, 0.2
    mech = bd.Mechanism()
    wheel = mech.add(bd.RigidBody("wheel", mass=1.0, inertia=inertia))
    hub = (mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0))
    mech.add(bd.Revolute("bearing", *hub))
    motor = mech.add(bd.Driver("motor", *hub, law=bd.run_up(speed, duration)))
    mech.observe("motor", motor.reaction)
    numeric = NumericEquations(mech, time=(t, t))
    state = ConsistencySolver(numeric.equations).state(numeric.time, *_drawn_state(numeric))
    turn = 2.0 * np.pi * t / duration
    theta_ddot = speed / duration * (1.0 - np.cos(turn))
    theta_dot = speed / duration * (t - duration / (2.0 * np.pi) * np.sin(turn))
    theta = speed / duration * (t**2 / 2.0 + (duration / 2.0 / np.pi) ** 2 * (np.cos(turn) - 1.0))
    # Rounding error; the start is closed to 1e-12.
    assert_allclose(state.q[2], theta, atol=1e-12)
    assert_allclose(state.v[2], theta_dot, rtol=1e-12)
    assert_allclose(state.a[2], theta_ddot, rtol=1e-12)
    moment = numeric.observed("motor", q=state.q, lam=state.lam)
    assert_allclose(moment, [inertia * theta_ddot], rtol=1e-12)
    power = numeric.driver_power(q=state.q, lam=state.lam)
    assert_allclose(power, [inertia * theta_ddot * theta_dot], rtol=1e-12)


def test_bead_on_a_rotating_line_has_centrifugal_and_coriolis_acceleration():
    """A particle on a line that rotates at a constant rate: x'' = omega^2 x, F = 2 m omega x'."""
    omega, mass, distance, speed = 2.0, 0.4, 1.5, 0.8
    mech = bd.Mechanism()
    rod = mech.add(bd.RigidBody("rod", mass=1.0, inertia=1.0))
    bead = mech.add(bd.PointMass("bead", mass, at=(distance, 0.0), velocity=(speed, 9.0)))
    center = (mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0))
    mech.add(bd.Revolute("pivot", *center))
    mech.add(bd.Driver("motor", *center, law=lambda t: omega * t))
    line = mech.add(bd.PointOnLine("slot", rod.at(0.0, 0.0), bead.point))
    mech.observe("slot", line.reaction)
    numeric = NumericEquations(mech)
    state = ConsistencySolver(numeric.equations).state(np.zeros(2), *_drawn_state(numeric))
    where = numeric.index("bead.x")
    # Rounding error.
    assert_allclose(state.v[where:], (speed, omega * distance), rtol=1e-13)
    assert_allclose(state.a[where:], (0.0, 2.0 * omega * speed), atol=1e-13)
    force = numeric.observed("slot", q=state.q, lam=state.lam)
    assert_allclose(force, [2.0 * mass * omega * speed], rtol=1e-13)


def test_welded_beams_continue_each_other():
    """A weld between two halves of an arc leaves the frames of both on one curve."""
    half = bd.Arc(radius=1.6, length=1.0, start=ARC.start, angle=ARC.angle)
    rest = bd.Arc(
        radius=1.6,
        length=1.0,
        start=tuple(half.point(1.0)),
        angle=float(half.tangent_angle(1.0)),
    )
    mech = bd.Mechanism()
    first = mech.add(TANGENT.beam(half, name="first"))
    second = mech.add(TANGENT.beam(rest, name="second"))
    mech.add(bd.Weld("seam", first.end, second.start))
    mech.observe("tip", second.end)
    numeric = NumericEquations(mech)
    # Rounding error.
    assert_allclose(numeric.levels[0](), 0.0, atol=1e-14)
    assert_allclose(numeric.observed("tip")[:2], TIP, atol=1e-14)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda m, d, b: bd.Revolute("pin", d.at(1.0, 2.0), b.start),
            r"pin: the two points must coincide .* disk at \(1, 2\) and beam at \(0.3, -0.2\) are "
            r"2.3086\d* m apart",
        ),
        (
            lambda m, d, b: bd.Weld("seam", m.ground.at(0.0, 0.0), d.at(0.0, 1e-4)),
            r"seam: the two points must coincide .* ground at .* and disk at \(0, 0.0001\) are "
            "0.0001 m apart",
        ),
        (
            lambda m, d, b: bd.PointOnLine("slot", d.at(0.0, 0.0), m.ground.at(3.0, 0.5)),
            r"slot: the point must lie on the line .* ground at \(3, 0.5\) is 0.5 m off the line "
            r"through disk at \(0, 0\)",
        ),
        (
            lambda m, d, b: bd.Revolute("pin", d.at(1.0, 2.0), d.at(1.0, 2.0)),
            "pin: a joint must connect two different bodies, but both .* belong to 'disk'",
        ),
        (
            lambda m, d, b: bd.Weld("pin", b.start, b.end),
            "pin: a joint must connect two different bodies",
        ),
        (
            lambda m, d, b: bd.Revolute("pin", d, b.start),
            "pin: first attachment must be an attachment such as beam.end, got RigidBody",
        ),
        (
            lambda m, d, b: bd.Revolute("pin", b.start, "disk"),
            "pin: second attachment must be an attachment .*, got 'disk'",
        ),
        (
            lambda m, d, b: bd.Driver("motor", m.ground.at(0, 0), d.at(0, 0)),
            "motor: law= is missing; pass the angle",
        ),
        (
            lambda m, d, b: bd.Driver("motor", m.ground.at(0, 0), d.at(0, 0), law="fast"),
            "motor: law must be a number, got 'fast'",
        ),
        (
            lambda m, d, b: bd.PointOnLine("slot", d.at(0, 0), b.end, direction=(0.0, 0.0)),
            "slot: direction must not be zero",
        ),
        (
            lambda m, d, b: bd.PointOnLine("slot", d.at(0, 0), b.end, direction=1.0),
            r"slot: direction must be a pair \(x, y\), got 1.0",
        ),
        (
            lambda m, d, b: bd.Revolute("", m.ground.at(0, 0), d.at(0, 0)),
            "Revolute: the name must be a non-empty string, got ''",
        ),
        (
            lambda m, d, b: bd.Weld("w", m.ground.at(0, 0), bd.PointMass("p", 1, at=(0, 0)).point),
            r"w: p at \(0, 0\) is a particle without an angle",
        ),
        (
            lambda m, d, b: bd.Driver(
                "w", bd.PointMass("p", 1, at=(0, 0)).point, d.at(0, 0), law=0
            ),
            r"w: p at \(0, 0\) is a particle without an angle",
        ),
        (lambda m, d, b: d.at(np.nan, 0.0), "disk: point x must be finite, got nan"),
        (lambda m, d, b: m.ground.at("left", 0.0), "ground: point x must be a number, got 'left'"),
    ],
)
def test_error_messages(make, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        make(*parts())


def test_hand_rounded_coordinates_meet():
    _, disk, beam = parts()
    x, y = TIP
    joint = bd.Revolute("pin", disk.at(round(x, 7), round(y, 7)), beam.end)
    assert joint.reaction.columns == (("Fx", "N"), ("Fy", "N"))
