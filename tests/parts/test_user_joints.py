"""Joints written by users: reactions, switching by events, drawings and messages."""

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from conformance import integrators
from mechanisms import free_ball
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.symbolic.statements import Variable

GRAVITY = 9.81


@dataclass(frozen=True, eq=False)
class Rod(bd.Joint):
    """Massless rod: g = length - |r_b - r_a|, tension positive."""

    symbol = "link"
    multipliers = (Variable("length", "N"),)
    reactions = ("F",)

    @property
    def gap_parameters(self):
        return (math.dist(self.a.point, self.b.point),)

    @staticmethod
    def gap(t, a, b, length):
        return length - ca.norm_2(b.position - a.position)


@dataclass(frozen=True, eq=False)
class Clamp(bd.Joint):
    """Weld with an angle between the bodies, read from `self`."""

    angle: float = 0.0
    multipliers = (Variable("x", "N"), Variable("y", "N"), Variable("angle", "N m"))
    reactions = ("Fx", "Fy", "M")

    def gap(self, t, a, b):
        return ca.vertcat(b.position - a.position, b.rotation - a.rotation - self.angle)


@dataclass(frozen=True, eq=False)
class Slot(bd.Joint):
    """Horizontal slot in the body of a, with friction."""

    multipliers = (Variable("y", "N"),)
    reactions = ("F",)
    slide_direction = (1.0, 0.0)

    @staticmethod
    def gap(t, a, b):
        return (b.position - a.position)[1]


@dataclass(frozen=True, eq=False)
class Axle(bd.Joint):
    """Nonholonomic joint: b does not move across the body of a."""

    multipliers = (Variable("side", "N"),)
    reactions = ("F",)

    @staticmethod
    def slip(t, a, b):
        normal = ca.vertcat(-ca.sin(b.rotation), ca.cos(b.rotation))
        return ca.dot(normal, b.velocity - a.velocity)


@dataclass(frozen=True, eq=False)
class Lift(bd.Joint):
    """Height of b over a as a time law."""

    law: object = None
    multipliers = (Variable("height", "N"),)
    reactions = ("F",)

    @property
    def laws(self):
        return (self.law,)

    @staticmethod
    def gap(t, a, b, height):
        return (b.position - a.position)[1] - height


@dataclass(frozen=True, eq=False)
class Midpoint(bd.Joint):
    """Point b stays halfway between a and c."""

    c: bd.results.Attachment = None
    multipliers = (Variable("x", "N"), Variable("y", "N"))
    reactions = ("Fx", "Fy")

    @property
    def points(self):
        return {"a": self.a, "b": self.b, "c": self.c}

    @staticmethod
    def gap(t, a, b, c):
        return b.position - 0.5 * (a.position + c.position)


def hanging(joint):
    """Return a mechanism with a ball of 1 kg below the origin, held by a joint."""
    mech, ball = free_ball((0.0, -1.0), gravity=GRAVITY)
    mech.add(joint("j", mech.ground.at(0.0, 0.0), ball.point))
    return mech


def reaction_at_rest(mech, quantity):
    mech.observe("reaction", quantity)
    table = bd.simulate(mech, bd.Radau(rtol=1e-8), t_end=0.01).observed
    return table.filter(like="reaction").iloc[0].to_numpy()


def test_tension_is_positive_where_the_gap_shrinks_with_the_distance():
    mech = hanging(Rod)
    assert_allclose(reaction_at_rest(mech, mech.part("j").reaction), GRAVITY, rtol=1e-9)


@pytest.mark.parametrize(("place", "sign"), [("a", -1.0), ("b", 1.0)])
def test_the_rod_pulls_the_ball_up_and_the_ground_down(place, sign):
    mech = hanging(Rod)
    load = reaction_at_rest(mech, mech.part("j").reaction_on(place))
    assert_allclose(load[:2], [0.0, sign * GRAVITY], rtol=1e-9, atol=1e-9)


def test_a_law_of_time_enters_the_gap_and_drives_the_ball():
    law = bd.piecewise((0.5, lambda t: -1.0 + t**2), lambda t: -0.75 + (t - 0.5))
    mech = hanging(lambda name, a, b: Lift(name, a, b, law))
    solution = bd.simulate(mech, bd.Radau(rtol=1e-8), t_end=1.0)
    assert_allclose(solution["ball.y"].iloc[-1], -0.25, atol=1e-7)
    assert mech.laws == [law]


def test_a_joint_of_three_points_distributes_its_reaction():
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    left, middle, right = (
        mech.add(bd.PointMass(name, 1.0, at=(x, 0.0)))
        for name, x in (("left", -1.0), ("middle", 0.0), ("right", 1.0))
    )
    joint = mech.add(Midpoint("j", left.point, middle.point, right.point))
    mech.add(bd.Force("pull", middle.point, (0.0, -6.0)))
    for place in joint.points:
        mech.observe(place, joint.reaction_on(place))
    observed = bd.simulate(mech, bd.Radau(rtol=1e-8), t_end=0.01).observed.iloc[0]
    # All three points accelerate by 6 N / 3 kg downwards relative to free fall.
    assert_allclose([observed[f"{place}.Fy [N]"] for place in "abc"], [-2.0, 4.0, -2.0], rtol=1e-9)


def test_gaps_of_joints_in_one_mechanism_read_their_own_fields():
    mech, angles = bd.Mechanism(), (0.25, 0.5)
    for angle in angles:
        disk = mech.add(bd.RigidBody(f"disk {angle}", mass=1.0, inertia=0.1))
        mech.add(Clamp(f"j {angle}", mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0), angle))
        mech.observe(f"disk {angle}", disk.at(0.0, 0.0))
    with pytest.warns(bd.BeamdaeWarning, match="the joints are not closed"):
        run = bd.simulate(mech, bd.Radau(), t_end=0.1)
    assert_allclose([run[f"disk {x}.angle"].iloc[-1] for x in angles], angles, rtol=1e-9)


def test_a_nonholonomic_joint_constrains_velocities_alone():
    mech = bd.Mechanism()
    body = bd.RigidBody("sled", mass=1.0, inertia=0.1, velocity=(1.0, 0.0), angular_velocity=1.0)
    sled = mech.add(body)
    mech.add(Axle("j", mech.ground.at(0.0, 0.0), sled.at(0.0, 0.0)))
    mech.observe("sled", sled.at(0.0, 0.0))
    solution = bd.simulate(mech, bd.Radau(rtol=1e-8), t_end=math.pi / 2.0)
    # The path is a circle of radius 1 m.
    end = solution.observed.iloc[-1]
    assert_allclose(end[["sled.x [m]", "sled.y [m]"]].to_numpy(float), [1.0, 1.0], atol=1e-6)


def test_friction_acts_along_the_slide_direction():
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    block = mech.add(bd.RigidBody("block", mass=2.0, inertia=0.1, velocity=(1.0, 0.0)))
    slot = mech.add(Slot("slot", mech.ground.at(0.0, 0.0), block.at(0.0, 0.0)))
    mech.add(bd.Friction("rub", slot, 0.3, friction_speed=1e-4))
    mech.observe("block", block.at(0.0, 0.0))
    solution = bd.simulate(mech, bd.Radau(rtol=1e-8), t_end=0.1)
    assert_allclose(solution["block.x_dot"].iloc[-1], 1.0 - 0.3 * GRAVITY * 0.1, rtol=1e-6)


@pytest.mark.parametrize("joint", [Rod, Clamp])
def test_a_joint_activated_as_it_is_keeps_its_gap(joint):
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    disk = mech.add(bd.RigidBody("disk", mass=1.0, inertia=0.1, center=(0.0, -1.0)))
    pin = mech.add(joint("j", mech.ground.at(0.0, 0.0), disk.at(0.0, -1.0)))
    mech.deactivate(pin)
    mech.observe("disk", disk.at(0.0, -1.0))
    mech.when("disk.y", -1.5, "down", bd.activate(pin, as_is=True), name="catch")
    solution = bd.simulate(mech, bd.Radau(rtol=1e-8), t_end=0.6)
    assert list(solution.events["event"]) == ["catch"]
    assert_allclose(solution["disk.y"].iloc[-1], -1.5, atol=1e-6)


def test_rolling_on_a_circle_can_be_activated_as_it_is():
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    disk = mech.add(bd.RigidBody("disk", mass=1.0, inertia=0.1, center=(0.0, 1.5)))
    contact = bd.RollingOnCircle("roll", mech.ground.at(0.0, 0.0), disk.at(0.0, 1.5), (1.0, 0.5))
    mech.add(contact)
    mech.deactivate(contact)
    mech.observe("disk", disk.at(0.0, 1.5))
    mech.when("disk.y", 1.4, "down", bd.activate(contact, as_is=True), name="touch")
    solution = bd.simulate(mech, bd.Radau(rtol=1e-8), t_end=0.3)
    distance = np.hypot(solution["disk.x"], solution["disk.y"]).iloc[-1]
    assert_allclose(distance, 1.4, atol=1e-6)


def test_a_user_joint_is_drawn_with_its_symbol():
    figure = hanging(Rod).draw()
    assert figure is not None

    class Misspelled(Rod):
        symbol = "lnk"

    with pytest.raises(
        bd.BeamdaeError, match=r"Misspelled: symbol must be one of .*'link'.*, got 'lnk'"
    ):
        hanging(Misspelled).draw()


def test_incomplete_joints_are_rejected_with_what_they_lack():
    class Gapless(bd.Joint):
        multipliers = (Variable("x", "N"),)
        reactions = ("F",)

    class Nameless(Rod):
        reactions = bd.Joint.reactions
        multipliers = bd.Joint.multipliers

    with pytest.raises(bd.BeamdaeError, match=r"^j: Gapless has no constraint; define gap"):
        bd.equations_of_motion(hanging(Gapless))
    with pytest.raises(
        bd.BeamdaeError, match=r"^j: Nameless has no multipliers; define a Variable"
    ):
        bd.equations_of_motion(hanging(Nameless))
    with pytest.raises(bd.BeamdaeError, match=r"^j: Nameless has no reactions; define a column"):
        _ = hanging(Nameless).part("j").reaction
    with pytest.raises(bd.BeamdaeError, match="place must be one of"):
        hanging(Rod).part("j").reaction_on("c")


@pytest.mark.parametrize(
    ("gap", "message"),
    [
        (lambda t, a, b: [b.position[0]], "j: constraint must be a CasADi SX column, got list"),
        (lambda t, a, b: b.position, r"j: constraint must have shape \(1, 1\), got \(2, 1\)"),
        (lambda t, a, b: ca.SX.sym("z"), "j: constraint must not depend on z"),
        (lambda t, a, b: b.velocity, r"j: constraints\(\) failed: .* no attribute 'velocity'"),
        (lambda t, a: a.rotation, r"j: constraints\(\) failed: TypeError: .*arguments"),
    ],
)
def test_gaps_of_the_wrong_kind_are_rejected(gap, message):
    # Once signals existed, lists ended in an error of CasADi.
    signal = bd.Mechanism().input("signal")
    joint = type("Wrong", (Rod,), {"gap": staticmethod(gap), "gap_parameters": ()})
    with pytest.raises(bd.BeamdaeError, match=f"^{message}"):
        bd.equations_of_motion(hanging(joint))
    assert signal.name == "signal"


@dataclass(frozen=True, eq=False)
class Conveyor(bd.Joint):
    """Nonholonomic joint: b moves along x with 0.5 sin(3 t) m/s, or with the square of it."""

    power: int = 1
    multipliers = (Variable("drive", "N"),)
    reactions = ("F",)

    def slip(self, t, a, b):
        return b.velocity[0] ** self.power - 0.5 * ca.sin(3.0 * t)


PULLED_MASS = 1.3


def pulled_body(power=1):
    """Return a body under gravity along x, and the joint that prescribes its velocity."""
    mech = bd.Mechanism(gravity=(GRAVITY, 0.0))
    body = mech.add(bd.RigidBody("body", PULLED_MASS, 0.4))
    mech.add(Conveyor("j", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0), power))
    return mech


def pull_of(t):
    """Return the multiplier of the joint, g m - m x''."""
    return PULLED_MASS * (GRAVITY - 0.5 * 3.0 * np.cos(3.0 * t))


@integrators(1e-8, 1e-3)
def test_a_prescribed_velocity_does_work(integrator):
    """Its work is the kinetic energy and the lift."""
    solution = bd.simulate(pulled_body(), integrator, 2.0, 0.25)
    assert solution.status.success, solution.status.sentence
    x = 0.5 / 3.0 * (1.0 - np.cos(3.0 * solution.t))
    # Generalized-alpha is of second order in a step of 1e-3 s.
    assert_allclose(solution.q[:, 0], x, rtol=0.0, atol=2e-6)
    assert_allclose(solution.lam[:, 0], pull_of(solution.t), rtol=0.0, atol=2e-3)
    kinetic = 0.5 * PULLED_MASS * (0.5 * np.sin(3.0 * solution.t)) ** 2
    work = kinetic - PULLED_MASS * GRAVITY * x
    assert_allclose(solution.energies["energy.work_of_drivers [J]"], work, rtol=0.0, atol=1e-4)


def test_slips_must_be_linear_in_velocities():
    with pytest.raises(bd.BeamdaeError, match="must be linear in the velocities"):
        bd.equations_of_motion(pulled_body(power=2))
