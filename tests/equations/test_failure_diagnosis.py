"""Failed runs name the parts that are likely to cause the failure."""

from __future__ import annotations

import numpy as np
import pytest
from conformance import integrators

import beamdae as bd


@integrators(1e-5, 1e-3)
def test_a_locking_mechanism_names_its_joints(integrator):
    """The crank is longer than the rod: after 0.26 s, the rod cannot follow the motor."""
    mech = bd.Mechanism()
    crank = mech.add(bd.RigidBody("crank", 1.0, 0.1, center=(0.5, 0.0)))
    rod = mech.add(bd.RigidBody("rod", 1.0, 0.1, center=(1.35, 0.0)))
    hub = (mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0))
    mech.add(bd.Revolute("bearing", *hub))
    mech.add(bd.Driver("motor", *hub, law=lambda t: 3.0 * t))
    mech.add(bd.Revolute("pin", crank.at(1.0, 0.0), rod.at(1.0, 0.0)))
    mech.add(bd.PointOnLine("guide", mech.ground.at(1.7, 0.0), rod.at(1.7, 0.0)))
    with pytest.warns(bd.BeamdaeWarning):
        status = bd.simulate(mech, integrator, 1.0).status
    assert status.kind == "failed"
    assert "stopped at t = 0.258" in status.sentence
    assert "near a singular position of bearing, motor, pin, guide;" in status.sentence
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
