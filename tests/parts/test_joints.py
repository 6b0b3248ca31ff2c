"""Joints: constraint levels along motions and virtual work of reactions."""

import numpy as np
import pytest
from conformance import JOINTS, NONHOLONOMIC, TIP
from mechanisms import EARTH
from numpy.testing import assert_allclose
from support import (
    ARC,
    EXACT_VARIANT,
    VARIANTS,
    NumericEquations,
)

import beamdae as bd

TANGENT, CHORD = VARIANTS[0], VARIANTS[2]


def parts(variant=TANGENT):
    """Return a mechanism with a disk and a beam that are not connected, and both bodies."""
    mech = bd.Mechanism(gravity=(0.2, -1.5))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(variant.beam(ARC))
    return mech, disk, beam


# Joints between points of bodies; for sliders on beams see test_sliding.
OF_POINTS = {x: make for x, make in JOINTS.items() if not x.startswith("sliding")} | NONHOLONOMIC
every_joint_of_points = pytest.mark.parametrize("make", OF_POINTS.values(), ids=list(OF_POINTS))
every_frame = pytest.mark.parametrize(
    "variant",
    [TANGENT, EXACT_VARIANT, pytest.param(CHORD, marks=pytest.mark.slow(reason="several runs"))],
    ids=["tangent", "exact", "chord"],
)


def jointed(make, variant=TANGENT):
    mech, disk, beam = parts(variant)
    joint = mech.add(make(mech, disk, beam))
    mech.observe("reaction", joint.reaction)
    return NumericEquations(mech), mech


@every_joint_of_points
@every_frame
def test_reactions_on_all_bodies_are_equivalent_to_the_constraint_forces(make, variant):
    """G^T lam equals the generalized forces of the reported loads, in both kinds of axes."""
    _, mech = jointed(make, variant)
    joint = mech.part("j")
    places = joint.points
    both = [(place, axes) for place in places for axes in ("inertial", "body")]
    for place, axes in both:
        mech.observe(f"{place} {axes}", joint.reaction_on(place, axes))
    numeric = NumericEquations(mech)
    rng = np.random.default_rng(2)
    q = numeric.equations.q0 + 0.3 * rng.standard_normal(numeric.n)
    lam = rng.standard_normal(numeric.m)
    reactions = {both: numeric.observed(" ".join(both), q=q, lam=lam) for both in both}
    for axes in ("inertial", "body"):
        loaded = bd.Mechanism(gravity=tuple(mech.gravity))
        loaded.ground = mech.ground
        for body in ("disk", "beam"):
            loaded.add(mech.part(body))
        for name, place in places.items():
            if place.body is mech.ground:
                continue
            *force, moment = reactions[name, axes].tolist()
            loaded.add(bd.Force(f"force {name}", place, tuple(force), axes))
            loaded.add(bd.Moment(f"moment {name}", place, moment))
        by_loads = NumericEquations(loaded).force(q) - numeric.force(q)
        assert_allclose(by_loads, numeric.reaction(q, lam=lam), atol=1e-12)  # rounding
    reported = numeric.observed("reaction", q=q, lam=lam)
    names = [column.name for column in joint.reaction.columns]
    assert_allclose(reported, -lam, rtol=1e-15)
    of_b = reactions.get(("b", "inertial"), (0.0, 0.0, 0.0))
    on_b = dict(zip(("Fx", "Fy", "M"), of_b, strict=True))
    for name, value in zip(names, reported, strict=True):
        if name in on_b:
            assert_allclose(on_b[name], value, atol=1e-14)  # rounding


def test_hand_rounded_coordinates_meet():
    _, disk, beam = parts()
    x, y = TIP
    joint = bd.Revolute("pin", disk.at(round(x, 7), round(y, 7)), beam.end)
    assert joint.reaction.columns == (("Fx", "N"), ("Fy", "N"))


@pytest.mark.parametrize("ground_first", [True, False])
def test_weld_carries_a_hanging_weight(ground_first):
    """Mass 2 kg with its center 1.5 m off the weld: force m g up, moment m g 1.5 m."""
    mech = bd.Mechanism(gravity=EARTH)
    arm = mech.add(bd.RigidBody("arm", mass=2.0, inertia=0.3, center=(1.5, 0.0)))
    ends = [mech.ground.at(0.0, 0.0), arm.at(0.0, 0.0)]
    weld = mech.add(bd.Weld("wall", *(ends if ground_first else ends[::-1])))
    mech.observe("wall", weld.reaction)
    reaction = bd.simulate(mech, bd.Radau(), t_end=0.1).observed.iloc[-1]
    sign = 1.0 if ground_first else -1.0
    assert_allclose(reaction, sign * 2.0 * 9.81 * np.array([0.0, 1.0, 1.5]), atol=1e-9)
