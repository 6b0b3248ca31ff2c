"""Frames with rigid corners, closed rings, and beams welded from several bodies."""

import numpy as np
import pytest
from mechanisms import rectangle
from numpy.testing import assert_allclose
from support import ARC, SOFT_MATERIAL, NumericEquations

import beamdae as bd

SLENDER = rectangle(0.001, 0.002)


def static_displacement(mech):
    """Return a function that maps an observable to its change under small loads."""
    numeric = NumericEquations(mech)
    stiffness, joint = numeric.stiffness(), numeric.constraint_matrix()
    assert np.linalg.matrix_rank(joint) == numeric.m
    saddle = np.block([[stiffness, joint.T], [joint, np.zeros((numeric.m, numeric.m))]])
    right = np.concatenate([-numeric.force(), np.zeros(numeric.m)])
    # Axial stiffness is 1e7 times the bending stiffness; scaling limits rounding errors.
    diagonal = np.sqrt(np.abs(np.diag(saddle)))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    solution = np.linalg.solve(saddle / np.outer(scale, scale), right / scale) / scale
    q = numeric.equations.q0 + solution[: numeric.n]
    return lambda name: numeric.observed(name, q=q) - numeric.observed(name)


def test_sway_of_a_portal_frame():
    """Slope deflection: P h^3 (4 + 6 k) / (24 EI (1 + 6 k)), k the beam's I / l over a column's."""
    height, span, load = 1.0, 2.0, 1e-3
    stiff = rectangle(0.001, 0.004)
    mech = bd.Mechanism()
    corners = {"A": (0.0, 0.0), "B": (0.0, height), "C": (span, height), "D": (span, 0.0)}
    members = [("A", "B"), ("B", "C", stiff), ("D", "C")]
    portal = bd.frame(mech, "portal", corners, members, SLENDER, elements=1)
    for foot in "AD":
        mech.add(bd.Weld(f"clamp {foot}", mech.ground.at(*corners[foot]), portal.corners[foot]))
    mech.add(bd.Force("wind", portal.corners["B"], (load, 0.0)))
    mech.observe("B", portal.corners["B"])
    mech.observe("C", portal.beams["D", "C"].end)
    k = 2.0 * height / span
    expected = load * height**3 * (4.0 + 6.0 * k) / (24.0 * SLENDER.EI * (1.0 + 6.0 * k))
    change = static_displacement(mech)
    # Axial and shear flexibility contribute a few times (0.001 / 1)^2.
    assert_allclose([change("B")[0], change("C")[0]], expected, rtol=1e-5)


def test_points_without_a_member_are_reported():
    points = {"A": (0.0, 0.0), "B": (1.0, 0.0), "C": (1.0, 1.0)}
    with pytest.warns(bd.BeamdaeWarning, match="portal: no member uses point 'C', so the frame"):
        portal = bd.frame(bd.Mechanism(), "portal", points, ["AB"], SLENDER, elements=1)
    assert list(portal.corners) == ["A", "B"]


def test_star_of_three_members():
    """A star of three clamped arms turns by M / (3 * 4 EI / l), in any order of the arms."""
    turns = np.radians([90.0, 210.0, 330.0])
    points = {f"P{k}": (np.cos(t), np.sin(t)) for k, t in enumerate(turns)} | {"O": (0.0, 0.0)}
    for members in (
        [("O", "P0"), ("O", "P1"), ("P2", "O")],
        [("P2", "O"), ("P0", "O"), ("O", "P1")],
    ):
        mech = bd.Mechanism()
        star = bd.frame(mech, "star", points, members, SLENDER, elements=1)
        assert [n for n in mech.parts if "-" not in n] == ["star O", "star O 2"]
        for k in range(3):
            mech.add(bd.Weld(f"clamp {k}", mech.ground.at(*points[f"P{k}"]), star.corners[f"P{k}"]))
        mech.add(bd.Moment("moment", star.corners["O"], 1e-3))
        mech.observe("O", star.corners["O"])
        # Shear flexibility contributes a few times (0.001 / 1)^2.
        assert_allclose(static_displacement(mech)("O")[2], 1e-3 / (12.0 * SLENDER.EI), rtol=1e-4)


@pytest.mark.parametrize("bodies", [2, 4, 8])
def test_pinched_ring(bodies):
    """Shortening along the loads and growth across them by Castigliano (Timoshenko)."""
    radius, load = 0.5, 1e-3
    section = rectangle(0.05, 0.01)
    mech = bd.Mechanism()
    # The ring starts at its lowest point.
    hoop = bd.Arc(radius=radius, length=2.0 * np.pi * radius, start=(0.0, -radius))
    ring = bd.welded_beams(mech, "ring", hoop, section, bodies, closed=True, elements=32 // bodies)
    assert f"ring {bodies} to ring 1" in mech.parts
    mech.add(bd.Weld("bottom", mech.ground.at(0.0, -radius), ring[0].start))
    mech.add(bd.Force("load", ring[bodies // 2].start, (0.0, -load)))
    mech.observe("top", ring[bodies // 2].start)
    quarter = ring[0].length * bodies / 4.0
    for side, turns in (("right", 1.0), ("left", 3.0)):
        k, s = divmod(turns * quarter, ring[0].length)
        mech.observe(side, ring[round(k)].at(s) if bodies < 4 else ring[round(k)].start)
    change = static_displacement(mech)
    bend, x = load * radius**3 / section.EI, section
    stretch = np.pi * load * radius / 4.0 * (1.0 / x.EA + 1.0 / x.GA)
    approach = bend * (np.pi / 4.0 - 2.0 / np.pi) + stretch
    growth = bend * (2.0 / np.pi - 0.5) + load * radius / 2.0 * (1.0 / x.GA - 1.0 / x.EA)
    # Discretization error with 8 elements per quarter: 7e-7.
    assert_allclose(-change("top")[1], approach, rtol=1e-6)
    assert_allclose(change("right")[0] - change("left")[0], growth, rtol=2e-6)


SECTION = bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05)


def weld_rod(bodies, **settings):
    mech = bd.Mechanism()
    return mech, bd.welded_beams(mech, "rod", ARC, SECTION, bodies, **settings)


def test_one_body_is_a_single_beam():
    mech, (beam,) = weld_rod(1, elements=3, strain="linear")
    assert list(mech.parts) == ["rod"]
    assert beam.mesh.elements == 3
    assert beam.kinematics.strain == "linear"
    assert beam.curve is ARC


def test_bodies_are_parts_of_the_curve_in_order():
    mech, beams = weld_rod(3, elements=2, frame="chord")
    assert list(mech.parts) == ["rod 1", "rod 2", "rod 3", "rod 1 to rod 2", "rod 2 to rod 3"]
    assert [beam.mesh.elements for beam in beams] == [2, 2, 2]
    assert {beam.kinematics.frame for beam in beams} == {"chord"}
    assert_allclose(
        [beam.length for beam in beams], ARC.length / 3.0, rtol=1e-14
    )  # rounding errors
    ends = [beams[0].start.point, *(beam.end.point for beam in beams)]
    assert_allclose(ends, ARC.point(np.linspace(0.0, ARC.length, 4)), atol=1e-14)


@pytest.mark.slow(reason="three equilibria")
def test_static_deflection_does_not_depend_on_the_number_of_bodies():
    """The load is so small that quadratic strains do not matter."""
    tips = []
    for bodies in (1, 2, 4):
        mech, beams = weld_rod(bodies, elements=8 // bodies)
        mech.add(bd.Weld("clamp", mech.ground.at(*ARC.start), beams[0].start))
        mech.add(bd.Force("load", beams[-1].end, (0.0, -1e-6)))
        mech.observe("tip", beams[-1].end)
        tips.append(bd.equilibrium(mech).table()[["tip.x [m]", "tip.y [m]"]].iloc[-1])
    displacements = np.array(tips) - ARC.point(ARC.length)
    # The elements are the same, and separate frames change nothing in the linear limit. Quadratic
    # strains contribute 1e-8.
    assert_allclose(displacements[1:], displacements[[0, 0]], rtol=1e-7)


@pytest.mark.parametrize("bodies", [0, -1, 2.5])
def test_invalid_number_of_bodies_is_rejected(bodies):
    with pytest.raises(bd.BeamdaeError, match="rod: bodies must be a whole number of at least 1"):
        weld_rod(bodies)
