"""Mechanism: parts, observables and error messages."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import ARC, VARIANTS, NumericEquations

import beamdae as bd
from beamdae.parts.attachments import largest_distance

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


def test_duplicate_names_are_rejected():
    mech = bd.Mechanism()
    first = mech.add(disk())
    for again in (disk(), first, bd.PointMass("disk", 1.0, at=(0.0, 0.0))):
        with pytest.raises(bd.BeamdaeError, match=f"the name '{again.name}' is in use"):
            mech.add(again)
    assert list(mech.parts) == ["disk"]


def test_parts_of_unknown_bodies_are_rejected():
    mech, other = bd.Mechanism(), bd.Mechanism()
    stranger = disk("stranger")
    here, hub = mech.ground.at(0.0, 0.0), stranger.at(0.0, 0.0)
    for part in (
        bd.Revolute("pin", here, hub),
        bd.Driver("motor", hub, here, law=0.0),
        bd.Force("push", hub, (1.0, 0.0)),
        bd.Moment("twist", hub, 1.0),
        bd.PointMass("load", 1.0, on=hub),
    ):
        with pytest.raises(
            bd.BeamdaeError,
            match=f"{part.name}: 'stranger' is not part",
        ):
            mech.add(part)
    mech.add(stranger)
    with pytest.raises(bd.BeamdaeError, match="pin: the ground belongs to another mechanism"):
        mech.add(bd.Revolute("pin", other.ground.at(0.0, 0.0), hub))
    assert list(mech.parts) == ["stranger"]


@pytest.mark.parametrize("thing", ["disk", 3.0, None, ARC, bd.RigidBody])
def test_only_parts_can_be_added(thing):
    match = "Mechanism: only parts .subclasses of beamdae.Part. can be added, got"
    with pytest.raises(bd.BeamdaeError, match=match):
        bd.Mechanism().add(thing)


def test_the_name_of_the_ground_is_reserved():
    for part in (disk("ground"), bd.Mechanism().ground):
        with pytest.raises(bd.BeamdaeError, match="'ground' is reserved for the fixed ground"):
            bd.Mechanism().add(part)


def test_observing():
    mech = bd.Mechanism()
    body = mech.add(disk())
    mech.observe("hub", body.at(0.0, 0.0))
    for name, problem in {
        "hub": "in use;",
        "t": "reserved for the time;",
        "energy": "reserved for the energy balance;",
    }.items():
        with pytest.raises(bd.BeamdaeError, match=f"the observable name '{name}' is {problem}"):
            mech.observe(name, body.at(1.0, 0.0))
    for name in ("", "  ", 3, None):
        with pytest.raises(bd.BeamdaeError, match="the name must be a non-empty string"):
            mech.observe(name, body.at(1.0, 0.0))
    with pytest.raises(bd.BeamdaeError, match="rim: only attachments and quantities such as"):
        mech.observe("rim", body)
    stranger = disk("stranger")
    with pytest.raises(bd.BeamdaeError, match="rim: 'stranger' is not part"):
        mech.observe("rim", stranger.at(0.0, 0.0))
    pin = bd.Revolute("pin", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0))
    with pytest.raises(
        bd.BeamdaeError, match="pin force: the joint 'pin' is not part of this mechanism"
    ):
        mech.observe("pin force", pin.reaction)
    mech.add(pin)
    mech.observe("pin force", pin.reaction)
    assert list(mech.observables) == ["hub", "pin force"]


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


def test_part_lookup_hints_at_the_nearest_name():
    mech = bd.Mechanism()
    mech.add(disk("flywheel"))
    with pytest.raises(bd.BeamdaeError, match=r"no part 'flywheal' \(did you mean 'flywheel'\?\)"):
        mech.part("flywheal")
    with pytest.raises(bd.BeamdaeError, match=r"there is no part 'zzz'; see mechanism.parts"):
        mech.part("zzz")


class Fixture(bd.Part):
    name = "fixture"


def test_a_mechanism_without_moving_bodies_is_rejected():
    mech = bd.Mechanism()
    for _ in range(2):
        with pytest.raises(bd.BeamdaeError, match="there is no body that can move"):
            bd.equations_of_motion(mech)
        if not mech.parts:
            mech.add(Fixture())


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


def test_characteristic_length_is_the_extent_of_the_drawing():
    mech = bd.Mechanism()
    body = mech.add(disk(center=(1.0, 1.0)))
    assert bd.equations_of_motion(mech).length == 1.0
    mech.add(bd.Revolute("pin", mech.ground.at(1.0, -3.0), body.at(1.0, -3.0)))
    assert bd.equations_of_motion(mech).length == 4.0
    mech.add(VARIANTS[0].beam(bd.Line((0.0, 0.0), (-6.0, 0.0))))
    equations = bd.equations_of_motion(mech)
    # From (1, -3) to (-6, 0).
    extent = equations.length
    assert extent == pytest.approx(58.0**0.5, rel=1e-15)
    rotated = np.exp(0.8j) * np.array([1.0 + 1.0j, 1.0 - 3.0j, -6.0])
    assert largest_distance(np.array([rotated.real, rotated.imag]).T) == pytest.approx(
        extent, rel=1e-15
    )
    scales = dict(zip(equations.q_names, equations.position_scales, strict=True))
    assert scales["disk.x"] == scales["beam.y0"] == scales["beam.u1"] == extent
    assert scales["disk.angle"] == scales["beam.theta"] == scales["beam.phi3"] == 1.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: disk(mass=-1.0), "disk: mass must be positive, got -1"),
        (lambda: disk(mass=0.0), "disk: mass must be positive, got 0"),
        (lambda: disk(mass=nan), "disk: mass must be finite, got nan"),
        (lambda: disk(mass="heavy"), "disk: mass must be a number, got 'heavy'"),
        (lambda: disk(inertia=-0.5), "disk: inertia must be positive, got -0.5"),
        (lambda: disk(center=3.0), r"disk: center must be a pair \(x, y\), got 3.0"),
        (lambda: disk(center=(0.0, nan)), "disk: center y must be finite, got nan"),
        (lambda: disk(velocity=(nan, 0.0)), "disk: velocity x must be finite, got nan"),
        (lambda: disk(angular_velocity=np.inf), "disk: angular_velocity must be finite, got inf"),
        (lambda: disk(name=""), "RigidBody: the name must be a non-empty string, got ''"),
        (lambda: bd.PointMass("bob", -2.0, at=(0, 0)), "bob: mass must not be negative, got -2"),
        (lambda: bd.PointMass("bob", nan, at=(0, 0)), "bob: mass must be finite, got nan"),
        (lambda: bd.PointMass("bob", 0.0, at=(0, 0)), "bob: mass must be positive, got 0"),
        (
            lambda: bd.PointMass("bob", 1.0),
            r"bob: pass either on= \(an attachment\) or at=\(x, y\)",
        ),
        (
            lambda: bd.PointMass("bob", 1.0, on=disk().at(0, 0), at=(0, 0)),
            r"bob: pass either on= \(an attachment\) or at=\(x, y\)",
        ),
        (
            lambda: bd.PointMass("bob", 1.0, on=disk().at(0, 0), velocity=(1.0, 0.0)),
            r"bob: a mass on disk at \(0, 0\) has no velocity of its own",
        ),
        (lambda: bd.PointMass("bob", 1.0, on=disk()), "bob: on must be an attachment .*RigidBody"),
        (lambda: bd.PointMass("bob", 1.0, at=2.0), r"bob: at must be a pair \(x, y\), got 2.0"),
        (lambda: bd.PointMass("bob", 1.0, at=(nan, 0)), "bob: at x must be finite, got nan"),
        (
            lambda: bd.PointMass("bob", 1.0, at=(0, 0), velocity=(0.0, nan)),
            "bob: velocity y must be finite, got nan",
        ),
        (
            lambda: bd.Mechanism(gravity=9.81),
            r"Mechanism: gravity must be a pair \(x, y\), got 9.81",
        ),
        (lambda: bd.Mechanism(gravity=(0.0, nan)), "Mechanism: gravity y must be finite, got nan"),
    ],
)
def test_error_messages(make, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        make()


def test_regression_bodies_in_place_of_their_points_are_explained():
    """The message named the attachments of a beam only."""
    mech = bd.Mechanism()
    wheel = mech.add(bd.RigidBody("wheel", 1.0, 0.1))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    steel = bd.Material.of("steel")
    strip = bd.Section.rectangle(steel, width=0.01, height=0.01)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip, elements=2))
    for value, advice in (
        (wheel, r"a point of wheel: its \.at\(x, y\)\."),
        (ball, r"a point of ball: its \.point, if it is free\."),
        (beam, r"a point of beam: its \.start, \.end or \.at\(s\)\."),
        (mech, r"a point of it: mech\.ground\.at\(x, y\)\."),
        (mech.ground, r"a point of ground: mech\.ground\.at\(x, y\)\."),
    ):
        with pytest.raises(bd.BeamdaeError, match=f"^push: on must .*; pass {advice}$"):
            bd.Force("push", value, (1.0, 0.0))
    with pytest.raises(bd.BeamdaeError, match=r"^wheel: only attachments .* of wheel: its \.at"):
        mech.observe("wheel", wheel)


def test_regression_models_without_an_end_time_are_explained():
    """The decorator without parentheses raised a TypeError."""
    for decorate in (lambda: bd.model(lambda: bd.Mechanism()), bd.model):
        with pytest.raises(bd.BeamdaeError, match=r"^model: the end time .* @bd\.model\(t_end=1"):
            decorate()


def test_regression_end_times_without_a_name_are_explained():
    """The end time in @bd.model(2.5) was called missing, and signatures contained `*misplaced`."""
    with pytest.raises(bd.BeamdaeError, match=r"2\.5 has no name; .*: @bd\.model\(t_end=2\.5\)\.$"):
        bd.model(2.5)
    end_time = inspect.signature(bd.model).parameters["t_end"]
    assert end_time.kind is end_time.KEYWORD_ONLY
    assert end_time.default is end_time.empty
