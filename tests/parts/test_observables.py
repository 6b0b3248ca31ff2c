"""Displacements of a section relative to another body."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hub_beam import hub_beam
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from support import ARC, VARIANTS, NumericEquations, random_state

import beamdae as bd

CENTER = (-0.4, 0.1)
# The motion of a section relative to its body does not depend on strain and quadrature.
FIELDS = [v for v in VARIANTS if v.strain == "nonlinear" and v.damping > 0.0]


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def on_a_hub(variant, bodies):
    """Return a beam cut into `bodies` and welded to a disk, with its displacements observed."""
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", mass=1.1, inertia=0.4, center=CENTER))
    root = previous = hub.at(*ARC.start)
    cuts = np.linspace(0.0, ARC.length, bodies + 1)
    for k, (start, end) in enumerate(pairwise(cuts)):
        beam = mech.add(variant.beam(bd.Segment(ARC, start, end), name=f"beam {k}"))
        mech.add(bd.Weld(f"weld {k}", previous, beam.start))
        previous = beam.end
        mech.observe(f"end {k}", bd.relative_displacement(of=previous, on=root))
    return mech


@pytest.mark.parametrize("variant", [v for v in FIELDS if v.frame == "tangent"], ids=str)
def test_displacement_relative_to_its_root_is_the_deformation_of_a_beam(variant):
    mech = on_a_hub(variant, bodies=1)
    hub, beam = mech.part("hub"), mech.part("beam 0")
    roots = {"start": beam.start, "hub": hub.at(*ARC.start)}
    places = (0.0, 0.35 * ARC.length, ARC.length)
    for s in places:
        mech.observe(f"own {s}", beam.deformation(s))
        for name, root in roots.items():
            mech.observe(f"{name} {s}", bd.relative_displacement(of=beam.at(s), on=root))
    numeric = NumericEquations(mech)
    q, _, _ = random_state(numeric, seed=0)
    # The floating frame is at the root, which the hub carries.
    q[3:5] = q[:2] + rotation(q[2]) @ np.subtract(ARC.start, CENTER)
    q[5] = ARC.angle + q[2]
    for s in places:
        deformation = numeric.observed(f"own {s}", q=q)
        assert (np.linalg.norm(deformation) > 0.05) == (s > 0.0)
        for name in roots:
            # Rounding error.
            assert_allclose(numeric.observed(f"{name} {s}", q=q), deformation, atol=1e-14)


@cache
def hub_of_three_beams(variant):
    return NumericEquations(on_a_hub(variant, bodies=3))


@given(
    turn=st.floats(-7.0, 7.0),
    shift=st.tuples(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0)),
    size=st.sampled_from([0.0, 0.15]),
    variant=st.sampled_from(FIELDS),
)
def test_rigid_motions_rotate_relative_displacements(turn, shift, size, variant):
    """There are none at rest, at any common place of the disk and the three beams."""
    numeric = hub_of_three_beams(variant)
    q, _, _ = random_state(numeric, seed=1, size=size)
    shifted = q.copy()
    for first in ("hub.x", "beam 0.x0", "beam 1.x0", "beam 2.x0"):
        i = numeric.index(first)
        shifted[i : i + 2] = rotation(turn) @ q[i : i + 2] + shift
        shifted[i + 2] += turn
    for k in range(3):
        here, there = (numeric.observed(f"end {k}", q=x) for x in (q, shifted))
        assert (np.abs(here).max() > 0.05) == (size > 0.0)
        # Rounding error at places up to 16 m away.
        assert_allclose(there[:2], rotation(turn) @ here[:2], atol=1e-13)
        assert_allclose(there[2], here[2], atol=1e-14)
        if size == 0.0:
            assert_allclose(there, 0.0, atol=1e-13)


def test_relative_displacement_of_disks_by_hand():
    mech = bd.Mechanism()
    table = mech.add(bd.RigidBody("table", mass=1.0, inertia=1.0, center=(1.0, 0.0)))
    cup = mech.add(bd.RigidBody("cup", mass=1.0, inertia=1.0, center=(3.0, 0.0)))
    of = cup.at(3.0, 1.0)
    mech.observe("on table", bd.relative_displacement(of=of, on=table.at(1.0, 1.0)))
    mech.observe("on ground", bd.relative_displacement(of=of, on=mech.ground.at(7.0, 7.0)))
    numeric = NumericEquations(mech)
    headers = [header for o in numeric.equations.observables for header in o.headers]
    assert headers[:3] == ["on table.u [m]", "on table.v [m]", "on table.phi [rad]"]
    # The table rotates by 90 degrees about (1, 0), which moves (1, 1) to (0, 0), (3, 1) to (0, 2).
    # The center of the cup moves to (3, 4), and it rotates by 180 degrees: its rim is at (3, 3).
    q = np.array([1.0, 0.0, 0.5 * np.pi, 3.0, 4.0, np.pi])
    assert_allclose(numeric.observed("on table", q=q), (3.0, 1.0, 0.5 * np.pi), atol=1e-14)
    assert_allclose(numeric.observed("on ground", q=q), (0.0, 2.0, np.pi), atol=1e-14)


@pytest.mark.parametrize("bodies", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_a_beam_cut_into_bodies_converges_to_one_beam_at_small_deformation(bodies):
    """The strains hold for moderate displacements, so each choice of frames is another model.

    Deviation of the tip over its amplitude, 8 elements in all, torque 1 and 0.1 N m (amplitudes of
    0.2 and 0.02 % of the length): 8.9e-5 and 8.4e-6 for 2 bodies, 1.05e-4 and 9.9e-6 for 4.
    """
    deviation = []
    for torque in (1.0, 0.1):
        one, several = (
            bd.simulate(
                hub_beam(bodies=n, elements=8 // n, torque=torque),
                bd.GeneralizedAlpha(1e-3, newton_tolerance=1e-7),
                t_end=1.0,
            ).observed[["deformation.u [m]", "deformation.v [m]"]]
            for n in (1, bodies)
        )
        amplitude = 0.5 * np.ptp(one.to_numpy(), axis=0)
        deviation.append(np.max(np.abs((one - several).to_numpy()), axis=0) / amplitude)
    # The strains leave out terms of one order more in the deformation than those they keep. Both
    # runs take the same steps on the same nodes, whose errors cancel: half the step changes 3e-4.
    assert np.max(deviation[0]) < 1.5e-4
    assert np.all(np.log10(np.divide(*deviation)) > 0.97)


DISK = bd.RigidBody("disk", mass=1.0, inertia=1.0)
BOB = bd.PointMass("bob", 1.0, at=(1.0, 2.0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: bd.relative_displacement(of=BOB.point, on=DISK.at(0.0, 0.0)),
            r"^relative_displacement: bob at \(1, 2\) is a particle without an angle\b.*\.$",
        ),
        (
            lambda: bd.relative_displacement(of=DISK.at(0.0, 0.0), on=BOB.point),
            r"^relative_displacement: bob at \(1, 2\) is a particle without an angle\b.*\.$",
        ),
        (
            lambda: bd.relative_displacement(of=DISK, on=DISK.at(0.0, 0.0)),
            "^relative_displacement: of must be an attachment such as beam.end, got RigidBody",
        ),
        (
            lambda: bd.relative_displacement(of=DISK.at(0.0, 0.0), on="hub"),
            r"^relative_displacement: on must be an attachment such as beam.end, got 'hub'\.$",
        ),
    ],
)
def test_error_messages(make, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        make()


def test_a_particle_on_a_body_has_the_angle_of_its_body():
    rider = bd.PointMass("rider", 1.0, on=DISK.at(2.0, 0.0))
    mech = bd.Mechanism()
    mech.add(DISK)
    mech.add(rider)
    mech.observe("rider", bd.relative_displacement(of=rider.point, on=DISK.at(0.0, 0.0)))
    numeric = NumericEquations(mech)
    # Rounding error; the body is rigid.
    assert_allclose(numeric.observed("rider", q=np.array([3.0, -1.0, 2.0])), 0.0, atol=1e-14)
