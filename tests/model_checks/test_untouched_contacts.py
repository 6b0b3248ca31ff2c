"""Warnings about mechanisms none of whose contacts touch, and about distant contacts."""

from __future__ import annotations

import pytest

import beamdae as bd


def dropped_ball(
    height: float = 1.0, floor: float = 0.0, side: float = 1.0, contacts: int = 1
) -> bd.Mechanism:
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", 0.1, at=(0.0, height)))
    surface = bd.LineSurface(mech.ground.at(0.0, floor), direction=(side, 0.0))
    for number in range(contacts):
        name = "floor" if number == 0 else f"guard {number}"
        mech.add(bd.Contact(name, ball.point, surface, 1e4, restitution=0.5, impact_speed=4.0))
    mech.observe("ball", ball.point)
    return mech


def untouched(mech: bd.Mechanism, t_end: float) -> list[str]:
    run = bd.simulate(mech, t_end=t_end, output_step=t_end / 200.0)
    return [x for x in run.warnings if "do not touch" in x]


@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
def test_regression_runs_that_end_before_the_only_contact_have_a_warning() -> None:
    """A drop test that ended in free fall had no warning."""
    (sentence,) = untouched(dropped_ball(), 0.3)
    assert sentence == (
        "floor: the bodies do not touch during the run, and their smallest distance is 0.559 m at "
        "t = 0.3 s; use a later t_end=, or check the place of the surface."
    )
    (sentence,) = untouched(dropped_ball(floor=2.0, side=-1.0), 0.6)
    assert "smallest distance is 1 m at t = 0 s; check the place and the direction" in sentence


@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize(("floor", "side", "remedy"), [(0.0, 1.0, "later"), (2.0, -1.0, "motion")])
def test_regression_a_stop_of_two_points_that_is_not_reached_has_a_warning(
    floor: float, side: float, remedy: str
) -> None:
    """Drop tests onto two stops that flew up, or were too short for the fall, were silent."""
    (sentence,) = untouched(dropped_ball(floor=floor, side=side, contacts=2), 0.3)
    assert sentence.startswith("floor (also guard 1): the bodies do not touch")
    assert remedy in sentence


@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize(("do", "count"), [("record", 1), ("stop", 0)])
def test_regression_events_that_are_only_recorded_hide_no_contact_without_a_touch(
    do: str, count: int
) -> None:
    """A drop test that recorded its impacts, and flew up, was silent."""
    mech = dropped_ball()
    mech.when("ball.y", crosses=0.0, direction="down", do=do, name="impact")
    assert len(untouched(mech, 0.3)) == count


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
def test_contacts_that_touch_or_may_be_guards_have_no_warning() -> None:
    assert untouched(dropped_ball(), 0.5) == []
    # One of several contacts.
    mech = dropped_ball()
    floor = bd.LineSurface(mech.ground.at(0.0, -1.0))
    mech.add(bd.Contact("guard", mech.parts["ball"].point, floor, 1e4))
    assert untouched(mech, 0.5) == []
    # Two end stops, between which a body moves.
    mech = dropped_ball()
    ceiling = bd.LineSurface(mech.ground.at(0.0, 1.2), direction=(-1.0, 0.0))
    mech.add(bd.Contact("ceiling", mech.parts["ball"].point, ceiling, 1e4))
    assert untouched(mech, 0.3) == []
    # A stop of a vibration.
    mech = dropped_ball(height=0.2, floor=-0.5)
    ball = mech.parts["ball"].point
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 1.2), ball, 40.0, free_length=1.0))
    assert untouched(mech, 1.0) == []
    # A run that an event may stop.
    mech = dropped_ball()
    mech.when("ball.y", 0.1)
    assert untouched(mech, 0.3) == []


@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize(
    ("gap", "friction", "count"), [(1e-3, 0.3, 1), (1e-3, 0.0, 0), (-1e-4, 0.3, 0)]
)
def test_regression_pads_with_friction_that_do_not_touch_have_a_warning(
    gap: float, friction: float, count: int
) -> None:
    """A wiper 1 mm above the glass had forces of zero and no warning."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    pad = mech.add(bd.PointMass("pad", 1.0, at=(0.0, 0.0))).point
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), pad))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), pad, 100.0, free_length=0.9))
    glass = bd.LineSurface(mech.ground.at(0.0, -gap))
    mech.add(bd.Contact("glass", pad, glass, 1e5, friction=friction))
    assert len(untouched(mech, 1.0)) == count


def pad_on_belt(force: float, overlap: float = 0.0, gravity: float = 0.0) -> bd.Mechanism:
    """Return a pad of 0.1 kg with a spring along a belt, onto which a force [N] presses it."""
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    belt = mech.add(bd.RigidBody.plate("belt", (0.0, -0.01), 1.0, 0.02, mass=1.0))
    rail = mech.ground.at(0.0, -0.01), belt.at(0.0, -0.01)
    mech.add(bd.Prismatic("rail", *rail, direction=(1.0, 0.0)))
    mech.add(bd.TranslationalDriver("drive", *rail, lambda t: 0.2 * t, direction=(1.0, 0.0)))
    pad = mech.add(bd.PointMass("box", 0.1, at=(0.0, -overlap))).point
    mech.add(bd.Spring("spring", mech.ground.at(-0.2, 0.0), pad, 1e3, free_length=0.2))
    mech.add(bd.Force("press", pad, (0.0, -force)))
    surface = bd.LineSurface(belt.at(0.0, 0.0))
    mech.add(bd.Contact("pad", pad, surface, 1e6, 1.5, 0.3, 0.1, friction=0.3))
    mech.when("t", crosses=1.0)
    return mech


def unpressed(mech: bd.Mechanism, t_end: float = 0.05) -> list[str]:
    run = bd.simulate(mech, t_end=t_end)
    return [x for x in run.warnings if "nothing presses the bodies together" in x]


@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize(
    ("force", "overlap", "when"),
    [
        (0.0, 0.0, "during the run"),
        (-20.0, 0.0, "during the run"),
        (-20.0, 1e-5, "after t = "),
    ],
)
def test_regression_pads_that_are_lifted_at_once_have_a_warning(
    force: float, overlap: float, when: str
) -> None:
    """A wiper drawn on the glass, and lifted in place of pressed, was silent."""
    (sentence,) = unpressed(pad_on_belt(force, overlap))
    assert sentence.startswith(f"pad: nothing presses the bodies together {when}")
    assert sentence.endswith("of the force or the motion that should press.")


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
def test_pads_that_are_pressed_or_land_later_have_no_warning() -> None:
    assert unpressed(pad_on_belt(20.0)) == []
    assert unpressed(pad_on_belt(0.0, gravity=9.81)) == []
    # A small force beside that of the spring.
    assert unpressed(pad_on_belt(1e-3)) == []


def leaf_on_cam(offset: float, far_stop: float = 0.0) -> bd.Mechanism:
    """Return a cam of 40 mm below which a leaf spring of 0.15 m is clamped."""
    mech = bd.Mechanism()
    cam = mech.add(bd.RigidBody.disk("cam", (0.0, 0.0), 0.02, mass=0.5))
    shaft = mech.ground.at(0.0, 0.0), cam.at(0.0, 0.0)
    mech.add(bd.Revolute("shaft", *shaft))
    mech.add(bd.Driver("motor", *shaft, lambda t: t))
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.01, height=0.002)
    y = 0.02 + offset
    line = bd.Line((-0.15, y), (0.0, y))
    leaf = mech.add(bd.Beam("leaf", line, section, elements=1))
    mech.add(bd.Weld("clamp", mech.ground.at(-0.15, y), leaf.start))
    surface = bd.CircleSurface(cam.at(0.0, 0.0), 0.02)
    mech.add(bd.Contact("touch", leaf.end, surface, 1e5))
    if far_stop:
        stop = bd.LineSurface(mech.ground.at(0.0, y - far_stop))
        mech.add(bd.Contact("stop", leaf.end, stop, 1e5))
    return mech


def far_contacts(mech: bd.Mechanism) -> list[str]:
    run = bd.simulate(mech, bd.Radau(1e-4), t_end=0.1)
    return [x for x in run.warnings if "during the whole run" in x]


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_contacts_that_are_meters_away_have_a_warning() -> None:
    """A leaf spring 2 m (in place of 2 mm) from its cam rested silently."""
    (sentence,) = far_contacts(leaf_on_cam(2.0))
    assert sentence.startswith(
        "touch: the distance of the bodies is at least 2 m during the whole run, 11 times the size "
        "of all bodies and of the motion (0.19 m); check the unit"
    )
    (sentence,) = far_contacts(leaf_on_cam(0.002, far_stop=2.0))
    assert sentence.startswith("stop: ")


def test_contacts_at_the_distance_of_some_bodies_have_no_warning() -> None:
    assert far_contacts(leaf_on_cam(0.002, far_stop=0.5)) == []


def fallen(mech: bd.Mechanism, t_end: float = 0.3) -> list[str]:
    return [x for x in bd.simulate(mech, t_end=t_end).warnings if "falls away from it" in x]


@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
def test_regression_bodies_that_fall_through_a_reversed_floor_have_a_warning() -> None:
    """A ball on a floor in reverse direction, or 0.1 mm above it, fell through it silently."""
    for height in (1.0, 1.0001):
        (sentence,) = fallen(dropped_ball(height, floor=1.0, side=-1.0))
        assert sentence == (
            f"floor: ball at (0, {height:g}) starts at the surface and falls away from it; turn "
            "the direction of the line to (1, 0) if the body should rest on it."
        )


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
def test_bodies_that_leave_stops_and_floors_have_no_warning_of_reversed_floors() -> None:
    # An upper end stop, whose lower one is approached.
    mech = dropped_ball(floor=1.0, side=-1.0)
    ball = mech.parts["ball"].point
    mech.add(bd.Contact("lower", ball, bd.LineSurface(mech.ground.at(0.0, 0.0)), 1e4))
    assert fallen(mech) == []
    # A spring that holds the ball below a ceiling, and a force that lifts it from a floor.
    for side, force in ((-1.0, 2.0), (1.0, 2.0)):
        mech = dropped_ball(floor=1.0, side=side)
        mech.add(bd.Force("lift", mech.parts["ball"].point, (0.0, force)))
        assert fallen(mech) == []
