"""A beam cut into several."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import ARC, SOFT

import beamdae as bd

SECTION = bd.Section(SOFT, area=0.9, second_moment=0.05)


def cut(bodies, **settings):
    mech = bd.Mechanism()
    return mech, bd.welded_beams(mech, "rod", ARC, SECTION, bodies, **settings)


def test_one_body_is_a_beam_of_that_name():
    mech, (beam,) = cut(1, elements=3, strain="linear")
    assert list(mech.parts) == ["rod"]
    assert beam.mesh.elements == 3
    assert beam.kinematics.strain == "linear"
    assert beam.curve is ARC


def test_several_bodies_follow_each_other_along_the_curve():
    mech, beams = cut(3, elements=2, frame="chord")
    assert list(mech.parts) == ["rod 1", "rod 2", "rod 3", "rod 1 to rod 2", "rod 2 to rod 3"]
    assert [beam.mesh.elements for beam in beams] == [2, 2, 2]
    assert {beam.kinematics.frame for beam in beams} == {"chord"}
    assert_allclose([beam.length for beam in beams], ARC.length / 3.0, rtol=1e-14)  # rounding
    ends = [beams[0].start.point, *(beam.end.point for beam in beams)]
    assert_allclose(ends, ARC.point(np.linspace(0.0, ARC.length, 4)), atol=1e-14)


def test_static_deflection_does_not_depend_on_the_cuts():
    """Under a load so small that the quadratic strains do not matter."""
    turns = []
    for bodies in (1, 2, 4):
        mech, beams = cut(bodies, elements=8 // bodies)
        mech.add(bd.Weld("clamp", mech.ground.at(*ARC.start), beams[0].start))
        mech.add(bd.Force("load", beams[-1].end, (0.0, -1e-6)))
        mech.observe("tip", beams[-1].end)
        for beam in beams:
            mech.add(bd.RayleighDamping(f"{beam.name} damping", beam, mass=8.0, stiffness=0.5))
        solution = bd.simulate(mech, bd.GeneralizedAlpha(0.1), t_end=60.0, output_step=60.0)
        turns.append(solution.observed[["tip.x [m]", "tip.y [m]", "tip.angle [rad]"]].iloc[-1])
    moved = np.array(turns) - [*ARC.point(ARC.length), ARC.tangent_angle(ARC.length)]
    # The same elements; frames of their own change nothing in the linear limit (1e-8 is what the
    # quadratic strains and what is left of the motion after 60 s make).
    assert_allclose(moved[1:], moved[[0, 0]], rtol=1e-7)


@pytest.mark.parametrize("bodies", [0, -1, 2.5])
def test_refuses_what_is_no_number_of_bodies(bodies):
    with pytest.raises(bd.BeamdaeError, match="rod: bodies must be a whole number of at least 1"):
        cut(bodies)
