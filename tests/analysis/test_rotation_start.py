"""Starts in steady rotation: runs and periodic motions of turning beams."""

import numpy as np
import pytest

import beamdae as bd

SPEED = 5.0  # [rad/s]
STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)


def driven_beam(gravity=0.0, **settings):
    """Return a beam whose root is driven at a constant speed."""
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.002, damping=1e-4)
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements=2, **settings))
    root = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", root, beam.start))
    mech.add(bd.Driver("motor", root, beam.start, lambda t: SPEED * t))
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


def test_periodic_motion_of_a_turning_beam():
    # As drawn, only the root turns, and the beam whips.
    period = 2.0 * np.pi / SPEED
    mechanism = driven_beam(strain="exact")
    motion = bd.periodic(mechanism, period, start=bd.rotation(SPEED), settle=0)
    assert motion.status.success
    assert motion.stable
    # Modes of the damped beam in steady rotation: multipliers exp(lambda T).
    modes = bd.modes(mechanism, bd.rotation(SPEED), 1)
    growth = -2.0 * np.pi * modes.frequencies[0] * modes.damping_ratios[0]
    assert np.abs(motion.multipliers[0]) == pytest.approx(np.exp(growth * period), rel=1e-4)


def test_weight_acts_as_at_the_start():
    solution = bd.simulate(driven_beam(9.81, strain="exact"), t_end=0.01, start=bd.rotation(SPEED))
    assert solution.status.success
    assert solution["tip.y"].iloc[0] < -1e-3


def test_mechanism_with_a_start_in_rotation():
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.02)
    mech = bd.Mechanism(start=bd.rotation(2.0, center=(0.5, 0.0)))
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements=2, formulation="exact"))
    mech.observe("end", beam.start)
    solution = bd.simulate(mech, t_end=0.5 * np.pi)
    # Half a revolution of a free beam about its center.
    assert solution["end.x"].iloc[-1] == pytest.approx(1.0, abs=1e-4)
    assert solution["end.y"].iloc[-1] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("start", [bd.rotation(4.0), bd.rotation(SPEED, (0.1, 0.0))])
def test_rotation_that_contradicts_a_joint_is_rejected(start):
    with pytest.raises(bd.BeamdaeError, match=r"does not allow a rotation at .* use the speed of"):
        bd.simulate(driven_beam(strain="exact"), t_end=0.1, start=start)
