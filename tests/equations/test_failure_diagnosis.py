"""Failed runs name the parts that are likely to cause the failure."""

import numpy as np
import pytest
from conformance import integrators
from mechanisms import driven, free_ball, mass_on_rail

import beamdae as bd


@integrators(1e-5, 1e-3)
def test_a_locking_mechanism_names_its_joints(integrator):
    """The crank is longer than the rod: after 0.26 s, the rod cannot follow the motor."""
    mech, crank = driven(bd.RigidBody("crank", 1.0, 0.1, center=(0.5, 0.0)), lambda t: 3.0 * t)
    rod = mech.add(bd.RigidBody("rod", 1.0, 0.1, center=(1.35, 0.0)))
    mech.add(bd.Revolute("pin", crank.at(1.0, 0.0), rod.at(1.0, 0.0)))
    mech.add(bd.PointOnLine("guide", mech.ground.at(1.7, 0.0), rod.at(1.7, 0.0)))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, integrator, 1.0).status
    assert status.kind == "failed"
    assert "stopped at t = 0.258" in status.sentence
    assert "near a singular position of hinge, motor, pin, guide;" in status.sentence
    assert "rod.angle has the largest acceleration" in status.sentence


@integrators(1e-5, 1e-3)
def test_a_load_that_becomes_nan_names_the_coordinate(integrator):
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 1.0))
    mech.add(bd.RigidBody("other", 1.0, 1.0))
    mech.add(bd.Moment("twist", disk.at(0.0, 0.0), law=lambda t: np.sqrt(0.5 - t)))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, integrator, 1.0).status
    assert "the force on disk.angle is not finite after this time" in status.sentence
    assert "other" not in status.sentence


@pytest.mark.parametrize("step", [0.01, 0.03, 0.1])
def test_regression_friction_that_reverses_within_a_fixed_step_is_named(step):
    mech, mass = mass_on_rail(x=1.0, spring=(100.0, 0.0, 0.8))
    mech.add(bd.Force("load", mass.point, (bd.sine(1.0, frequency=0.1), 0.0)))

    def rub(at, t):
        speed = at.velocity[0]
        return -5.0 * speed / np.sqrt(speed**2 + 1e-8), 0.0

    mech.add(bd.ForceLaw("rubber", mass.point, rub))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, bd.GeneralizedAlpha(step), t_end=2.0).status
    assert f"the force of rubber changes abruptly within {step} s;" in status.sentence


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("gap", [1e-2, 0.5])
def test_regression_forces_that_become_infinite_are_named(power, gap):
    """An electrostatic force whose gap closed led to "check the model near this time"."""
    mech, mass = mass_on_rail()

    def attract(at, t):
        return gap / (1.0 - at.position[0] / gap) ** power, 0.0

    mech.add(bd.ForceLaw("electrode", mass.point, attract))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, bd.Radau(), 5.0).status
    assert status.kind == "failed"
    assert "the force of electrode changes abruptly within" in status.sentence


def test_fixed_steps_that_stop_at_sticking_name_the_friction():
    mech, foot = free_ball(mass=2.0, name="foot", gravity=9.81, velocity=(1.0, 0.0))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    damping = {"restitution": 0.5, "impact_speed": 0.1}
    friction = {"friction": 0.5, "friction_speed": 1e-4}
    mech.add(bd.Contact("sole", foot.point, floor, 1e5, **damping, **friction))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, bd.GeneralizedAlpha(step=1e-3), 0.5).status
    assert "the force of sole changes abruptly within 0.001 s;" in status.sentence
