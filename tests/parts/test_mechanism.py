"""Mechanism: order of parts, headers, point masses and end times."""

import inspect

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import ARC, VARIANTS, NumericEquations

import beamdae as bd

nan = float("nan")


def disk(name="disk", **words):
    return bd.RigidBody(name, **({"mass": 1.0, "inertia": 1.0} | words))


def test_parts_keep_their_order_and_are_accessible_by_name():
    mech = bd.Mechanism()
    wheel, bob = mech.add(disk("wheel")), mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
    pin = mech.add(bd.Revolute("pin", mech.ground.at(1.0, 0.0), bob.point))
    assert list(mech.parts) == ["wheel", "bob", "pin"]
    assert mech.part("wheel") is wheel
    assert mech.part("pin") is pin
    equations = bd.equations_of_motion(mech)
    assert equations.q_names == ("wheel.x", "wheel.y", "wheel.angle", "bob.x", "bob.y")
    assert equations.lam_names == ("pin.x", "pin.y")


def test_headers_name_columns_and_units():
    mech = bd.Mechanism()
    body = mech.add(disk())
    beam = mech.add(VARIANTS[0].beam(ARC))
    bob = mech.add(bd.PointMass("bob", 1.0, at=(0.0, 0.0)))
    mech.observe("hub", body.at(0.0, 0.0))
    mech.observe("bob", bob.point)
    mech.observe("gauge", beam.strain(0.5, offset=0.1))
    mech.observe("root", beam.section_forces(0.0))
    headers = [h for o in bd.equations_of_motion(mech).observables for h in o.headers]
    assert headers == [
        *("hub.x [m]", "hub.y [m]", "hub.angle [rad]"),
        *("hub.x_dot [m/s]", "hub.y_dot [m/s]", "hub.angle_dot [rad/s]"),
        *("bob.x [m]", "bob.y [m]", "bob.x_dot [m/s]", "bob.y_dot [m/s]"),
        "gauge [-]",
        *("root.N [N]", "root.Q [N]", "root.M [N m]"),
    ]


def test_free_and_fixed_point_masses():
    mech = bd.Mechanism(gravity=(1.0, -2.0))
    body = mech.add(disk(mass=2.0, inertia=0.5))
    mech.add(bd.PointMass("fixed", 3.0, on=body.at(0.0, 2.0)))
    free = mech.add(bd.PointMass("free", 4.0, at=(5.0, 6.0), velocity=(7.0, 8.0)))
    numeric = NumericEquations(mech)
    assert numeric.equations.q_names[3:] == ("free.x", "free.y")
    assert_allclose(numeric.equations.q0[3:], (5.0, 6.0), rtol=0.0)
    assert_allclose(numeric.equations.v0[3:], (7.0, 8.0), rtol=0.0)
    expected = np.diag([5.0, 5.0, 0.5 + 3.0 * 4.0, 4.0, 4.0])
    expected[0, 2] = expected[2, 0] = -3.0 * 2.0
    assert_allclose(numeric.mass(), expected, atol=1e-14)  # rounding
    # Weights, and the clockwise moment of gravity along x on the fixed mass at the arm (0, 2).
    assert_allclose(-numeric.force(), [5.0, -10.0, -6.0, 4.0, -8.0], atol=1e-14)
    assert free.point.point == (5.0, 6.0)
    massless = bd.PointMass("nothing", 0.0, on=body.at(0.0, 0.0))
    assert massless.coordinates == ()


def test_regression_models_without_an_end_time_are_explained():
    """The decorator without parentheses raised a TypeError."""
    for decorate in (lambda: bd.model(lambda: bd.Mechanism()), bd.model):
        with pytest.raises(bd.BeamdaeError, match=r"^model: the end time .* @bd\.model\(t_end=1"):
            decorate()


def test_regression_end_times_without_a_name_are_explained():
    """Signatures contained `*misplaced`."""
    with pytest.raises(bd.BeamdaeError, match=r"^model: the end time .* @bd\.model\(t_end=1"):
        bd.model(2.5)
    end_time = inspect.signature(bd.model).parameters["t_end"]
    assert end_time.kind is end_time.KEYWORD_ONLY
