"""Mechanisms of all kinds of parts: every adaptive integrator keeps what rtol promises on them."""

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
# Positions and angles of what moves as a whole: those of one part seen from another are small
# differences, of which rtol promises less.
MOTIONS = {
    "four_bar": ["rocker.x [m]", "rocker.y [m]", "rocker.angle [rad]"],
    "quick_return": ["ram.x [m]", "lever.angle [rad]"],
    "leaf_spring_vehicle": ["chassis.y [m]", "axle.x [m]", "axle.y [m]"],
    "sliding_mass": ["s [m]", "bead.x [m]", "bead.y [m]", "tip.x [m]", "tip.y [m]"],
    "ring_mount": ["motor.x [m]", "motor.y [m]", "motor.angle [rad]"],
    "governor": ["rotor.angle [rad]", "energy.dissipated [J]"],
    "shallow_arch": ["crown.y [m]", "quarter.y [m]", "quarter.angle [rad]"],
}


@pytest.mark.slow(reason="three integrators on each model")
@pytest.mark.parametrize("name", MOTIONS)
def test_integrators_agree_within_100_rtol(name):
    model, columns = MODELS[name], MOTIONS[name]
    # Off by 1e-5 of the range at most, by Radau(1e-9).
    exact = bd.simulate(model, bd.Radau(1e-7)).table()
    for label, integrator in ADAPTIVE.items():
        found = bd.simulate(model, integrator).table()
        # The last row of a run that an event stops is at its own time.
        rows = len(exact) - 1
        assert len(found) == len(exact)
        np.testing.assert_array_equal(found["t [s]"][:rows], exact["t [s]"][:rows])
        off = np.max(np.abs(found[columns][:rows] - exact[columns][:rows]), axis=0)
        share = off / (0.5 * np.ptp(exact[columns], axis=0))
        assert share.max() < 100.0 * RTOL, (label, share.to_dict())


# Those with many unknowns in the slow run.
LARGE = {"leaf_spring_vehicle", "ring_mount", "sliding_mass"}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] if name in LARGE else []) for name in MOTIONS],
)
def test_nothing_is_wrong_with_a_model(name):
    found = bd.check(MODELS[name])
    assert not found.problem
    assert not found.dependent
