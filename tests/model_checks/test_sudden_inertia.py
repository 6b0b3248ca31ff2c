"""Warnings about extremes of forces that belong to the vibration by inertia after the start."""

import re

import numpy as np
import pytest

import beamdae as bd

RATE, PERIOD = 40.0, 2.0 * np.pi / 40.0
CAUSE = "inertia acts suddenly"


def strip(damping, height=0.01):
    return bd.Section.rectangle(bd.Material.of("steel"), 0.02, height, damping=damping)


def slider_crank(damping=1e-5, law=None, load=0.0, tip=(0.0, 0.05)):
    """Return a crank that a driver turns, with an elastic rod and a slider."""
    mech = bd.Mechanism()
    end = (tip[0] + np.sqrt(0.25**2 - tip[1] ** 2), 0.0)
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), tip, mass=1.0))
    center = mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)
    mech.add(bd.Revolute("bearing", *center))
    motor = mech.add(bd.Driver("motor", *center, law or (lambda t: RATE * t)))
    line = bd.Line(tip, end)
    rod = mech.add(bd.Beam("rod", line, strip(damping), elements=1))
    slider = mech.add(bd.PointMass("slider", 2.0, at=end))
    pin = mech.add(bd.Revolute("pin", crank.at(*tip), rod.start))
    mech.add(bd.Revolute("slider pin", rod.end, slider.point))
    mech.add(bd.PointOnLine("guide", mech.ground.at(*end), slider.point, direction=(1.0, 0.0)))
    force = bd.table([0.1, 0.25, 0.3, 0.4], [0.0, 0.0, load, load], name="force of the press")
    if load:
        mech.add(bd.ForceLaw("press", slider.point, lambda x, t: (-force(x.position[0]), 0.0)))
    mech.observe("pin", pin.reaction)
    mech.observe("motor", motor.reaction)
    mech.observe("stress", rod.largest_stress())
    return mech


def rotor(speed=30.0, damping=1e-5, formulation="floating frame"):
    """Return a beam with a mass at its tip that a driver turns."""
    mech = bd.Mechanism()
    line = bd.Line((0.1, 0.0), (0.6, 0.0))
    blade = mech.add(
        bd.Beam("blade", line, strip(damping, 0.008), elements=1, formulation=formulation)
    )
    hub = mech.add(bd.Revolute("hub", mech.ground.at(0.1, 0.0), blade.start))
    mech.add(bd.Driver("motor", mech.ground.at(0.1, 0.0), blade.start, lambda t: speed * t))
    mech.add(bd.PointMass("tip", 0.3, on=blade.end))
    mech.observe("hub", hub.reaction)
    return mech


def yoke(turns=4.0):
    """Return an elastic arm with a mass at its tip on a slide that moves for some turns."""
    mech = bd.Mechanism()
    slide = mech.add(bd.RigidBody("yoke", 1.0, 1e-3, center=(0.0, 0.0)))
    center = mech.ground.at(0.0, 0.0), slide.at(0.0, 0.0)
    mech.add(bd.Prismatic("guide", *center, direction=(1.0, 0.0)))
    end = turns * 2.0 * np.pi / 18.0
    law = bd.piecewise((end, lambda t: 0.03 * np.cos(18.0 * t) - 0.03), 0.0)
    mech.add(bd.TranslationalDriver("drive", *center, law, direction=(1.0, 0.0)))
    line = bd.Line((0.0, 0.0), (0.0, 0.3))
    arm = mech.add(bd.Beam("arm", line, strip(1e-4, 0.008), elements=1))
    clamp = mech.add(bd.Weld("clamp", slide.at(0.0, 0.0), arm.start))
    mech.add(bd.PointMass("tip", 0.2, on=arm.end))
    mech.observe("clamp", clamp.reaction)
    return mech


def find_warning(solution):
    return "".join(x for x in solution.warnings if CAUSE in x)


def read_later(sentence):
    return float(re.search(r"magnitude later: (\S+)", sentence)[1])


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("damping", [1e-5, 1e-4])
def test_regression_vibrations_of_a_crank_at_full_speed_are_no_peaks_of_its_motion(damping):
    """The stress of the first instants was said to be the largest one: 1.5 times the later ones."""
    model = slider_crank(damping)
    sentence = find_warning(bd.simulate(model, bd.Radau(1e-5), t_end=2.0 * PERIOD))
    assert "stress.largest" in sentence
    assert "begins because motor starts with a velocity" in sentence
    assert "bd.periodic" in sentence
    assert "start the law of motor smoothly" in sentence


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_the_torque_of_a_crank_at_its_dead_center_is_named():
    """Only forces of the rod had the warning, because the start does not change the torque."""
    model = slider_crank(2e-5, law=lambda t: 300.0 * t, tip=(0.05, 0.0))
    run = bd.simulate(model, bd.Radau(1e-5), t_end=8.0 * np.pi / 300.0, output_step=5e-5)
    torque = run["motor.M"]
    later = torque[torque.index > 0.5 * torque.index[-1]].max()
    assert torque.max() > 1.1 * later
    assert "motor.M" in find_warning(run)


@pytest.mark.slow(reason="a periodic motion, and a long run-up")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_recommended_starts_of_a_crank_have_the_later_extremes():
    model = slider_crank()
    run = bd.simulate(model, bd.Radau(1e-5), t_end=4.0 * PERIOD)
    smooth = slider_crank(law=bd.run_up(RATE, 2.0 * PERIOD))
    started = bd.simulate(smooth, bd.Radau(1e-5), t_end=4.0 * PERIOD)
    assert not find_warning(started)
    periodic = bd.periodic(model, PERIOD).solution
    later = read_later(find_warning(run))
    for solution in (started, periodic):
        stresses = [x.max for name, x in solution.step_extremes.items() if "[Pa]" in name]
        assert min(abs(later / x - 1.0) for x in stresses) < 0.01
    assert run.step_extremes["stress.largest"].max > 1.4 * later


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize(("speed", "formulation"), [(9.0, "floating frame"), (30.0, "exact")])
def test_regression_rotations_are_started_with_the_strain_of_the_rotation(speed, formulation):
    model, end = rotor(speed, formulation=formulation), 10.0 / speed
    sentence = find_warning(bd.simulate(model, bd.Radau(1e-5), t_end=end))
    assert sentence.startswith("hub.Fx")
    assert sentence.endswith(f"use start=bd.rotation({speed:g}, (0.1, 0)).")
    start = bd.rotation(speed, (0.1, 0.0))
    steady = bd.simulate(model, bd.Radau(1e-5), t_end=end, start=start)
    assert not find_warning(steady)
    assert read_later(sentence) == pytest.approx(-steady.step_extremes["hub.Fx"].min, rel=0.01)


@pytest.mark.slow(reason="one second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_starts_with_an_acceleration_count_if_the_motion_repeats():
    """The vibration after a single stroke from rest is the motion of interest."""
    duration = 4.0 * 2.0 * np.pi / 18.0
    sentence = find_warning(bd.simulate(yoke(), bd.Radau(1e-5), t_end=duration))
    assert "begins because drive starts with an acceleration" in sentence
    assert not find_warning(bd.simulate(yoke(turns=1.0), bd.Radau(1e-5), t_end=duration))


@pytest.mark.slow(reason="half a second")
def test_larger_loads_of_the_motion_have_no_warning():
    """The vibration of the start is smaller than the force of the press, and decays."""
    model = slider_crank(1e-4, load=2000.0)
    assert not find_warning(bd.simulate(model, bd.Radau(1e-5), t_end=2.0 * PERIOD))


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("restitution", [0.05, 0.6])
@pytest.mark.parametrize("speed", [2.0, 4.43])
def test_regression_impacts_that_begin_at_the_start_are_no_vibrations_of_the_start(
    speed, restitution
):
    """The force of a drop test that begins at the touch was to be avoided by a periodic motion."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(bd.Material.of("aluminum"), 0.03, 3e-3, damping=1e-5)
    line = bd.Line((-0.15, 0.0), (0.15, 0.0))
    options = {"elements": 8, "formulation": "exact", "velocity": (0.0, -speed)}
    beam = mech.add(bd.Beam("strip", line, section, **options))
    for name, end in (("left", beam.start), ("right", beam.end)):
        mech.add(bd.PointMass(name, 0.08, on=end))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"restitution": restitution, "impact_speed": speed}
    stop = mech.add(bd.Contact("stop", beam.at(0.15), floor, 2e6, **law))
    mech.observe("stop", stop.force)
    mech.observe("stress", beam.largest_stress())
    run = bd.simulate(mech, bd.Radau(1e-5), t_end=0.05)
    assert run.step_extremes["stop.N"].max_time < 0.01
    assert not [x for x in run.warnings if "belongs to a vibration" in x]


def four_bar(speed=10.0 * np.pi):
    """Return a four-bar linkage with an elastic coupler and a crank that a driver turns."""
    mech = bd.Mechanism()
    a = 0.04 * np.cos(0.6), 0.04 * np.sin(0.6)
    span = np.array([0.18, 0.0]) - a
    distance = np.hypot(*span)
    cosine = (0.2**2 + distance**2 - 0.12**2) / (0.4 * distance)
    angle = np.arctan2(span[1], span[0]) + np.arccos(cosine)
    b = a[0] + 0.2 * np.cos(angle), a[1] + 0.2 * np.sin(angle)
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), a, mass=0.0108))
    rocker = mech.add(bd.RigidBody.rod("rocker", (0.18, 0.0), b, mass=0.01296))
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.015, 0.001, damping=5e-4)
    coupler = mech.add(bd.Beam("coupler", bd.Line(a, b), section, elements=1))
    center = mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)
    mech.add(bd.Revolute("shaft", *center))
    mech.add(bd.Revolute("crank pin", crank.at(*a), coupler.start))
    mech.add(bd.Revolute("rocker pin", coupler.end, rocker.at(*b)))
    mech.add(bd.Revolute("foot", mech.ground.at(0.18, 0.0), rocker.at(0.18, 0.0)))
    motor = mech.add(bd.Driver("motor", *center, lambda t: speed * t))
    mech.observe("motor", motor.reaction)
    return mech


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_extremes_of_a_smaller_magnitude_than_later_ones_are_not_named():
    """The largest torque was said to be 0.026 N m, of the start; the motion needs -0.033 N m."""
    run = bd.simulate(four_bar(), t_end=0.4)
    torque = run.step_extremes["motor.M"]
    assert torque.max_time < 0.02 < torque.min_time
    assert -torque.min > 1.2 * torque.max
    assert not find_warning(run)
