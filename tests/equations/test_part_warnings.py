"""Warnings about starts inside a surface, and parts and actions without effect."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mechanisms import cantilever, driven, free_ball, hinged_body, rectangle, swing

import beamdae as bd

G = 9.81
STIFFNESS, EXPONENT = 1e6, 1.5
STRIP = rectangle(0.004)


def findings(mech):
    """Return the warnings of a check; those of a run must be the same."""
    found = bd.check(mech, t_end=0.02, predict=False)
    solution = bd.simulate(mech, bd.Radau(1e-5), t_end=0.02)
    assert [x for x in solution.warnings if x in found.warnings] == list(found.warnings)
    assert all(x in str(found) for x in found.warnings)
    return found.warnings


def ball_at(height, x=0.0, mass=1.0, **settings):
    """Return a mechanism under gravity and its ball."""
    return free_ball((x, height), mass, **{"gravity": G} | settings)


def rest_depth(force, stiffness=STIFFNESS, exponent=EXPONENT):
    return (force / stiffness) ** (1.0 / exponent)


def on_floor(height, direction=(1.0, 0.0), stiffness=STIFFNESS, **contact):
    """Return a ball at a height above a floor."""
    mech, ball = ball_at(height)
    floor = bd.LineSurface(mech.ground.at(2.0, 0.0), direction)
    mech.add(bd.Contact("floor", ball.point, floor, stiffness, **contact))
    return mech


def in_circle(at, side):
    mech, ball = ball_at(at[1], at[0])
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
    mech, ball = ball_at(0.0)
    for name, y, x in (("floor", -1.0, -1.0), ("ceiling", 1.0, 1.0)):
        surface = bd.LineSurface(mech.ground.at(0.0, y), (x, 0.0))
        mech.add(bd.Contact(name, ball.point, surface, STIFFNESS))
    assert [x.partition(":")[0] for x in findings(mech)] == ["floor", "ceiling"]


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_beams_inside_a_surface_are_reported_but_not_resting_beams(formulation):
    def lying(height, direction):
        mech = bd.Mechanism(gravity=(0.0, -G))
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
    mech, lever = hinged_body(1.0, 0.1, (1.0, 0.0), name="lever", gravity=G, start="equilibrium")
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("stop", lever.at(0.01, 0.0), floor, 1e9))
    assert findings(mech) == ()
    mech = on_floor(-rest_depth(100.0 * G))
    ball = mech.part("ball")
    mech.add(bd.Spring("press", ball.point, mech.ground.at(0.0, -2.0), 1.0, preload=99.0 * G))
    assert findings(mech) == ()


def preloaded_lip(speed, **settings):
    """Return an arm drawn straight, on a turning hub, whose end is pressed into a circle."""
    mech, hub = driven(bd.RigidBody("hub", mass=1.0, inertia=0.01), lambda t: speed * t, **settings)
    arm = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (0.0, 0.3)), STRIP, elements=2))
    mech.add(bd.Weld("root", hub.at(0.0, 0.0), arm.start))
    circle = bd.CircleSurface(mech.ground.at(0.0, 0.0), 0.297, side="inside")
    mech.add(bd.Contact("lip", arm.end, circle, 2000.0, exponent=1.0, friction=0.6))
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
    mech = on_floor(-0.01, stiffness=2e5, exponent=1.0)
    mech.add(bd.Spring("spring", mech.part("ball").point, mech.ground.at(0.0, 0.99), 2e3))
    (sentence,) = findings(mech)
    assert sentence.endswith(
        "or build the model with bd.Mechanism(start='equilibrium') if it is a preload."
    )


@pytest.mark.slow(reason="a second")
def test_the_weight_of_a_heavy_carrier_does_not_explain_the_penetration_of_a_light_body():
    for mass, is_reported in ((1e-3, True), (1e3, False)):
        mech, ball = ball_at(-1e-2, mass=mass)
        carrier = mech.add(bd.RigidBody("carrier", 1e3, 1.0, center=(0.0, 0.0)))
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


def bouncing(height, speed, gravity, direction=1.0):
    mech, ball = ball_at(height, velocity=(0.0, speed), gravity=gravity)
    gap = bd.LineSurface(mech.ground.at(0.0, 0.0), (direction, 0.0)).gap(ball.point)
    mech.when(gap, 0.0, "down", bd.impact(gap, 0.5), name="bounce")
    return mech


@pytest.mark.parametrize(("velocity", "is_reported"), [(-1.0, True), (0.0, True), (1.0, False)])
def test_bodies_that_touch_and_do_not_separate_pass_through_each_other(velocity, is_reported):
    run = bd.simulate(bouncing(0.0, velocity, G), t_end=0.3)
    assert any("where no impact occurs" in x for x in run.warnings) == is_reported
    assert (run["ball.y"].iloc[-1] < -0.1) == is_reported


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ((4e-4, -1.0, G), None),
        ((1e-12, 1.0, G), None),
        ((0.0, 0.0, 0.0), None),
        ((1.0, 0.0, G), None),
        ((0.0, -1.0, 0.0), "starts at 0 m and closes without crossing zero"),
        ((0.0, 0.0, G), "starts at 0 m and closes without crossing zero"),
        ((-1e-3, 0.0, G), "starts at -0.001 m, inside the surface, where no impact occurs"),
        ((1.0, 0.0, G, -1.0), "starts at -1 m, inside the surface, where no impact occurs"),
    ],
)
def test_gaps_of_impacts_that_start_closed_are_reported_if_they_close(start, words):
    sentences = bd.check(bouncing(*start), predict=False).warnings
    assert len(sentences) == (words is not None)
    assert all(x.startswith(f"bounce: the gap of the impact {words}") for x in sentences)


# Start --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("build", "speeds", "count"),
    [
        (cantilever, {"beam.v2": 0.1, "beam.y0": 1e-17}, 0),
        (cantilever, {"beam.v2": 0.1, "beam.y0": 0.1}, 1),
        (swing, {"bob.x": 1e-20}, 0),
        (swing, {"bob.x": 0.1}, 1),
    ],
)
def test_regression_rounding_errors_of_start_velocities_have_no_warning(build, speeds, count):
    # Periodic motions start with the velocities of earlier runs.
    equations = bd.equations_of_motion(build())
    v0 = [speeds.get(name, 0.0) for name in equations.q_names]
    solution = bd.simulate(replace(equations, v0=np.array(v0)), bd.Radau(1e-3), t_end=1e-3)
    assert len([x for x in solution.warnings if "do not allow" in x]) == count
