"""Starts in steady rotation: runs and periodic motions of turning beams."""

import numpy as np
import pytest
from mechanisms import STEEL, clamped_beam, driven, hinged_beam, rectangle

import beamdae as bd

SPEED = 5.0  # [rad/s]


def driven_beam(gravity=0.0, **settings):
    """Return a beam whose root is driven at a constant speed."""
    section = rectangle(0.002, damping=1e-4)
    mech, beam = hinged_beam(section, 2, gravity=gravity, **settings)
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), beam.start, lambda t: SPEED * t))
    mech.observe("tip", beam.end)
    return mech


@pytest.mark.parametrize("settings", [{"strain": "exact"}, {"formulation": "exact"}])
def test_turning_beam_stays_in_steady_rotation(settings):
    solution = bd.simulate(
        driven_beam(**settings), bd.Radau(1e-5), t_end=0.1, start=bd.rotation(SPEED)
    )
    radius = np.hypot(solution["tip.x"], solution["tip.y"])
    # Stretch of a uniform rod: rho W^2 L^3 / (3 E).
    stretch = STEEL.rho * SPEED**2 / (3.0 * STEEL.E)
    np.testing.assert_allclose(radius - 1.0, stretch, rtol=1e-4)


@pytest.mark.slow(reason="half a second and more")
def test_periodic_motion_of_a_turning_beam():
    period = 2.0 * np.pi / SPEED
    mechanism = driven_beam(strain="exact")
    motion = bd.periodic(mechanism, period, start=bd.rotation(SPEED), settle=0)
    assert motion.status.success
    assert motion.stable
    # Modes of the damped beam in steady rotation: multipliers exp(lambda T).
    modes = bd.modes(mechanism, bd.rotation(SPEED), 1)
    growth = -2.0 * np.pi * modes.frequencies[0] * modes.damping_ratios[0]
    assert np.abs(motion.multipliers[0]) == pytest.approx(np.exp(growth * period), rel=1e-4)


@pytest.mark.parametrize("settings", [{}, {"strain": "exact"}, {"formulation": "exact"}])
def test_driver_sets_a_whole_beam_in_motion(settings):
    # If only the root turned, the tip would lag behind by 2.2 rad.
    solution = bd.simulate(driven_beam(**settings), bd.Radau(1e-5), t_end=0.1)
    angle = np.arctan2(solution["tip.y"], solution["tip.x"])
    np.testing.assert_allclose(angle, SPEED * solution.t, rtol=0.0, atol=1e-6)
    # The beam is drawn without stretch, which oscillates up to twice its steady value.
    radius = np.hypot(solution["tip.x"], solution["tip.y"])
    assert np.max(np.abs(radius - 1.0)) < 2.1 * STEEL.rho * SPEED**2 / (3.0 * STEEL.E)


@pytest.mark.slow(reason="half a second and more")
def test_periodic_motion_of_a_driven_beam_as_drawn():
    motion = bd.periodic(driven_beam(strain="exact"), 2.0 * np.pi / SPEED)
    assert motion.status.success
    assert motion.stable


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_driver_sets_a_flexible_slider_crank_in_motion(unit):
    crank_length, rod_length, speed = 0.1 * unit, 0.4 * unit, 30.0
    section = rectangle(0.004 * unit, 0.02 * unit)
    mech = bd.Mechanism()
    axle = mech.ground.at(0.0, 0.0)
    crank = mech.add(bd.Beam("crank", bd.Line((0.0, 0.0), (0.0, crank_length)), section))
    pin = (0.0, crank_length)
    end = (np.sqrt(rod_length**2 - crank_length**2), 0.0)
    rod = mech.add(bd.Beam("rod", bd.Line(pin, end), section, formulation="exact"))
    mech.add(bd.Revolute("axle", axle, crank.start))
    mech.add(bd.Driver("motor", axle, crank.start, lambda t: speed * t))
    mech.add(bd.Revolute("crank pin", crank.end, rod.start))
    mech.add(bd.PointOnLine("guide", axle, rod.end, (1.0, 0.0)))
    mech.observe("middle", rod.at(0.5 * rod_length))
    mech.observe("slider", rod.end)
    solution = bd.simulate(mech, t_end=1e-6, output_step=1e-6)
    # Velocities of a rigid slider-crank: the rod, its upper end above the axle, translates.
    for name in ("middle", "slider"):
        velocity = [solution[f"{name}.{x}"].iloc[0] for x in ("x_dot", "y_dot")]
        np.testing.assert_allclose(velocity, [-speed * crank_length, 0.0], atol=1e-9 * unit)


def test_given_velocities_are_stopped_by_joints():
    # A moving rod that a wall stops at one end: only this end stops at once.
    mech, beam = clamped_beam(rectangle(0.02), 4, velocity=(-1.0, 0.0))
    mech.observe("end", beam.end)
    solution = bd.simulate(mech, t_end=1e-6, output_step=1e-6)
    assert solution["end.x_dot"].iloc[0] == pytest.approx(-1.0, abs=0.2)


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_bodies_apart_do_not_change_how_a_driven_beam_starts():
    """A velocity of 1e-9 m/s of another body let the beam whip."""
    mech = driven_beam(strain="exact")
    mech.add(bd.PointMass("apart", 1.0, at=(5.0, 0.0), velocity=(1e-9, 0.0)))
    alone, together = (bd.simulate(x, t_end=0.1) for x in (driven_beam(strain="exact"), mech))
    np.testing.assert_allclose(together["tip.y"], alone["tip.y"], atol=1e-4)
    assert together["apart.x"].iloc[-1] == pytest.approx(5.0 + 1e-10, abs=1e-13)


@pytest.mark.slow(reason="a quarter of a second")
def test_drivers_that_bend_a_beam():
    # Both ends turn in opposite directions: the beam has no rigid motion.
    section = rectangle(0.02)
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements=2, formulation="exact"))
    for name, point, x, rate in (("left", beam.start, 0.0, 0.5), ("right", beam.end, 1.0, -0.5)):
        support = mech.ground.at(x, 0.0)
        mech.add(bd.PointOnLine(f"{name} guide", support, point, (1.0, 0.0)))
        mech.add(bd.Driver(name, support, point, lambda t, rate=rate: rate * t))
    mech.observe("left", beam.start)
    solution = bd.simulate(mech, t_end=1e-6, output_step=1e-6)
    assert solution.status.success


@pytest.mark.slow(reason="a quarter of a second")
def test_weight_acts_as_at_the_start():
    solution = bd.simulate(driven_beam(9.81, strain="exact"), t_end=0.01, start=bd.rotation(SPEED))
    assert solution.status.success
    assert solution["tip.y"].iloc[0] < -1e-3


def test_mechanism_with_a_start_in_rotation():
    section = rectangle(0.02)
    mech = bd.Mechanism(start=bd.rotation(2.0, center=(0.5, 0.0)))
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements=2, formulation="exact"))
    mech.observe("end", beam.start)
    solution = bd.simulate(mech, t_end=0.5 * np.pi)
    # Half a revolution of a free beam about its center.
    assert solution["end.x"].iloc[-1] == pytest.approx(1.0, abs=1e-4)
    assert solution["end.y"].iloc[-1] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    "start", [bd.rotation(4.0), bd.rotation(SPEED, (0.1, 0.0)), bd.rotation(SPEED, (-5.0, 3.0))]
)
def test_rotation_that_contradicts_a_joint_is_rejected(start):
    with pytest.raises(bd.BeamdaeError, match=r"does not allow a rotation at .* (use|turns all)"):
        bd.simulate(driven_beam(strain="exact"), t_end=0.1, start=start)


@pytest.mark.parametrize("joint", [bd.Weld, bd.Revolute])
def test_regression_rotations_that_joints_prevent_do_not_name_a_driver(joint):
    """The remedy was to use the speed of the driver, although there was none."""
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", 1.0, 0.01, center=(0.0, 0.0)))
    mech.add(joint("root", mech.ground.at(0.1, 0.0), hub.at(0.1, 0.0)))
    with pytest.raises(bd.BeamdaeError, match=r"about the center of their Revolute; .*run_up"):
        bd.simulate(mech, t_end=0.1, start=bd.rotation(30.0))


def test_slider_cranks_have_no_rotation_as_one_body():
    mech = bd.Mechanism()
    origin = mech.ground.at(0.0, 0.0)
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), (0.0, 0.1), mass=1.0))
    block = mech.add(bd.PointMass("block", 1.0, at=(0.4, 0.0)))
    mech.add(bd.Revolute("bearing", origin, crank.at(0.0, 0.0)))
    mech.add(bd.PointOnLine("guide", origin, block.point, (1.0, 0.0)))
    mech.add(bd.Distance("rod", crank.at(0.0, 0.1), block.point))
    mech.add(bd.Driver("motor", origin, crank.at(0.0, 0.0), lambda t: 6.0 * t))
    with pytest.raises(bd.BeamdaeError, match=r"such as slider-cranks, .* bd.run_up"):
        bd.simulate(mech, t_end=0.1, start=bd.rotation(6.0))


def test_regression_rotations_of_rotors_on_guided_bases_do_not_blame_the_driver():
    """The remedy was to use the speed of the driver, which the rotation had."""
    mech = bd.Mechanism()
    origin = mech.ground.at(0.0, 0.0)
    base = mech.add(bd.RigidBody("base", 5.0, 0.1, center=(0.0, 0.0)))
    foot = base.at(0.0, 0.0)
    mech.add(bd.Prismatic("guide", origin, foot, (0.0, 1.0)))
    shaking = bd.TranslationalDriver(
        "shaker", origin, foot, lambda t: 1e-3 * np.sin(90.0 * t), direction=(0.0, 1.0)
    )
    mech.add(shaking)
    hub = mech.add(bd.RigidBody("hub", 1.0, 0.01, center=(0.0, 0.0)))
    mech.add(bd.Revolute("axle", foot, hub.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", foot, hub.at(0.0, 0.0), lambda t: 60.0 * t))
    message = (
        r"start: .* does not allow .* turns all parts as one body, .* bd.run_up .* start=\{...\}"
    )
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.simulate(mech, t_end=0.1, start=bd.rotation(60.0))
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.simulate(mech, t_end=0.1, start=bd.rotation(60.0, (0.1, 0.0)))
    assert bd.simulate(mech, t_end=1e-3, start={"hub.angle_dot": 60.0}).status.success


@pytest.mark.parametrize("typed", [1256.64, 1256.637, 1256.637061])
def test_regression_speeds_rounded_to_six_digits_are_those_of_the_driver(typed):
    """A speed of 1256.637 for 12000 rpm was rejected, without the speed of the driver."""
    speed = 12000.0 * np.pi / 30.0
    mech, hub = driven(bd.RigidBody("hub", 1.0, 0.01, center=(0.0, 0.0)), lambda t: speed * t)
    mech.observe("hub", hub.at(0.1, 0.0))
    run = bd.simulate(mech, t_end=1e-4, start=bd.rotation(typed))
    assert run["hub.angle_dot"].iloc[0] == pytest.approx(speed, rel=1e-12)
    with pytest.raises(
        bd.BeamdaeError, match=r"at 1257 rad/s .* speed of the drivers, 1256\.637061"
    ):
        bd.simulate(mech, t_end=1e-4, start=bd.rotation(1257.0))
