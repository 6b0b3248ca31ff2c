"""Warnings about contacts whose sliding speed is below the regularization of their friction."""

import math
import re
import warnings

import casadi as ca
import numpy as np
import pytest
from belts import block_on_belt

import beamdae as bd


def glass(friction_speed, speed=0.3, push=0.0, friction=0.2):
    """Return a glass that rests on a table and slides or is pushed."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mass = mech.add(bd.PointMass("mass", 0.3, at=(0.0, 0.0), velocity=(speed, 0.0)))
    table = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"friction": friction, "friction_speed": friction_speed}
    mech.add(bd.Contact("glass", mass.point, table, 1e6, **law))
    mech.add(bd.Force("push", mass.point, (push, 0.0)))
    mech.observe("mass", mass.point)
    return mech


def simulate_quietly(mech, **settings):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="push: ")
        return bd.simulate(mech, **settings)


@pytest.mark.parametrize("integrator", [bd.Auto(), bd.Radau(), bd.GeneralizedAlpha(step=1e-3)])
def test_regression_friction_below_its_law_is_reported(integrator):
    """A glass that slid at 0.3 m/s with friction_speed=1.0 kept sliding without a warning."""
    message = (
        r"glass: it slides over a distance that is wrong by about 3\d0 %, because friction_speed "
        r"is 1 m/s, below which the part creeps; use friction_speed=0.0015."
    )
    with pytest.warns(bd.BeamdaeWarning, match=message):
        bd.simulate(glass(1.0, push=0.01), integrator, t_end=0.5)


@pytest.mark.parametrize(
    "settings",
    [
        {"friction_speed": 1e-3},
        # Slides during the first 0.15 s and rests afterwards.
        {"friction_speed": 1e-3, "push": 0.01},
        # Sticks, with creep over less than a millimeter.
        {"friction_speed": 1e-3, "speed": 0.0, "push": 0.3},
        {"friction_speed": 1.0, "friction": 0.0},
        # Rests without any tangential force.
        {"friction_speed": 1.0, "speed": 0.0},
    ],
)
def test_sliding_sticking_and_resting_contacts_carry_no_warning(settings):
    run = simulate_quietly(glass(**settings), t_end=0.5)
    assert not any("friction_speed" in sentence for sentence in run.warnings)


def slider(regularization, load, radius=None, **peak):
    """Return a block in a guide, or in a bearing with `radius`, loaded by a constant force."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    body = mech.add(bd.RigidBody("body", 2.0, 0.1, (0.0, 0.0)))
    ends = mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)
    joint = bd.PointOnLine("joint", *ends) if radius is None else bd.Revolute("joint", *ends)
    mech.add(joint)
    mech.add(bd.Friction("rub", joint, 0.3, regularization, radius=radius, **peak))
    on = body.at(0.0, 0.0)
    mech.add(bd.Force("load", on, (load, 0.0)) if radius is None else bd.Moment("load", on, load))
    mech.observe("body", on)
    return mech


def friction_warnings(mech, **settings):
    run = simulate_quietly(mech, **settings)
    return [x for x in run.warnings if x.startswith(("rub: ", "glass: "))]


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("integrator", [bd.Auto(), bd.GeneralizedAlpha(step=2e-3)])
@pytest.mark.parametrize(
    ("mech", "message"),
    [
        (
            slider(0.02, 3.0),
            "rub: the load is 51 % of coefficient N, so that friction should hold it, but it "
            "creeps over 0.0224 m",
        ),
        # The sliding speed is above the regularization.
        (
            slider(0.5, 5.3),
            "of coefficient N, so that friction should hold it, but it creeps over 1.1",
        ),
        # Loads above 95 % of the friction had no warning.
        (slider(0.01, 0.99 * 0.3 * 2.0 * 9.81), "the load is 99 % of coefficient N, so that fric"),
        (slider(2e-3, 0.05, radius=0.02), "but it creeps over 0.0863 rad"),
        (
            glass(0.5, speed=0.0, push=0.3),
            "% of friction N, so that friction should hold it, but it creeps over 0.47",
        ),
    ],
    ids=["guide", "near the limit", "at the limit", "bearing", "contact"],
)
def test_regression_loads_below_the_friction_that_creep_are_reported(mech, message, integrator):
    """Joints crept without a warning; those of contacts named a reduced friction as the cause."""
    (sentence,) = friction_warnings(mech, integrator=integrator, t_end=2.0)
    assert message in sentence


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize(
    ("regularization", "load", "message"),
    [
        (0.02, 3.0, "so that friction should hold it, but it creeps over"),
        (0.1, 8.0, "it slides over a distance that is wrong by about 8 %"),
    ],
)
def test_regression_inactive_joints_prescribe_no_sliding(regularization, load, message):
    """Sliding was prescribed by a lock that is not active, so that no load could be the cause."""
    mech = slider(regularization, load)
    body = mech.parts["body"]
    mech.deactivate(mech.add(bd.Revolute("lock", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0))))
    (sentence,) = friction_warnings(mech, t_end=2.0)
    assert message in sentence


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize(
    "mech",
    [slider(1e-3, 3.0), slider(1e-3, 8.0), slider(1e-4, 0.05, radius=0.02), slider(0.5, 0.0)],
    ids=["sticks", "slides", "bearing", "no load"],
)
def test_joints_that_stick_or_slide_have_no_warning(mech):
    assert not friction_warnings(mech, t_end=1.0)


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_reduced_friction_peaks_are_reported():
    """With equal speeds, half of the static friction was missing without a warning."""
    peak = {"static": 0.6, "stribeck": 0.02}
    (sentence, *_) = friction_warnings(slider(0.02, 8.0, **peak), t_end=0.01)
    assert "coefficient of 0.313 instead of static = 0.6" in sentence
    assert "use friction_speed=0.0001 or less" in sentence
    assert not friction_warnings(slider(0.0001, 8.0, **peak), t_end=0.01)
    (check,) = [
        x for x in bd.check(slider(0.02, 8.0, **peak), t_end=0.01).warnings if "static = 0.6" in x
    ]
    assert check == sentence


def test_friction_speeds_of_contacts_resolve_the_peak():
    body = bd.PointMass("ball", 1.0, at=(0.0, 0.0))
    floor = bd.LineSurface(bd.Mechanism().ground.at(0.0, 0.0))
    law = {"friction": 0.2, "static": 0.4}
    speeds = [
        bd.Contact("c", body.point, floor, 1e6, **law, stribeck=stribeck).friction_speed
        for stribeck in (1e-3, 0.1)
    ]
    assert speeds == [pytest.approx(5e-6), pytest.approx(1e-4)]


def pushed_arm():
    """Return an arm that a carriage pulls, then pushes, with 92 % of the friction that locks it."""
    angle, length, moment, stiffness = math.atan(0.655), 0.04, 0.04, 2e5
    tip = (-length * math.sin(angle), -length * math.cos(angle))
    mech = bd.Mechanism()
    carriage = mech.add(bd.RigidBody("carriage", mass=0.1, inertia=1e-4))
    ends = mech.ground.at(0.0, 0.0), carriage.at(0.0, 0.0)
    mech.add(bd.Prismatic("guide", *ends))

    def position(t):
        return 0.02 * (1.0 - ca.cos(2.0 * math.pi * t))

    mech.add(bd.TranslationalDriver("drive", *ends, position, (1.0, 0.0)))
    arm = mech.add(bd.RigidBody.rod("arm", (0.0, 0.0), tip, mass=0.01))
    pivot = carriage.at(0.0, 0.0), arm.at(0.0, 0.0)
    mech.add(bd.Revolute("pivot", *pivot))
    mech.add(bd.TorsionSpring("press", *pivot, 0.05, preload=-moment))
    depth = moment / (length * math.sin(angle) * stiffness)
    glass = bd.LineSurface(mech.ground.at(0.0, tip[1] + depth))
    law = {"exponent": 1, "restitution": 0.3, "impact_speed": 0.05}
    friction = {"friction": 0.3, "static": 0.6, "stribeck": 5e-3}
    lip = mech.add(bd.Contact("lip", arm.at(*tip), glass, stiffness, **law, **friction))
    mech.observe("lip", lip.force)
    return mech


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_friction_near_self_locking_is_accurate_by_default():
    """A twentieth of the Stribeck velocity changed forces by 17 % without a warning."""
    run = bd.simulate(pushed_arm(), t_end=0.53)
    # With friction_speed=2.5e-7, the largest force is 23.72 N.
    assert run.step_extremes["lip.N"].max == pytest.approx(23.57, rel=2e-3)


def drag(speed):
    """Return a driver of a block, and no other load."""
    return lambda mech, block: bd.TranslationalDriver(
        "drag", mech.ground.at(0.0, 0.0), block.point, lambda t: speed * t
    )


def push(law):
    """Return a load on a block, as a function of its mechanism and of the block."""
    return lambda mech, block: bd.Force("push", block.point, (law, 0.0))


@pytest.mark.parametrize(
    ("load", "is_reported"),
    [
        # 64 % and 38 % of friction N: the block vibrates by 5e-5 m, or creeps over 2 mm.
        (push(lambda t: 5.0 * ca.sin(60.0 * t)), False),
        (push(3.0), False),
        # Slides over 1 mm with a fifth of the friction.
        (drag(2e-4), True),
    ],
    ids=["vibration", "creep", "driver"],
)
def test_regression_contacts_that_stick_carry_no_warning(load, is_reported):
    # The slip was summed without its sign, so that every contact moved in long runs.
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    block = mech.add(bd.PointMass("block", 2.0, at=(0.0, 0.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"restitution": 0.5, "impact_speed": 0.1, "friction": 0.4, "friction_speed": 1e-3}
    mech.add(bd.Contact("floor", block.point, floor, 1e6, **law))
    mech.add(load(mech, block))
    mech.observe("block", block.point)
    run = simulate_quietly(mech, t_end=5.0)
    assert any("friction_speed" in x for x in run.warnings) == is_reported


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize(
    ("speed", "spring", "error"),
    # Against friction_speed=1e-5, the first distance is off by 10 %, and the forces of the spring
    # by 24 % and 3.4 % of friction N.
    [
        (0.01, 200.0, "it slides over a distance that is wrong by about 9."),
        (0.1, 200.0, None),
        (0.005, None, None),
    ],
    ids=["slow", "fast", "prescribed"],
)
def test_regression_creep_at_reversals_is_reported(speed, spring, error):
    """The force of a spring that friction should hold relaxed without a warning."""
    mech = bd.Mechanism(gravity=(0.0, -10.0))
    block = mech.add(bd.PointMass("block", 1.0, at=(0.0, -1e-5)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"exponent": 1.0, "friction": 0.3, "friction_speed": 1e-3}
    mech.add(bd.Contact("floor", block.point, floor, 1e6, **law))
    origin, pulled = mech.ground.at(0.0, -1e-5), block
    if spring is not None:
        origin = mech.ground.at(-1.0, -1e-5)
        pulled = mech.add(bd.PointMass("base", 0.1, at=(-1.0, -1e-5)))
        mech.add(bd.PointOnLine("rail", origin, pulled.point))
        ends = pulled.point, block.point
        mech.add(bd.SpringDamper("spring", *ends, stiffness=spring, damping=2.0))

    def position(t):
        return 0.05 * ca.sin(speed / 0.05 * t)

    mech.add(bd.TranslationalDriver("drive", origin, pulled.point, position, (1.0, 0.0)))
    mech.observe("block", block.point)
    run = bd.simulate(mech, t_end=0.55 / speed)
    reported = [x for x in run.warnings if "use friction_speed=" in x]
    assert len(reported) == (error is not None)
    assert all(f"floor: {error}" in x for x in reported)


def conveyor(friction_speed):
    """Return a block in a trough that vibrates at an angle."""
    mech, angle = bd.Mechanism(gravity=(0.0, -9.81)), np.radians(25.0)
    trough = mech.add(bd.RigidBody.plate("trough", (0.0, 0.0), 0.3, 0.02, mass=5.0))
    ends, axis = (mech.ground.at(0.0, 0.0), trough.at(0.0, 0.0)), (np.cos(angle), np.sin(angle))
    mech.add(bd.Prismatic("guide", *ends, direction=axis))
    law = bd.sine(1e-4, 50.0)
    mech.add(bd.TranslationalDriver("drive", *ends, law, direction=axis))
    block = mech.add(bd.PointMass("block", 0.05, at=(0.0, 0.01)))
    surface = bd.LineSurface(trough.at(0.0, 0.01))
    friction = {"friction": 0.4, "friction_speed": friction_speed}
    law = {"restitution": 0.2, "impact_speed": 0.1}
    mech.add(bd.Contact("rub", block.point, surface, 1e7, **law, **friction))
    mech.observe("block", block.point)
    return mech


def sawtooth(amplitude):
    """Return the law of an inertia drive with 20 Hz: it moves to and fro at different speeds."""
    rate = 40.0 * np.pi

    def law(t):
        return amplitude * (
            1.0 - ca.cos(rate * t) + 0.4 * ca.sin(2.0 * rate * t) - 0.8 * ca.sin(rate * t)
        )

    return law


def inertia_drive(friction_speed):
    """Return a collar that a bar moves by friction."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bar = mech.add(bd.RigidBody("bar", mass=1.0, inertia=1e-3))
    ends = mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0)
    mech.add(bd.Prismatic("guide", *ends))
    mech.add(bd.TranslationalDriver("drive", *ends, sawtooth(6e-4), (1.0, 0.0)))
    collar = mech.add(bd.RigidBody("collar", mass=0.2, inertia=1e-4))
    joint = mech.add(bd.Prismatic("slide", bar.at(0.0, 0.0), collar.at(0.0, 0.0)))
    mech.add(bd.Friction("rub", joint, 0.3, friction_speed, radius=0.02))
    mech.observe("collar", collar.at(0.0, 0.0))
    return mech


def dragged_rotor(friction_speed):
    """Return a rotor that its housing moves by the friction of their bearing."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    housing = mech.add(bd.RigidBody("housing", mass=1.0, inertia=1e-3))
    rotor = mech.add(bd.RigidBody("rotor", mass=1.0, inertia=2e-4))
    ends = mech.ground.at(0.0, 0.0), housing.at(0.0, 0.0)
    mech.add(bd.Revolute("pivot", *ends))
    mech.add(bd.Driver("motor", *ends, sawtooth(0.09)))
    joint = mech.add(bd.Revolute("bearing", housing.at(0.0, 0.0), rotor.at(0.0, 0.0)))
    mech.add(bd.Friction("rub", joint, 0.15, friction_speed, radius=0.01))
    mech.observe("rotor", rotor.at(0.0, 0.0))
    return mech


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize(
    # Errors of the distance beside a thirtieth of friction_speed [%]
    ("build", "friction_speed", "error"),
    [
        (conveyor, 0.1, 77.9),
        (conveyor, 1e-2, 25.9),
        (conveyor, 5e-3, 8.5),
        (conveyor, 2e-3, None),
        (conveyor, 1e-3, None),
        (inertia_drive, 0.1, 44.3),
        (inertia_drive, 1e-2, 7.4),
        (inertia_drive, 3e-4, None),
        (dragged_rotor, 0.1, 23.8),
        (dragged_rotor, 1e-3, None),
    ],
)
def test_regression_errors_of_distances_by_creep_are_reported(build, friction_speed, error):
    """Creep was compared with the way to and fro, and not at all if it never ended."""
    run = bd.simulate(build(friction_speed), t_end=0.1)
    reported = [x for x in run.warnings if x.startswith("rub: it slides")]
    assert len(reported) == (error is not None)
    for sentence in reported:
        match = re.search(r"slides over a distance that is wrong by about (\S+) %", sentence)
        assert float(match[1]) == pytest.approx(error, rel=0.15)


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_parts_that_slide_together_have_a_higher_limit_of_errors():
    """Two blocks on a spring slide over distances that are wrong by 1.4 %, estimated as 10 %."""
    mech = bd.Mechanism(gravity=(0.0, -10.0))
    blocks = []
    for name, x in (("a", 0.0), ("b", -0.3)):
        block = mech.add(bd.PointMass(name, 1.0, at=(x, 0.0)))
        guide = mech.add(bd.PointOnLine(f"guide {name}", mech.ground.at(0.0, 0.0), block.point))
        mech.add(bd.Friction(f"rub {name}", guide, 0.3, 1e-2))
        blocks.append(block)
    ends = blocks[0].point, blocks[1].point
    mech.add(bd.SpringDamper("spring", *ends, stiffness=300.0, damping=1.0))
    mech.add(bd.Force("push", blocks[1].point, (lambda t: 8.0 * ca.sin(3.0 * t), 0.0)))
    mech.observe("a", blocks[0].point)
    run = bd.simulate(mech, t_end=4.0)
    assert not any("friction_speed" in x or "regularization" in x for x in run.warnings)


def block_on_incline(friction_speed, speed=0.0):
    """Block on an incline of 20 degrees, which friction holds at 73 % of its limit."""
    slope = math.radians(20.0)
    along = (math.cos(slope), math.sin(slope))
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    velocity = (speed * along[0], speed * along[1])
    block = mech.add(bd.PointMass("block", 2.0, at=(0.0, 0.0), velocity=velocity))
    surface = bd.LineSurface(mech.ground.at(0.0, 0.0), along)
    law = {"friction": 0.5, "friction_speed": friction_speed}
    law |= {"restitution": 0.3, "impact_speed": 0.1}
    mech.add(bd.Contact("glass", block.point, surface, 1e6, **law))
    mech.observe("block", block.point)
    return mech


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_regression_creep_down_an_incline_is_reported(speed):
    """A block crept 9 mm in 10 s, less than 1 % of the length, without a word."""
    (sentence,) = friction_warnings(block_on_incline(1e-3, speed), t_end=10.0)
    if speed:  # slides over 63 mm
        assert "slides over a distance that is wrong by about 14 %" in sentence
    else:
        held = "glass: the load is 72.8 % of friction N, so that friction should hold it, but it "
        assert held + "creeps over 0.009" in sentence
    for accurate in (
        friction_warnings(block_on_incline(1e-5, speed), t_end=10.0),
        friction_warnings(block_on_incline(1e-3, speed), t_end=1.0),
    ):
        assert not accurate


def four_bar(friction_speed, thickness):
    """Return a four-bar with friction in its bearings, an elastic coupler, and a driven crank."""
    steel = bd.Material.of("steel")
    tip, end, pivot = (0.04, 0.0), (0.19, 0.12), (0.19, 0.03)
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), tip, mass=0.05))
    section = bd.Section.rectangle(steel, 0.012, thickness, damping=1e-4)
    coupler = mech.add(bd.Beam("coupler", bd.Line(tip, end), section, elements=2))
    rocker = mech.add(bd.RigidBody.rod("rocker", pivot, end, mass=0.25))
    center = mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)
    joints = {
        "O": center,
        "A": (crank.at(*tip), coupler.start),
        "B": (coupler.end, rocker.at(*end)),
        "C": (mech.ground.at(*pivot), rocker.at(*pivot)),
    }
    for name, ends in joints.items():
        joint = mech.add(bd.Revolute(name, *ends))
        mech.add(bd.Friction(f"rub {name}", joint, 0.15, friction_speed, radius=5e-3))
    mech.add(bd.Driver("motor", *center, lambda t: 2.0 * math.pi * t))
    mech.observe("coupler", coupler.end)
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("thickness", [1e-3, 3e-3])
def test_regression_pins_of_elastic_couplers_are_not_held_by_friction(thickness):
    """A pin that always turned was said to be held, and to creep over 8 rad."""

    def reported(friction_speed):
        run = bd.simulate(four_bar(friction_speed, thickness), t_end=1.5)
        return [x for x in run.warnings if x.startswith("rub ")]

    assert not reported(1e-4)
    # The speeds are at most 0.04 m/s in A and C.
    found = reported(1e-2)
    assert all("its friction is on average" in x for x in found)
    assert all("its friction is on average" in x for x in reported(0.1))


def wiper(friction_speed, **peak):
    """Return a rubber lip that is pressed onto a moving glass."""
    angle, length = math.radians(20.0), 0.014
    tip = (length * math.sin(angle), -length * math.cos(angle))
    mech = bd.Mechanism()
    rubber = bd.Material(E=6e6, nu=0.48, rho=1150.0)
    section = bd.Section.rectangle(rubber, width=0.4, height=2e-3, damping=2e-4)
    lip = mech.add(bd.Beam("lip", bd.Line((0.0, 0.0), tip), section, 4, formulation="exact"))
    holder = mech.add(bd.RigidBody("holder", mass=0.2, inertia=1e-4))
    glass = mech.add(bd.RigidBody("glass", mass=1.0, inertia=1e-2, center=(0.0, tip[1])))
    mech.add(bd.Weld("clamp", holder.at(0.0, 0.0), lip.start))

    def pressing(t):
        return -1.5e-3 * (10.0 * t) ** 2 * (3.0 - 20.0 * t)

    press = bd.piecewise((0.1, pressing), -1.5e-3)
    drive = bd.piecewise(
        (0.1, 0.0), (0.15, lambda t: 0.5 * (t - 0.1) ** 2), lambda t: 0.05 * (t - 0.125)
    )
    for name, body, y, law, along in (
        ("press", holder, 0.0, press, (0.0, 1.0)),
        ("drive", glass, tip[1], drive, (1.0, 0.0)),
    ):
        ends = mech.ground.at(0.0, y), body.at(0.0, y)
        mech.add(bd.Prismatic(f"guide of {name}", *ends, direction=along))
        mech.add(bd.TranslationalDriver(name, *ends, law, direction=along))
    surface = bd.LineSurface(glass.at(0.0, tip[1]))
    law = {"restitution": 0.5, "impact_speed": 0.1, "friction": 0.4}
    contact = bd.Contact(
        "edge", lip.end, surface, 1e8, friction_speed=friction_speed, **law, **peak
    )
    edge = mech.add(contact)
    mech.observe("edge", edge.force)
    return mech


@pytest.mark.slow(reason="two seconds")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_sliding_with_static_friction_is_not_blamed_for_creep():
    """A distance was called wrong by 9 % at any friction_speed; the error was 0.07 %."""
    run = bd.simulate(wiper(5e-5, static=0.7, stribeck=0.03), t_end=0.4)
    assert not any(x.startswith("edge: it slides over") for x in run.warnings)


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_reduced_friction_is_stated_beside_the_error_of_the_distance():
    """A twentieth of the friction was reported as a distance that is wrong by 5.6 %."""
    run = bd.simulate(wiper(1.0), t_end=0.4)
    (sentence,) = [x for x in run.warnings if x.startswith("edge: ")]
    assert re.search(r"and, while it slides, its friction is on average \S+ % of that", sentence)


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_stick_slip_is_not_blamed_for_a_reduced_friction():
    run = bd.simulate(block_on_belt(1000.0, 0.02), t_end=8.0)
    assert np.ptp(run["pad.T"]) > 4.0  # sticks and slips
    assert not any(x.startswith("pad: while it slides") for x in run.warnings)
