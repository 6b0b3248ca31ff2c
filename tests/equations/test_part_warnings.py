"""Warnings about parts that do nothing, never act, start inside a surface or supply energy."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from mechanisms import swing

import beamdae as bd

G = 9.81
STIFFNESS, EXPONENT = 1e6, 1.5
STRIP = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)


def findings(mech, t_end=0.02):
    """Return the warnings of a check; those of a run must be the same."""
    found = bd.check(mech, t_end=t_end, predict=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        solution = bd.simulate(mech, bd.Radau(1e-5), t_end)
    assert [x for x in solution.warnings if x in found.warnings] == list(found.warnings)
    assert all(x in str(found) for x in found.warnings)
    return found.warnings


def world():
    """Return a mechanism under gravity with a ball of 1 kg."""
    return bd.Mechanism(gravity=(0.0, -G))


def rest_depth(force, stiffness=STIFFNESS, exponent=EXPONENT):
    return (force / stiffness) ** (1.0 / exponent)


def on_floor(height, direction=(1.0, 0.0), stiffness=STIFFNESS, scale=1.0, **contact):
    """Return a ball at a height above a floor, in a drawing enlarged by `scale`."""
    mech = world()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, scale * height)))
    floor = bd.LineSurface(mech.ground.at(2.0 * scale, 0.0), direction)
    mech.add(bd.Contact("floor", ball.point, floor, stiffness, **contact))
    return mech


def in_circle(at, side):
    mech = world()
    ball = mech.add(bd.PointMass("ball", 1.0, at=at))
    mech.add(bd.Contact("bowl", ball.point, bd.CircleSurface(mech.ground.at(0, 0), 1.0, side), 1e6))
    return mech


# Starts inside a surface --------------------------------------------------------------------------


@pytest.mark.slow(reason="a second")
def test_a_reversed_floor_is_reported_with_part_depth_and_remedy():
    (sentence,) = findings(on_floor(1.0, (-1.0, 0.0)))
    assert sentence.startswith("floor: ball at (0, 1) starts 1 m inside the surface")
    assert "move the point to the left side of the line, or turn the direction of the" in sentence
    with pytest.warns(bd.BeamdaeWarning, match="floor: ball at .* starts 1 m inside the surface"):
        bd.simulate(on_floor(1.0, (-1.0, 0.0)), t_end=0.01)


@pytest.mark.parametrize("height", [1e-4, 1e-2, 1.0, 1e3])
@pytest.mark.parametrize("stiffness", [1e4, 1e6, 1e9])
def test_deep_starts_are_reported_at_any_depth_and_stiffness(height, stiffness):
    mech = on_floor(-height, stiffness=stiffness)
    is_deep = height > 10.0 * rest_depth(G, stiffness)
    is_shallow = height < 4.0 * rest_depth(G, stiffness)
    # Between these depths, both answers are acceptable.
    if not (is_deep or is_shallow):
        return
    assert bool(bd.check(mech, predict=False).warnings) == is_deep


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(
    ("at", "side", "depth"),
    [((0.0, 0.0), "outside", 1.0), ((0.3, 0.4), "outside", 0.5), ((3.0, 4.0), "inside", 4.0)],
)
def test_points_on_the_wrong_side_of_a_circle_are_reported(at, side, depth):
    (sentence,) = findings(in_circle(at, side))
    assert f"starts {depth:g} m inside the surface" in sentence
    assert f'set side="{"inside" if side == "outside" else "outside"}"' in sentence


def test_a_ball_held_between_two_reversed_surfaces_is_reported():
    mech = world()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    for name, y, x in (("floor", -1.0, -1.0), ("ceiling", 1.0, 1.0)):
        surface = bd.LineSurface(mech.ground.at(0.0, y), (x, 0.0))
        mech.add(bd.Contact(name, ball.point, surface, STIFFNESS))
    assert [x.partition(":")[0] for x in findings(mech)] == ["floor", "ceiling"]


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_beams_inside_a_surface_are_reported_but_not_resting_beams(formulation):
    def lying(height, direction):
        mech = world()
        line = bd.Line((0.0, height), (1.0, height))
        beam = mech.add(bd.Beam("beam", line, STRIP, elements=2, formulation=formulation))
        for name, point in (("left", beam.start), ("right", beam.end)):
            floor = bd.LineSurface(mech.ground.at(0.0, 0.0), direction)
            mech.add(bd.Contact(name, point, floor, STIFFNESS))
        return bd.check(mech, predict=False).warnings

    assert [x.partition(":")[0] for x in lying(1.0, (-1.0, 0.0))] == ["left", "right"]
    weight = STRIP.rhoA * 1.0 * G
    assert lying(-rest_depth(0.5 * weight), (1.0, 0.0)) == ()


@pytest.mark.parametrize("stiffness", [100.0, 1e6, 1e12])
@pytest.mark.parametrize("exponent", [1.0, 1.5, 3.0])
def test_static_penetration_is_not_reported(stiffness, exponent):
    """At 100 N/m, the ball rests 0.1 to 0.5 m inside the surface."""
    depth = rest_depth(G, stiffness, exponent)
    assert findings(on_floor(-depth, stiffness=stiffness, exponent=exponent)) == ()
    mech = on_floor(1e-3, stiffness=stiffness, exponent=exponent)
    mech.start = "equilibrium"
    assert bd.check(mech, predict=False).warnings == ()


@pytest.mark.slow(reason="half a second")
def test_levers_and_springs_press_contacts_into_surfaces():
    """The start is an equilibrium with a contact force of 100 weights."""
    mech = bd.Mechanism(gravity=(0.0, -G), start="equilibrium")
    lever = mech.add(bd.RigidBody("lever", 1.0, 0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("pivot", mech.ground.at(0.0, 0.0), lever.at(0.0, 0.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("stop", lever.at(0.01, 0.0), floor, 1e9))
    assert findings(mech) == ()
    mech = on_floor(-rest_depth(100.0 * G))
    ball = mech.part("ball")
    mech.add(bd.Spring("press", ball.point, mech.ground.at(0.0, -2.0), 1.0, preload=99.0 * G))
    assert findings(mech) == ()


def preloaded_lip(length=0.3, depth=0.003, speed=0.5, stiffness=2000.0, **settings):
    """Return an arm drawn straight, on a turning hub, whose end is pressed into a circle."""
    mech = bd.Mechanism(**settings)
    hub = mech.add(bd.RigidBody("hub", mass=1.0, inertia=0.01))
    center = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("bearing", center, hub.at(0.0, 0.0)))
    mech.add(bd.Driver("drive", center, hub.at(0.0, 0.0), lambda t: speed * t))
    arm = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (0.0, length)), STRIP, elements=2))
    mech.add(bd.Weld("root", hub.at(0.0, 0.0), arm.start))
    circle = bd.CircleSurface(center, length - depth, side="inside")
    mech.add(bd.Contact("lip", arm.end, circle, stiffness, exponent=1.0, friction=0.6))
    return mech


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize("speed", [0.05, 0.5])
def test_elastic_preloads_are_those_of_an_equilibrium(speed):
    """As drawn, the lip is pressed into the circle by more than it bears."""
    assert findings(preloaded_lip(speed=speed, start="equilibrium")) == ()
    (sentence,) = findings(preloaded_lip(speed=speed))
    assert sentence.endswith("bd.Mechanism(start='equilibrium') if it is a preload.")


def test_contacts_that_springs_do_not_hold_are_reported():
    """A spring of 2 N/mm yields to the contact of 200 N/mm, which is less deep at rest."""
    mech = world()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, -0.01)))
    mech.add(bd.Spring("spring", ball.point, mech.ground.at(0.0, 0.99), 2e3))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0), (1.0, 0.0))
    mech.add(bd.Contact("floor", ball.point, floor, 2e5, exponent=1.0))
    (sentence,) = findings(mech)
    assert sentence.endswith(
        "or build the model with bd.Mechanism(start='equilibrium') if it is a preload."
    )


@pytest.mark.slow(reason="a second")
def test_the_weight_of_a_heavy_carrier_does_not_explain_the_penetration_of_a_light_body():
    for mass, is_reported in ((1e-3, True), (1e3, False)):
        mech = world()
        carrier = mech.add(bd.RigidBody("carrier", 1e3, 1.0, center=(0.0, 0.0)))
        ball = mech.add(bd.PointMass("ball", mass, at=(0.0, -1e-2)))
        surface = bd.LineSurface(carrier.at(0.0, 0.0))
        mech.add(bd.Contact("touch", ball.point, surface, STIFFNESS))
        assert bool(findings(mech)) == is_reported


def test_resumed_runs_may_start_in_an_impact():
    mech = on_floor(0.2)
    fall = bd.simulate(mech, bd.Radau(1e-6), t_end=math.sqrt(2.0 * 0.2 / G) + 5e-3)
    assert fall.q[-1, 1] < -9.0 * rest_depth(G)
    assert bd.check(on_floor(fall.q[-1, 1]), predict=False).warnings
    resumed = bd.simulate(mech, bd.Radau(1e-6), t_end=0.25, start=fall)
    assert resumed.warnings == ()


def test_gaps_of_impacts_that_start_negative_are_reported():
    mech = world()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 1.0)))
    for direction, count in (((-1.0, 0.0), 1), ((1.0, 0.0), 1)):
        gap = bd.LineSurface(mech.ground.at(0.0, 0.0), direction).gap(ball.point)
        mech.when(gap, 0.0, "down", bd.impact(gap, 0.5), name=f"bounce {direction[0]:g}")
        sentences = bd.check(mech, predict=False).warnings
        assert len(sentences) == count
        assert sentences[0].startswith("bounce -1: the gap of the impact starts at -1 m, inside")


# Parts that do nothing ----------------------------------------------------------------------------


def hinged_disk():
    mech = world()
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.1, center=(0.5, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0)))
    line = bd.Line((2.0, 0.0), (3.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, STRIP, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(2.0, 0.0), beam.start))
    return mech, disk, beam


IDLE = {
    "Bushing": lambda m, d, b: bd.Bushing("x", m.ground.at(1.0, 0.0), d.at(1.0, 0.0)),
    "SpringDamper": lambda m, d, b: bd.SpringDamper("x", m.ground.at(5.0, 0.0), d.at(1.0, 0.0)),
    "Spring": lambda m, d, b: bd.Spring("x", m.ground.at(5.0, 0.0), d.at(1.0, 0.0)),
    "Damper": lambda m, d, b: bd.Damper("x", m.ground.at(5.0, 0.0), d.at(1.0, 0.0)),
    "TorsionSpring": lambda m, d, b: bd.TorsionSpring("x", d.at(1.0, 0.0), b.end),
    "TorsionDamper": lambda m, d, b: bd.TorsionDamper("x", d.at(1.0, 0.0), b.end),
    "DistributedForce": lambda m, d, b: bd.DistributedForce("x", b, (0.0, 0.0)),
    "MovingForce": lambda m, d, b: bd.MovingForce("x", b, (0.0, -1.0), speed=1.0, start=2.0),
    "ForceLaw": lambda m, d, b: bd.ForceLaw("x", b.end, lambda p, t: (0.0, 0.0 * t)),
    "RayleighDamping": lambda m, d, b: bd.RayleighDamping("x", b),
    "AirDrag": lambda m, d, b: bd.AirDrag("x", b, 0.0),
    "Friction": lambda m, d, b: bd.Friction("x", m.part("hinge"), 0.0, 0.1, radius=0.1),
}
WITHIN = {
    "SpringDamper": lambda d: bd.SpringDamper("x", d.at(0.0, 0.0), d.at(1.0, 0.0), 10.0, 1.0),
    "TorsionSpring": lambda d: bd.TorsionSpring("x", d.at(0.0, 0.0), d.at(1.0, 0.0), 10.0),
    "Bushing": lambda d: bd.Bushing("x", d.at(0.0, 0.0), d.at(1.0, 0.0), kx=10.0),
    "Contact": lambda d: bd.Contact("x", d.at(0.0, 1.0), bd.LineSurface(d.at(0.0, 0.0)), 1e4),
    "inside": lambda d: bd.Contact("x", d.at(0.0, -1.0), bd.LineSurface(d.at(0.0, 0.0)), 1e4),
    "Circle": lambda d: bd.Contact("x", d.at(0.0, 1.0), bd.CircleSurface(d.at(0, 0), 0.1), 1e4),
}


@pytest.mark.parametrize("kind", IDLE)
def test_parts_without_any_force_are_reported(kind):
    mech, disk, beam = hinged_disk()
    mech.add(IDLE[kind](mech, disk, beam))
    (sentence,) = bd.check(mech, predict=False).warnings
    assert sentence.startswith("x: the part exerts no force at any time")


@pytest.mark.parametrize("kind", WITHIN)
def test_parts_within_one_rigid_body_are_reported(kind):
    mech, disk, _ = hinged_disk()
    mech.add(WITHIN[kind](disk))
    (sentence,) = bd.check(mech, predict=False).warnings
    assert sentence.startswith("x: both ends are fixed to disk, so the part does nothing")


def test_parts_that_act_are_not_reported():
    mech, disk, beam = hinged_disk()
    mech.add(bd.Spring("bowstring", beam.start, beam.end, 1e3))
    mech.add(bd.Contact("far", disk.at(0.0, 0.0), bd.LineSurface(mech.ground.at(0.0, -1e6)), 1e4))
    mech.add(bd.MovingForce("wheel", beam, (0.0, -1.0), speed=-1.0, start=3.0))
    mech.add(bd.MovingForce("back", beam, (0.0, -1.0), speed=-1.0, start=1.0))
    mech.add(bd.TorsionSpring("coil", mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0), preload=1.0))
    mech.add(bd.Damper("oil", mech.ground.at(5.0, 0.0), disk.at(1.0, 0.0), damping=1e-6))
    # Loads of zero are inputs of linear models.
    mech.add(bd.Force("input", beam.end, (0.0, 0.0)))
    mech.add(bd.Moment("input moment", beam.end, 0.0))
    assert bd.check(mech, predict=False).warnings == ()


@pytest.mark.slow(reason="a fifth of a second")
def test_loads_outside_the_run_are_reported():
    mech, _, beam = hinged_disk()
    mech.add(bd.MovingForce("wheel", beam, (0.0, -1.0), speed=1.0, start=-2.0))
    late = bd.piecewise((5.0, lambda t: 0.0), lambda t: t - 5.0)
    mech.add(bd.Force("late", beam.end, (late, 0.0)))
    sentences = bd.check(mech, t_end=1.0, predict=False).warnings
    assert [x.partition(";")[0] for x in sentences] == [
        f"{name}: the part exerts no force from t = 0 to 1 s" for name in ("wheel", "late")
    ]
    assert len(bd.check(mech, t_end=2.5, predict=False).warnings) == 1
    assert bd.check(mech, t_end=6.0, predict=False).warnings == ()
    assert bd.check(mech, predict=False).warnings == ()


def test_actions_without_effect_are_reported():
    mech, _, beam = hinged_disk()
    mech.observe("tip", beam.end)
    off, on = (mech.add(bd.Force(name, beam.end, (0.0, 1.0))) for name in ("off", "on"))
    mech.deactivate(off)
    actions = (bd.activate(on), bd.deactivate(off), bd.impact(mech.part("hinge")))
    mech.when("tip.y", -9.0, do=actions, name="e")
    assert [x.partition(",")[0] for x in bd.check(mech, predict=False).warnings] == [
        "off: the part is inactive from the start and no event activates it",
        "e: on is always active",
        "e: off is never active",
        "e: hinge is always active",
    ]
    mech.when("tip.y", -8.0, do=bd.activate(off), name="f")
    assert len(bd.check(mech, predict=False).warnings) == 2


def test_inactive_joints_of_impacts_are_stops():
    mech, disk, _ = hinged_disk()
    mech.observe("disk", disk.at(0.0, 0.0))
    stop = mech.add(bd.Driver("stop", mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0), law=-0.5))
    mech.deactivate(stop)
    (warning,) = bd.check(mech, predict=False).warnings
    assert "stop: the part is inactive from the start" in warning
    mech.when("disk.angle", -0.5, "down", do=bd.impact(stop), name="hit")
    assert bd.check(mech, predict=False).warnings == ()


# Laws that supply energy --------------------------------------------------------------------------


def vibrating(part):
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(1.0, 0.0), velocity=(1.0, 0.0)))
    mech.add(part(mech.ground.at(0.0, 0.0), ball.point))
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_damping_that_supplies_energy_is_reported(sign):
    for part in (
        lambda a, b: bd.SpringDamper("x", a, b, law=lambda e, rate: 50.0 * e + sign * rate),
        lambda a, b: bd.Damper("x", a, b, law=lambda e, rate: sign * np.tanh(rate)),
        lambda a, b: bd.ForceLaw(
            "x", b, lambda p, t: tuple(-sign * v for v in p.velocity), dissipative=True
        ),
    ):
        mech = vibrating(part)
        sentences = bd.check(mech, predict=False).warnings
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bd.BeamdaeWarning)
            solution = bd.simulate(mech, t_end=1.0)
        assert len(sentences) == len(solution.warnings) == (sign < 0.0)
        supplied = -solution.energies["energy.dissipated [J]"].iloc[-1]
        if sign < 0.0:
            assert sentences[0].startswith("x: its law supplies energy at some velocities")
            amount = float(solution.warnings[0].split("supplies ")[1].split(" J")[0])
            # Trapezoidal rule over 200 intervals, printed with three digits.
            assert amount == pytest.approx(supplied, rel=1e-2)


@pytest.mark.slow(reason="a fifth of a second")
def test_laws_at_rest_do_not_supply_energy():
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(1.0, 0.0)))
    law = bd.SpringDamper(
        "x", mech.ground.at(0.0, 0.0), ball.point, law=lambda e, rate: 50.0 * e + rate
    )
    mech.add(law)
    assert findings(mech) == ()


# Start --------------------------------------------------------------------------------------------


def clamped_strip():
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (1.0, 0.0)), STRIP, elements=1))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    return mech


@pytest.mark.parametrize(
    ("build", "speeds", "count"),
    [
        (clamped_strip, {"strip.v2": 0.1, "strip.y0": 1e-17}, 0),
        (clamped_strip, {"strip.v2": 0.1, "strip.y0": 0.1}, 1),
        (swing, {"bob.x": 1e-20}, 0),
        (swing, {"bob.x": 0.1}, 1),
    ],
)
def test_regression_rounding_errors_of_start_velocities_have_no_warning(build, speeds, count):
    # Periodic motions start with the velocities of earlier runs.
    equations = bd.equations_of_motion(build())
    v0 = [speeds.get(name, 0.0) for name in equations.q_names]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        solution = bd.simulate(replace(equations, v0=np.array(v0)), bd.Radau(1e-3), t_end=1e-3)
    assert len([x for x in solution.warnings if "do not allow" in x]) == count


# Drivers without bearings -------------------------------------------------------------------------


def driven_arm(hold, gravity=(0.0, 0.0), formulation="exact"):
    """Return an arm with a driven start and a part that `hold` adds."""
    mech = bd.Mechanism(gravity=gravity)
    curve = bd.Arc(radius=1.2, length=0.5)
    arm = mech.add(bd.Beam("arm", curve, STRIP, elements=2, formulation=formulation))
    mech.add(bd.PointMass("carrier", 0.15, on=arm.end))
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), arm.start, lambda t: 9.0 * t**2))
    for part in hold(mech, arm):
        mech.add(part)
    return mech


def bear(mech, arm):
    yield bd.Revolute("pivot", mech.ground.at(0.0, 0.0), arm.start)


def bear_on_a_cart(mech, arm):
    cart = mech.add(bd.RigidBody("cart", 1.0, 0.1))
    yield bd.Prismatic("rail", mech.ground.at(0.0, 0.0), cart.at(0.0, 0.0))
    yield bd.Revolute("pivot", cart.at(0.0, 0.0), arm.start)


def guide(mech, arm):
    yield bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), arm.start)


def drive_travel(mech, arm):
    for name, direction in (("x", (1.0, 0.0)), ("y", (0.0, 1.0))):
        yield bd.TranslationalDriver(name, mech.ground.at(0.0, 0.0), arm.start, 0.0, direction)


def couple(mech, arm):
    yield bd.Bushing("mount", mech.ground.at(0.0, 0.0), arm.start, kx=1e4, ky=1e4)


def found(mech, arm):
    yield bd.ForceLaw("bed", arm.start, lambda p, t: (-1e3 * p.position[0], -1e3 * p.position[1]))


def control(mech, arm):
    for k, axis in enumerate("xy"):
        force = -1e3 * mech.sensor(axis, arm.start, axis)
        yield bd.Force(f"magnet {axis}", arm.start, (force, 0.0) if k == 0 else (0.0, force))


def meet(mech, arm):
    yield bd.Contact("floor", arm.start, bd.LineSurface(mech.ground.at(0.0, 0.0)), 1e3)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "hold",
    [bear, bear_on_a_cart, guide, drive_travel, couple, found, control, meet],
    ids=lambda hold: hold.__name__,
)
def test_drivers_of_bodies_that_other_parts_hold_have_no_warning(hold):
    assert not findings(driven_arm(hold))


def rub(mech, arm):
    yield bd.ForceLaw("edge", arm.end, lambda p, t: (-p.velocity[0], -p.velocity[1]))


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
@pytest.mark.parametrize("gravity", [0.0, -G])
def test_regression_drivers_without_a_bearing_are_reported(gravity, formulation):
    """An arm that was held in rotation only drifted away."""
    (sentence,) = findings(driven_arm(rub, (0.0, gravity), formulation))
    assert sentence == (
        "motor: it prescribes the rotation of arm relative to ground, but nothing holds arm in "
        "translation; add a joint, such as a Revolute."
    )


@pytest.mark.slow(reason="a quarter of a second")
def test_drivers_between_bodies_of_a_floating_mechanism_need_a_bearing_there():
    mech = bd.Mechanism()
    bus = mech.add(bd.RigidBody("bus", 10.0, 1.0))
    wheel = mech.add(bd.RigidBody("wheel", 1.0, 0.1))
    mech.add(bd.Driver("motor", bus.at(0.0, 0.0), wheel.at(0.0, 0.0), lambda t: t**2))
    (sentence,) = findings(mech)
    assert sentence.startswith("motor: it prescribes the rotation of wheel relative to bus, but")
    mech.add(bd.Revolute("bearing", bus.at(0.0, 0.0), wheel.at(0.0, 0.0)))
    assert not findings(mech)


@pytest.mark.parametrize("coefficient", [3.0, 60.0])
def test_regression_friction_in_percent_is_reported(coefficient):
    """A friction coefficient of 60 had no warning."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    block = mech.add(bd.PointMass("block", 1.0, at=(0.0, 0.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("floor", block.point, floor, 1e5, friction=coefficient))
    warnings = [x for x in bd.check(mech).warnings if "if it is a percentage" in x]
    assert len(warnings) == (coefficient > 5.0)
