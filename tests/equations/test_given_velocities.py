"""Velocities that are given as zero differ from velocities that are not given."""

import numpy as np
import pytest
from mechanisms import hinged, rectangle

import beamdae as bd

SPEED = 2.0


def double_pendulum(**second):
    """Two rods of 1 m; the first one turns at `SPEED`."""
    mech = bd.Mechanism()
    first = bd.RigidBody.rod("a", (0.0, 0.0), (1.0, 0.0), mass=1.0, angular_velocity=SPEED)
    first = mech.add(first)
    second = mech.add(bd.RigidBody.rod("b", (1.0, 0.0), (2.0, 0.0), mass=1.0, **second))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), first.at(0.0, 0.0)))
    mech.add(bd.Revolute("joint", first.at(1.0, 0.0), second.at(1.0, 0.0)))
    mech.observe("tip", second.at(2.0, 0.0))
    return mech


@bd.model(t_end=0.02)
def pendulum(speed=0.0):
    return double_pendulum(angular_velocity=speed)


def start_speed(mech):
    run = bd.simulate(mech, bd.Radau(1e-8), 1e-3)
    return run["tip.angle_dot"].iloc[0], run


def test_regression_zero_angular_velocity_is_kept():
    # Least kinetic energy of the second rod: -1.5 SPEED.
    assert start_speed(double_pendulum())[0] == pytest.approx(-1.5 * SPEED)
    values = [start_speed(double_pendulum(angular_velocity=w))[0] - w for w in (-1e-6, 0.0, 1e-6)]
    assert np.max(np.abs(values)) < 1e-9


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_derivative_by_a_velocity_that_is_zero():
    run = bd.sensitivities(pendulum, "speed", bd.GeneralizedAlpha(2e-3), output_step=1e-2)
    assert run.columns.observed["speed"]["tip.angle_dot [rad/s]"][0] == pytest.approx(1.0)


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_regression_beams_keep_a_given_zero(formulation):
    crank = bd.RigidBody.rod("crank", (0.0, 0.0), (1.0, 0.0), mass=1.0, angular_velocity=SPEED)
    mech, crank = hinged(crank)
    steel = rectangle(0.02)
    line = bd.Line((1.0, 0.0), (2.0, 0.0))
    beam = bd.Beam("rod", line, steel, 2, formulation=formulation, angular_velocity=0.0)
    beam = mech.add(beam)
    mech.add(bd.Revolute("joint", crank.at(1.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    speed, run = start_speed(mech)
    assert speed == pytest.approx(0.0, abs=1e-6)
    assert run["tip.y_dot"].iloc[0] == pytest.approx(SPEED, rel=1e-6)


def test_regression_contradicting_zeros_have_a_warning():
    motion = {"velocity": (0.0, 0.0), "angular_velocity": SPEED}
    mech, _ = hinged(bd.RigidBody.rod("rod", (0.0, 0.0), (1.0, 0.0), mass=1.0, **motion))
    with pytest.warns(bd.BeamdaeWarning, match=r"rod: the joints do not allow .* rod\.y_dot"):
        bd.simulate(mech, bd.Radau(1e-6), 1e-3)


def test_regression_rounding_errors_of_given_zeros_have_no_warning():
    """A pendulum that translates with its base turned at 1e-12 rad/s "instead of 0 rad/s"."""
    mech = bd.Mechanism()
    base = mech.add(bd.RigidBody("base", mass=1.0, inertia=0.01))
    mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.0), base.at(0.0, 0.0), (0.0, 1.0)))
    shaker = bd.sine(0.02, 60.0)
    ends = (mech.ground.at(0.0, 0.0), base.at(0.0, 0.0))
    mech.add(bd.TranslationalDriver("shaker", *ends, shaker, (0.0, 1.0)))
    rod = bd.RigidBody.rod("rod", (0.0, 0.0), (0.06, 0.29), mass=0.1, angular_velocity=0.0)
    mech.add(bd.Revolute("hinge", base.at(0.0, 0.0), mech.add(rod).at(0.0, 0.0)))
    mech.observe("tip", rod.at(0.06, 0.29))
    speed, run = start_speed(mech)
    assert abs(speed) < 1e-9
    assert not any("the joints do not allow" in x for x in run.warnings)
