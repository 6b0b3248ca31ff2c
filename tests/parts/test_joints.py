"""Joints, links, gears, drivers, disks and skates: closed forms, levels and reactions."""

import numpy as np
import pytest
from benchmarks.mechanism_cases import slider_on_rod
from conformance import IDA_FORMS, JOINTS, NONHOLONOMIC, TIP, integrators, tuned
from mechanisms import EARTH
from numpy.testing import assert_allclose
from support import (
    ARC,
    EXACT_VARIANT,
    VARIANTS,
    NumericEquations,
)
from test_friction import run

import beamdae as bd


def simulate(mech, t_end=0.5):
    """Return a run, and the final velocities by their names."""
    solution = bd.simulate(mech, bd.Radau(1e-9), t_end=t_end)
    return solution, dict(zip(solution.equations.q_names, solution.v[-1], strict=True))


def test_a_slider_keeps_its_offset_and_its_angle():
    """x'' = omega^2 x along the axis; across it F = 2 m omega x' - m omega^2 d."""
    omega, distance, offset, mass = 2.0, 0.3, 0.2, 0.4
    solution, _ = simulate(slider_on_rod(rate=omega, distance=distance, offset=offset))
    x, rate = distance * np.cosh(omega * solution.t), omega * distance * np.sinh(omega * solution.t)
    place = solution.q[:, 3:5]
    assert_allclose(np.hypot(*place.T), np.hypot(x, offset), rtol=1e-7)
    force = 2.0 * mass * omega * rate - mass * omega**2 * offset
    assert_allclose(solution["guide.F"], force, atol=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["left", "right"])
def test_rack_and_pinion(side):
    """A moment M on a pinion drives a rack of mass m: a = (M / r) / (m + J / r^2)."""
    radius, inertia, mass, moment = 0.25, 0.04, 1.7, 0.9
    mech = bd.Mechanism()
    pinion = mech.add(bd.RigidBody("pinion", 1.0, inertia, (0.0, side * radius)))
    rack = mech.add(bd.RigidBody("rack", mass, 0.1, (0.4, -0.1)))
    center = (0.0, side * radius)
    mech.add(bd.Revolute("bearing", mech.ground.at(*center), pinion.at(*center)))
    mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.0), rack.at(0.4, 0.0)))
    teeth = bd.RackAndPinion("teeth", pinion.at(*center), rack.at(0.0, 0.0), side * radius)
    mech.add(teeth)
    mech.add(bd.Moment("motor", pinion.at(*center), moment))
    mech.observe("teeth", teeth.reaction)
    mech.observe("on pinion", teeth.reaction_on("a"))
    solution, velocities = simulate(mech)
    acceleration = side * moment / radius / (mass + inertia / radius**2)
    assert_allclose(velocities["rack.x"], 0.5 * acceleration, rtol=1e-8)
    force = mass * acceleration
    assert_allclose(solution["teeth.F"], force, rtol=1e-7)
    assert_allclose(solution["on pinion.M"], -side * radius * force, rtol=1e-7)


def test_a_parallelogram_of_links_keeps_its_coupler_level():
    """The coupler of a parallelogram moves along circles without rotation."""
    mech = bd.Mechanism(gravity=EARTH)
    coupler = mech.add(bd.RigidBody("coupler", 2.0, 0.3, (1.0, -0.5)))
    for name, x in (("left", 0.0), ("right", 1.0)):
        end = coupler.at(x + 0.3, -0.4)
        mech.add(bd.Distance(name, mech.ground.at(x, 0.0), end, length=0.5))
    mech.observe("coupler", coupler.at(1.0, -0.5))
    solution = bd.simulate(mech, bd.Ida(rtol=1e-6), t_end=1.0)
    observed = solution.observed
    # Positions drift by 1e-8 m.
    assert_allclose(observed["coupler.angle [rad]"], 0.0, atol=1e-6)
    x, y = (observed[f"coupler.{c} [m]"] for c in ("x", "y"))
    assert_allclose(np.hypot(x - 0.7, y + 0.1), 0.5, atol=1e-6)
    assert np.ptp(x) > 0.5


def test_force_and_power_of_a_prescribed_travel():
    """F = m a and P = F v of a prescribed travel along an inclined line."""
    mass, angle = 1.4, 0.6
    along = (np.cos(angle), np.sin(angle))
    mech = bd.Mechanism()
    cart = mech.add(bd.RigidBody("cart", mass, 0.2, (0.5, 0.1)))
    places = (mech.ground.at(0.2, 0.1), cart.at(0.5, 0.1))
    mech.add(bd.Prismatic("rail", *places, direction=along))
    motor = mech.add(bd.TranslationalDriver("motor", *places, bd.sine(0.4, 0.5), along))
    mech.observe("motor", motor.drive)
    solution, _ = simulate(mech)
    phase = np.pi * solution.t
    force = -mass * 0.4 * np.pi**2 * np.sin(phase)
    assert_allclose(solution["motor.F"], force, atol=1e-6)
    assert_allclose(solution["motor.power"], force * 0.4 * np.pi * np.cos(phase), atol=1e-6)
    assert_allclose(solution.q[:, 0] - 0.5, 0.4 * np.sin(phase) * along[0], atol=1e-8)


# Joints: constraint levels along motions and virtual work of reactions.

TANGENT, CHORD = VARIANTS[0], VARIANTS[2]


def parts(variant=TANGENT):
    """Return a mechanism with a disk and a beam that are not connected, and both bodies."""
    mech = bd.Mechanism(gravity=(0.2, -1.5))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(variant.beam(ARC))
    return mech, disk, beam


# Joints between points of bodies; for sliders on beams see test_beam_contact.
OF_POINTS = {x: make for x, make in JOINTS.items() if not x.startswith("sliding")} | NONHOLONOMIC
every_joint_of_points = pytest.mark.parametrize("make", OF_POINTS.values(), ids=list(OF_POINTS))
every_frame = pytest.mark.parametrize(
    "variant",
    [TANGENT, EXACT_VARIANT, pytest.param(CHORD, marks=pytest.mark.slow(reason="several runs"))],
    ids=["tangent", "exact", "chord"],
)


def jointed(make, variant=TANGENT):
    mech, disk, beam = parts(variant)
    joint = mech.add(make(mech, disk, beam))
    mech.observe("reaction", joint.reaction)
    return NumericEquations(mech), mech


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


def test_hand_rounded_coordinates_meet():
    _, disk, beam = parts()
    x, y = TIP
    joint = bd.Revolute("pin", disk.at(round(x, 7), round(y, 7)), beam.end)
    assert joint.reaction.columns == (("Fx", "N"), ("Fy", "N"))


@pytest.mark.parametrize("ground_first", [True, False])
def test_weld_carries_a_hanging_weight(ground_first):
    """Mass 2 kg with its center 1.5 m off the weld: force m g up, moment m g 1.5 m."""
    mech = bd.Mechanism(gravity=EARTH)
    arm = mech.add(bd.RigidBody("arm", mass=2.0, inertia=0.3, center=(1.5, 0.0)))
    ends = [mech.ground.at(0.0, 0.0), arm.at(0.0, 0.0)]
    weld = mech.add(bd.Weld("wall", *(ends if ground_first else ends[::-1])))
    mech.observe("wall", weld.reaction)
    reaction = bd.simulate(mech, bd.Radau(), t_end=0.1).observed.iloc[-1]
    sign = 1.0 if ground_first else -1.0
    assert_allclose(reaction, sign * 2.0 * 9.81 * np.array([0.0, 1.0, 1.5]), atol=1e-9)


# Rolling disks and skates: closed forms and levels along motions.

MASS, INERTIA = 1.3, 0.4

# Chaplygin's sleigh: the blade is ARM behind the center of mass. With J = I + m ARM^2 the speed
# along it is SPIN sqrt(J/m) tanh(k t), the angular velocity SPIN / cosh(k t), k = ARM SPIN
# sqrt(m/J), and the side force m (v w)(I/J).
ARM, SPIN = 0.3, 2.0
ROOTED = INERTIA + MASS * ARM**2


def sleigh(turn=0.0, at=(0.0, 0.0)):
    c, s = np.cos(turn), np.sin(turn)
    center = (at[0] + c * ARM, at[1] + s * ARM)
    speed = (-s * ARM * SPIN, c * ARM * SPIN)
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sleigh", MASS, INERTIA, center, speed, SPIN))
    skate = mech.add(bd.Skate("skate", body.at(*at), direction=(c, s)))
    mech.observe("blade", body.at(*at))
    mech.observe("side", skate.reaction)
    return mech


def sleigh_motion(t):
    """Return angle, angular velocity and side force."""
    k = ARM * SPIN * np.sqrt(MASS / ROOTED)
    rate = SPIN / np.cosh(k * t)
    speed = SPIN * np.sqrt(ROOTED / MASS) * np.tanh(k * t)
    angle = 2.0 * SPIN / k * np.arctan(np.tanh(0.5 * k * t))
    return angle, rate, MASS * INERTIA / ROOTED * speed * rate


@pytest.mark.parametrize("formulation", ["index3", "stabilized-index2"])
@pytest.mark.parametrize("rho_inf", [0.9, 0.0])
def test_generalized_alpha_is_of_second_order(formulation, rho_inf):
    def errors(steps):
        step = 2.0 / steps
        integrator = bd.GeneralizedAlpha(
            step=step, newton_tolerance=1e-10, formulation=formulation, rho_inf=rho_inf
        )
        solution = run(sleigh(), integrator, 2.0, step)
        angle, rate, force = sleigh_motion(solution.t)
        off = solution.q[:, 2] - angle, solution.v[:, 2] - rate, -solution.lam[:, 0] - force
        return np.max(np.abs(off), axis=1)

    # Terms of the next order are visible for rho_inf = 0.
    assert_allclose(np.log2(errors(200) / errors(400)), 2.0, rtol=0.0, atol=0.05)


@pytest.mark.parametrize(
    "integrator",
    [pytest.param(x, id=name) for name, x in tuned(1e-7, 1e-3, also=IDA_FORMS).items()],
)
def test_chaplygin_sleigh(integrator):
    solution = run(sleigh(), integrator, 4.0, 0.1)
    angle, rate, force = sleigh_motion(solution.t)
    # Errors of Ida with error control of positions are 8e-6, 4e-6 and 5e-4; those of
    # generalized-alpha at this step are 8e-7, 4e-7 and 3e-5.
    assert_allclose(solution.q[:, 2], angle, rtol=0.0, atol=2e-5)
    assert_allclose(solution.v[:, 2], rate, rtol=0.0, atol=1e-5)
    assert_allclose(solution.columns["side.F [N]"], force, rtol=0.0, atol=1e-3)
    assert solution.quality.max_position_drift == 0.0


@integrators(1e-7, 1e-3)
def test_disk_rolls_down_an_incline(integrator):
    """a = g sin(slope) / (1 + I/(m r^2)), on either side of the line."""
    radius, slope_angle, gravity = 0.3, 0.4, 9.81
    direction = np.array([np.cos(slope_angle), -np.sin(slope_angle)])
    normal = np.array([np.sin(slope_angle), np.cos(slope_angle)])
    rate = gravity * np.sin(slope_angle) / (1.0 + INERTIA / (MASS * radius**2))
    for along in (1.0, -1.0):
        mech = bd.Mechanism(gravity=(0.0, -gravity))
        center = tuple((radius * normal + 0.7 * direction).tolist())
        disk = mech.add(bd.RigidBody("disk", MASS, INERTIA, center))
        rolling = bd.RollingOnLine(
            "r", mech.ground.at(0, 0), disk.at(*center), radius, tuple(along * direction)
        )
        mech.observe("r", mech.add(rolling).reaction)
        solution = run(mech, integrator, 1.0, 0.25)
        travel = 0.5 * rate * solution.t**2
        # Methods of all orders reproduce a parabola up to rtol.
        assert_allclose((solution.q[:, :2] - center) @ direction, travel, rtol=0.0, atol=1e-7)
        assert_allclose(solution.q[:, 2], -travel / radius, rtol=0.0, atol=1e-6)
        reactions = [MASS * gravity * np.cos(slope_angle), -INERTIA * rate / radius**2]
        forces = [solution.columns["r.Fn [N]"], solution.columns["r.Ft [N]"]]
        assert_allclose(along * np.array(forces).T, np.tile(reactions, (5, 1)), rtol=1e-5)


def test_two_perpendicular_skates_fix_a_point():
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("body", 1.0, 0.1, velocity=(1.0, 1.0), angular_velocity=0.5))
    for name, direction in (("first", (1.0, 0.0)), ("second", (0.0, 1.0))):
        mech.add(bd.Skate(name, body.at(0.2, 0.0), direction))
    mech.observe("held", body.at(0.2, 0.0))
    solution = run(mech, bd.Radau(1e-6), 1.0, 0.5).columns
    # The form constrains the velocities of the point; its position is their integral.
    assert_allclose(solution["held.x [m]"], 0.2, rtol=0.0, atol=1e-6)
    assert_allclose(solution["held.y_dot [m/s]"], 0.0, rtol=0.0, atol=1e-8)
    mech.add(bd.Skate("third", body.at(0.2, 0.0), (1.0, 1.0)))
    with pytest.raises(bd.BeamdaeError, match="depend"):
        run(mech, bd.Radau(), 0.1, 0.1)
