"""Warnings about observed motions that are small beside the amplitude of their parts."""

import re

import numpy as np
import pytest

import beamdae as bd
from beamdae.results.diagnostics.resolution.small_motions import _deviations_between_steps
from beamdae.results.diagnostics.resolution.small_motions import small_motion_warnings as diagnose

SPEED, AMPLITUDE, FREQUENCY = 20.0, 1e-3, 18.0  # m/s, m, rad/s


def train(speed=SPEED, is_coupled=True):
    """Return a train with a sensor on a spring, which oscillates relative to the train."""
    mech = bd.Mechanism()
    car = mech.add(bd.RigidBody("car", 1500.0, 100.0, velocity=(speed, 0.0)))
    mech.add(bd.Prismatic("road", mech.ground.at(0.0, 0.0), car.at(0.0, 0.0)))
    sensor = mech.add(bd.PointMass("sensor", 1e-3, at=(0.1, 0.0), velocity=(speed, 0.0)))
    guide = bd.PointOnLine("guide", car.at(0.1, 0.0), sensor.point)
    mech.add(guide)
    spring = {"stiffness": 1e-3 * FREQUENCY**2, "free_length": 0.1 - AMPLITUDE}
    if is_coupled:
        mech.add(bd.Spring("spring", car.at(0.0, 0.0), sensor.point, **spring))
    else:
        mech.add(bd.Distance("bar", car.at(0.0, 0.0), sensor.point))
    mech.observe("sensor", bd.relative_motion(sensor.point, car.at(0.1, 0.0)))
    return mech


def small_motion_warnings(solution):
    return [x for x in solution.warnings if "amplitude of its parts" in x]


@pytest.mark.parametrize("integrator", [bd.Auto(1e-5), bd.Radau(1e-5), bd.Ida(1e-5)])
def test_regression_small_vibrations_of_a_travelling_part_have_a_warning(integrator):
    with pytest.warns(bd.BeamdaeWarning, match="amplitude of its parts") as caught:
        solution = bd.simulate(train(), integrator, t_end=8.0, output_step=0.05)
    exact = AMPLITUDE * (np.cos(FREQUENCY * solution.t) - 1.0)
    assert np.max(np.abs(solution["sensor.x"] - exact)) > 0.01 * AMPLITUDE
    (text,) = [str(x.message) for x in caught if "amplitude of its parts" in str(x.message)]
    assert re.match(r"sensor\.x: half its range, 0\.00\d+ m, is only 1e-05", text)
    rtol = float(re.search(r"use rtol=([-e\d]+)\.", text).group(1))
    accurate = bd.simulate(train(), bd.Auto(rtol), t_end=8.0, output_step=0.05)
    assert not small_motion_warnings(accurate)
    assert np.max(np.abs(accurate["sensor.x"] - exact)) < 5e-3 * AMPLITUDE


@pytest.mark.parametrize("setting", [{"speed": 0.0}, {"is_coupled": False}])
def test_vibrations_at_rest_and_motions_that_joints_prescribe_have_no_warning(setting):
    assert not bd.simulate(train(**setting), t_end=2.0, output_step=0.02).warnings


@pytest.mark.parametrize("torque", [1.0, 10.0])
def test_regression_a_pinned_point_of_an_eccentric_wheel_has_no_warning(torque):
    """The constraints were scaled twice, so that the pin seemed to allow motions of its point."""
    mech = bd.Mechanism()
    wheel = mech.add(bd.RigidBody("wheel", mass=1.0, inertia=0.3, center=(0.3, 0.1)))
    mech.add(bd.Revolute("pivot", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)))
    mech.add(bd.Moment("torque", on=wheel.at(0.0, 0.0), law=bd.sine(torque, 1.0)))
    mech.observe("hub", wheel.at(0.0, 0.0))
    assert not bd.simulate(mech, bd.Radau(1e-5), t_end=1.0, output_step=0.1).warnings


def test_the_warning_names_further_columns():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    car = mech.add(bd.RigidBody("car", 1000.0, 800.0, center=(0.0, 0.5), velocity=(30.0, 0.0)))

    def tire(at, t):
        return 0.0, 2e4 * (0.25 - at.position[1]) - 400.0 * at.velocity[1]

    for name, x in (("front", 1.2), ("rear", -1.3)):
        mech.add(bd.ForceLaw(name, car.at(x, 0.0), tire))
    mech.observe("car", car.at(0.0, 0.5))
    with pytest.warns(bd.BeamdaeWarning, match=r"car\.\w+ \(also car\.\w+\): half its range"):
        solution = bd.simulate(mech, bd.Radau(1e-5), t_end=60.0, output_step=0.1)
    assert len(small_motion_warnings(solution)) == 1
    assert not small_motion_warnings(bd.simulate(mech, bd.Radau(1e-9), t_end=60.0))
    fixed = bd.simulate(mech, bd.GeneralizedAlpha(0.01), t_end=60.0)
    assert not small_motion_warnings(fixed)  # The step does not refer to amplitudes.


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("integrator", [bd.Radau(1e-5), bd.Ida(1e-5)])
def test_regression_small_motions_that_the_steps_resolve_have_no_warning(integrator):
    """Errors of several percent were announced for columns that are far more accurate."""
    stage = bd.load_model("example:voice_coil_stage")()
    solution = bd.simulate(stage, integrator, t_end=0.1)
    reference = bd.simulate(stage, bd.Radau(1e-8), t_end=0.1)
    angle, exact = solution["platform.angle"], reference["platform.angle"]
    assert np.ptp(exact) < 1e-6
    assert np.max(np.abs(angle - exact)) < 1e-3 * np.ptp(exact)
    assert not small_motion_warnings(solution)


def falling_strip():
    """Return a strip that falls on two feet, which the impact also moves a little sideways."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    material = bd.Material(E=70e9, nu=0.33, rho=2700.0)
    section = bd.Section.rectangle(material, width=0.03, height=4e-3, damping=2e-5)
    strip = mech.add(bd.Beam("strip", bd.Line((-0.1, 0.05), (0.1, 0.05)), section, elements=4))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0), direction=(1.0, 0.0))
    mech.add(bd.PointMass("device", 0.2, on=strip.at(0.1)))
    for name, point in (("left", strip.start), ("right", strip.end)):
        mech.add(bd.PointMass(name, 0.1, on=point))
        mech.add(bd.Contact(f"{name} contact", point, floor, 2e6))
    mech.observe("foot", strip.end)
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_regression_small_motions_in_impacts_have_no_warning():
    """Errors of several percent were announced for a column with an error of 1e-6."""
    solution = bd.simulate(falling_strip(), bd.Radau(1e-5), t_end=0.15)
    reference = bd.simulate(falling_strip(), bd.Radau(1e-8), t_end=0.15)
    sideways, exact = solution["foot.x"], reference["foot.x"]
    assert np.ptp(exact) < 2e-3 * np.ptp(reference["foot.y"])
    assert np.max(np.abs(sideways - exact)) < 1e-4 * np.ptp(exact)
    assert not small_motion_warnings(solution)


def test_deviations_between_steps_exclude_jumps_of_the_acceleration():
    """Values of a cubic polynomial on either side of a sample have no deviations."""
    t = np.array([0.0, 0.1, 0.25, 0.4, 0.5, 0.6, 0.8, 0.9, 1.0, 1.1, 1.3])
    x = np.where(t < 0.5, t**3, t**3 + 5.0 * (t - 0.5) ** 2)
    assert np.max(_deviations_between_steps(t, x, np.array([4]))) < 1e-12
    assert np.max(_deviations_between_steps(t, x, np.zeros(0, int))) > 0.01
    # Two steps between jumps have too few values.
    assert np.max(_deviations_between_steps(t, x, np.array([2, 4, 6, 8]))) > 0.01


def flexible_slider():
    """Return a flexible rod whose end slides on a line while its start moves on a circle."""
    mech = bd.Mechanism()
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), (0.2, 0.0), mass=1.0))
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.02)
    line = bd.Line((0.2, 0.0), (1.2, 0.0))
    rod = mech.add(bd.Beam("rod", line, section, elements=2))
    ground = mech.ground.at(0.0, 0.0)
    mech.add(bd.Driver("motor", ground, crank.at(0.0, 0.0), law=bd.run_up(10.0, 0.2)))
    mech.add(bd.Revolute("bearing", ground, crank.at(0.0, 0.0)))
    mech.add(bd.Revolute("pin", crank.at(0.2, 0.0), rod.start))
    mech.add(bd.PointOnLine("guide", mech.ground.at(1.2, 0.0), rod.end, direction=(1.0, 0.0)))
    mech.observe("slider", rod.end)
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("integrator", [bd.Radau(1e-3), bd.Ida(1e-3)])
def test_regression_points_of_beams_that_joints_hold_have_no_warning(integrator):
    """The errors of the constraint, 1e-8 m and 1e-5 m/s, seemed to be motions of the slider."""
    solution = bd.simulate(flexible_slider(), integrator, t_end=0.8)
    assert not [x for x in solution.warnings if x.startswith("slider")]


def test_regression_constraints_are_decomposed_once_for_all_columns(monkeypatch):
    """Chains of 300 bodies with ten observed points took almost as long as their run."""
    mech = train()
    for k in range(4):
        mech.observe(f"sensor {k}", mech.observables["sensor"])
    with pytest.warns(bd.BeamdaeWarning):
        solution = bd.simulate(mech, bd.Radau(1e-5), t_end=2.0, output_step=0.05)
    calls, svd = [], np.linalg.svd
    monkeypatch.setattr(np.linalg, "svd", lambda *args, **kw: calls.append(1) or svd(*args, **kw))
    extremes = solution.step_extremes
    settings = (solution.equations, solution.trajectory, extremes, solution.integrator)
    assert len(list(diagnose(*settings))) == 1
    assert len(calls) == 3  # one per instant


@pytest.mark.slow(reason="half a second and more")
def test_regression_rotations_of_symmetric_leaf_springs_have_no_warning():
    """An error of several percent was announced for a rotation of 2e-5 rad, wrong by 0.03 %."""
    steel = bd.Material(E=200e9, nu=0.3, rho=7850.0)
    section = bd.Section.rectangle(steel, width=0.24, height=0.012, damping=1e-5)
    mech = bd.Mechanism(gravity=(0.0, -9.81), start="equilibrium")
    chassis = mech.add(bd.RigidBody("chassis", mass=300.0, inertia=50.0))
    axle = mech.add(bd.RigidBody("axle", mass=1.0, inertia=0.1))
    ground, up = mech.ground.at(0.0, 0.0), (0.0, 1.0)
    mech.add(bd.Prismatic("guide", ground, chassis.at(0.0, 0.0), direction=up))
    front = mech.add(bd.Beam("front", bd.Line((-0.55, 0.0), (0.0, 0.0)), section, elements=2))
    rear = mech.add(bd.Beam("rear", bd.Line((0.0, 0.0), (0.55, 0.0)), section, elements=2))
    mech.add(bd.Weld("front clamp", axle.at(0.0, 0.0), front.end))
    mech.add(bd.Weld("rear clamp", axle.at(0.0, 0.0), rear.start))
    mech.add(bd.Revolute("eye", chassis.at(-0.55, 0.0), front.start))
    mech.add(bd.PointOnLine("slider", chassis.at(0.55, 0.0), rear.end, (1.0, 0.0)))
    mech.add(bd.SpringDamper("damper", chassis.at(0.0, 0.3), axle.at(0.0, 0.0), damping=1500.0))
    bump = bd.piecewise(
        (0.1, 0.0), (0.35, lambda t: 0.02 * (1 - np.cos(8 * np.pi * (t - 0.1)))), 0.0
    )
    mech.add(bd.TranslationalDriver("road", ground, axle.at(0.0, 0.0), bump, up))
    mech.observe("axle", axle.at(0.0, 0.0))
    solution = bd.simulate(mech, bd.Radau(1e-5), t_end=0.6, output_step=0.01)
    reference = bd.simulate(mech, bd.Radau(1e-7), t_end=0.6, output_step=0.01)
    angle, exact = solution["axle.angle"], reference["axle.angle"]
    assert 1e-6 < np.ptp(exact) < 1e-4
    assert np.max(np.abs(angle - exact)) < 5e-3 * np.ptp(exact)
    assert not small_motion_warnings(solution)
