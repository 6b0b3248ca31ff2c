"""Errors of moderate strains in floating frames fall with the number of frames as stated."""

import numpy as np
import pytest
from mechanisms import rectangle

import beamdae as bd

SECTION = rectangle(0.01, 1.0, material=bd.Material(E=1e7, nu=0.3, rho=1e3))


def roll_up_half(bodies, frame):
    """Return the tip of a clamped strip of 1 m under the moment of a half circle."""
    mech = bd.Mechanism()
    axis = bd.Line((0.0, 0.0), (1.0, 0.0))
    elements = max(8 // bodies, 2)
    settings = {"elements": elements, "frame": frame, "strain": "green"}
    beams = bd.welded_beams(mech, "beam", axis, SECTION, bodies, **settings)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beams[0].start))
    mech.add(bd.Moment("moment", beams[-1].end, np.pi * SECTION.EI))
    mech.observe("tip", beams[-1].end)
    path = bd.equilibrium(mech)
    assert path.status.success, path.status.sentence
    return [path.columns[f"tip.{name} [m]"][-1] for name in "xy"]


@pytest.mark.slow(reason="equilibria of six cantilevers")
@pytest.mark.parametrize(
    ("frame", "numbers", "order", "at_eight"),
    # Two tangent frames have a limit point at two thirds of the moment.
    [("chord", (2, 4, 8), 4.0, 3e-5), ("tangent", (4, 8, 16), 3.0, 2e-3)],
)
def test_error_of_half_a_roll_up_falls_at_the_stated_order(frame, numbers, order, at_eight):
    # A moment alone bends Reissner's strip to a circle.
    exact = np.array([0.0, 2.0 / np.pi])
    tips = [roll_up_half(bodies, frame) for bodies in numbers]
    errors = np.linalg.norm(tips - exact, axis=1) / np.linalg.norm(exact - [1.0, 0.0])
    assert np.all(-np.diff(np.log2(errors)) > order)
    assert errors[numbers.index(8)] < at_eight
