"""Every adaptive integrator meets its tolerance on mechanisms of all kinds of parts."""

import numpy as np
import pytest
from conformance import tuned
from test_models import MODELS

import beamdae as bd

RTOL = 1e-5
ADAPTIVE = {
    label: integrator
    for label, integrator in tuned(rtol=RTOL, step=1e-3).items()
    if integrator.accuracy.name == "rtol"
}
# Absolute positions and angles: relative ones are small differences with larger relative errors.
MOTIONS = {
    "hub_beam": ["tip.x [m]", "tip.y [m]"],
    "four_bar": ["rocker.x [m]", "rocker.y [m]", "rocker.angle [rad]"],
    "quick_return": ["ram.x [m]", "lever.angle [rad]"],
    "leaf_spring_vehicle": ["chassis.y [m]", "axle.x [m]", "axle.y [m]"],
    "sliding_mass": ["s [m]", "bead.x [m]", "bead.y [m]", "tip.x [m]", "tip.y [m]"],
    "ring_mount": ["motor.x [m]", "motor.y [m]", "motor.angle [rad]"],
    "governor": ["rotor.angle [rad]", "energy.dissipated [J]"],
    "shallow_arch": ["crown.y [m]", "quarter.y [m]", "quarter.angle [rad]"],
    "voice_coil_stage": ["platform.x [m]", "platform.y [m]", "platform.x_dot [m/s]"],
    "inverted_pendulum": ["position [m]", "angle [rad]", "bob.x [m]"],
    "active_damping": ["end.x [m]", "end.y [m]", "end.angle [rad]"],
    "press": ["ram.y [m]", "wheel.angle [rad]", "wheel.angle_dot [rad/s]"],
}


@pytest.mark.slow(reason="three integrators on each model")
@pytest.mark.parametrize("name", MOTIONS)
def test_integrators_agree_within_100_rtol(name):
    model, columns = MODELS[name], MOTIONS[name]
    # Compared with Radau(1e-9), it is off by at most 1e-5 of the range.
    exact = bd.simulate(model, bd.Radau(1e-7)).table()
    for label, integrator in ADAPTIVE.items():
        table = bd.simulate(model, integrator).table()
        # A run stopped by an event ends at the time of the event.
        rows = len(exact) - 1
        assert len(table) == len(exact)
        np.testing.assert_array_equal(table["t [s]"][:rows], exact["t [s]"][:rows])
        error = np.max(np.abs(table[columns][:rows] - exact[columns][:rows]), axis=0)
        relative_error = error / (0.5 * np.ptp(exact[columns], axis=0))
        assert relative_error.max() < 100.0 * RTOL, (label, relative_error.to_dict())


# Models with many unknowns are left to the slow tests.
LARGE = {"leaf_spring_vehicle", "ring_mount", "sliding_mass"}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] if name in LARGE else []) for name in MOTIONS],
)
def test_check_reports_no_problem(name):
    check = bd.check(MODELS[name])
    assert not check.problem
    assert not check.dependent
