"""Equilibria of slender structures: very soft in bending, but not free to move."""

import warnings

import numpy as np
import pytest
from mechanisms import EARTH, portal_points, rectangle, welded_frame

import beamdae as bd


def strip(elements, height, joint=bd.Weld, end=(1.0, 0.0), **options):
    """Return a straight steel strip of 1 m from a joint, under its weight."""
    mech = bd.Mechanism(gravity=EARTH)
    section = rectangle(height)
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), end), section, elements, **options))
    mech.add(joint("support", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech


FORMULATIONS = pytest.mark.parametrize(
    "options", [{"formulation": "exact"}, {"strain": "exact"}], ids=["exact", "floating frame"]
)


@FORMULATIONS
@pytest.mark.filterwarnings("error::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize(("elements", "height"), [(10, 5e-5), (20, 1e-4)])
def test_thin_strip_is_not_free(options, elements, height):
    # Its bending stiffness is at most 1e-12 of the axial stiffness of an element.
    path = bd.equilibrium(strip(elements, height, **options), to=1e-4)
    assert path.status.success
    assert path.stable
    # rho A g L^4 / (8 EI) under 1e-4 of the weight.
    steel = bd.Material.of("steel")
    expected = -1e-4 * 9.81 * steel.rho / (8.0 * steel.E * height**2 / 12.0)
    assert path.columns["tip.y [m]"][-1] == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow(reason="half a second and more")
@FORMULATIONS
@pytest.mark.parametrize(("elements", "height"), [(20, 1e-2), (20, 1e-4), (8, 3e-5)])
@pytest.mark.parametrize("end", [(1.0, 0.0), (0.28, 0.96)])
def test_hinged_strip_hangs_down(options, elements, height, end):
    """The search for thin strips did not end."""
    # The larger models exceed the limit for dense matrices; the frame rotates without stiffness.
    path = bd.equilibrium(strip(elements, height, bd.Revolute, end, **options))
    assert path.stable
    assert path.columns["tip.y [m]"][-1] == pytest.approx(-1.0, abs=1e-5)


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize(
    ("height", "options"),
    [
        (1e-1, {"formulation": "exact"}),
        (1e-2, {"strain": "exact"}),
        (1e-4, {"strain": "exact"}),
        (1e-4, {"formulation": "exact"}),
    ],
)
def test_regression_coarse_ring_has_no_additional_branch_points(height, options):
    # Both modes with 2 waves become critical at the same pressure (M. Levy 1884: 3 EI / R^3), where
    # rounding lets growing modes appear, vanish and appear again. (In a floating frame, 4 elements
    # are not free of strain as they translate: thick rings bend from the beginning.)
    mech, steel = bd.Mechanism(), bd.Material.of("steel")
    section = rectangle(height, material=steel)
    halves = []
    for k, x in enumerate((1.0, -1.0)):
        arc = bd.Arc(1.0, np.pi, start=(x, 0.0), angle=(k + 0.5) * np.pi)
        beam = mech.add(bd.Beam(f"half {k}", arc, section, 4, **options))
        mech.add(bd.DistributedForce(f"p {k}", beam, (0.0, section.EI), axes="section"))
        halves.append(beam)
    first, last = halves
    mech.add(bd.Weld("side", mech.ground.at(1.0, 0.0), first.start))
    mech.add(bd.Weld("middle", first.end, last.start))
    mech.add(bd.Weld("closure", first.start, last.end))
    with warnings.catch_warnings():
        # Rounding errors decide whether the points can be distinguished.
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        path = bd.equilibrium(mech, to=10.0)
    kinds = [point.kind for point in path.critical if point.factor < 7.0]
    assert kinds == ["branch point", "branch point"]
    assert [point.factor for point in path.critical[:2]] == pytest.approx([3.0, 3.0], rel=6e-3)


@pytest.mark.slow(reason="two seconds")
@pytest.mark.parametrize("height", [1e-2, 1e-4])
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
@pytest.mark.parametrize("angle", [0.5 * np.pi, 1.2])
@pytest.mark.parametrize("hinge", ["start", "end", None])
def test_follower_loads_do_not_turn_a_rocket(hinge, angle, formulation, height):
    # Its rotation has no stiffness and no load acts along it, whatever the center of rotation.
    mech, steel = bd.Mechanism(), bd.Material.of("steel")
    section = rectangle(height, material=steel)
    along = np.array([np.cos(angle), np.sin(angle)])
    line = bd.Line((2.0, 1.0), tuple(np.array([2.0, 1.0]) + along))
    beam = mech.add(bd.Beam("rocket", line, section, 8, formulation=formulation))
    for name, end, sign in (("thrust", beam.start, 1.0), ("drag", beam.end, -1.0)):
        mech.add(bd.Force(name, end, tuple(sign * section.EI * along), axes="body"))
    if hinge:
        end = getattr(beam, hinge)
        mech.add(bd.Revolute("hinge", mech.ground.at(*end.point), end))
    path = bd.equilibrium(mech, to=1.0)
    assert path.status.success
    assert path.unstable[-1] == 0
    assert path.free.startswith("rocket.")
    np.testing.assert_allclose(path.q[-1], path.q[0], rtol=0.0, atol=1e-2)  # [m], [rad]


@pytest.mark.slow(reason="two seconds")
def test_regression_flutter_of_a_portal_frame_under_follower_loads():
    # At this slenderness, rounding limits the accuracy of the two flutter modes, but not of others.
    # The load was 26.888; with ten times the height or a tenth of it, it was 26.365 or 26.381.
    steel = bd.Material.of("steel")
    column, girder = (rectangle(1e-3, w, material=steel) for w in (0.02, 0.02756))
    sections = column, girder, column
    mech, beams = welded_frame(portal_points(1.0, 1.1), sections, 6, formulation="exact")
    for k in range(2):
        mech.add(bd.Force(f"press {k}", beams[k].end, (0.0, -column.EI), axes="body"))
    spring = (mech.ground.at(0.0, 1.1), beams[0].end)
    mech.add(bd.Bushing("spring", *spring, kx=0.497 * column.EI))
    path = bd.equilibrium(mech, to=30.0)
    assert [point.kind for point in path.critical] == ["branch point"] * 3 + ["flutter point"]
    assert path.critical[-1].factor == pytest.approx(26.380, rel=1e-3)
    assert path.unstable[-1] == 3


@pytest.mark.slow(reason="half a second each")
@pytest.mark.parametrize("scale", [1e-6, 300.0, 1e3, 1e6])
def test_regression_critical_loads_do_not_depend_on_the_unit_of_length(scale):
    # The modes of more than 150 coordinates came from a matrix of stiffness [J] and joints [m],
    # whose elimination lost digits: the load was 11.379 at 300, and none was found at 1000.
    section = rectangle(4e-5 * scale, 0.02 * scale)
    points = portal_points(0.7 * scale, scale)
    mech, beams = welded_frame(points, section, 8, strain="exact")
    for k, share in enumerate((1.0, 0.4)):
        mech.add(bd.Force(f"load {k}", beams[k].end, (0.0, -share * section.EI / scale**2)))
    path = bd.equilibrium(mech, to=15.0)
    assert [point.kind for point in path.critical] == ["branch point"]
    # The frame is not symmetric, so that rounding of positions moves this point.
    assert path.critical[0].factor == pytest.approx(11.36058, rel=2e-5)


def columns_of_sizes(lengths, shares, **options):
    """Return clamped columns, 50 times as long as thick, with shares of their Euler loads."""
    mech = bd.Mechanism()
    for k, (length, share) in enumerate(zip(lengths, shares, strict=True)):
        section = rectangle(0.02 * length, 0.02 * length, material=bd.Material(2.1e11, 0.3, 7850.0))
        x = k * max(lengths)
        curve = bd.Line((x, 0), (x, length))
        column = mech.add(bd.Beam(f"column{k}", curve, section, elements=2, **options))
        mech.add(bd.Weld(f"clamp{k}", mech.ground.at(x, 0), column.start))
        load = share * np.pi**2 * section.EI / (2.0 * length) ** 2
        mech.add(bd.Force(f"load{k}", column.end, (0.0, -load)))
    return mech


@pytest.mark.parametrize("ratio", [1e3, 1e5])
@FORMULATIONS
def test_regression_critical_loads_do_not_depend_on_larger_parts(options, ratio):
    """Rounding of the larger column counted as negative stiffness of the smaller one."""
    small, large = (
        bd.equilibrium(columns_of_sizes(lengths, (1.0, 0.9), **options), to=1.3)
        for lengths in ((1.0, 1.0), (1.0, ratio))
    )
    assert large.status.success
    assert not large.notes
    factors = [point.factor for point in large.critical]
    assert factors == pytest.approx([point.factor for point in small.critical], rel=1e-6)
    assert factors == pytest.approx([1.0, 1.0 / 0.9], rel=2e-3)
    unstable = large.table()["unstable directions [-]"]
    assert [unstable.iloc[0], unstable.iloc[-1]] == [0, 2]
    linear = bd.buckling(columns_of_sizes((1.0, ratio), (1.0, 0.9), **options), n=2)
    assert not linear.warnings


@pytest.mark.slow(reason="a fifth of a second")
@FORMULATIONS
def test_regression_critical_loads_of_a_small_column_on_the_tip_of_a_large_one(options):
    """The path ended at 5 to 18 % of the load for a column of 1 um on one of 1 m."""
    mech = columns_of_sizes((1.0,), (0.9,), **options)
    length = 1e-6
    section = rectangle(0.02 * length, 0.02 * length, material=bd.Material(2.1e11, 0.3, 7850.0))
    line = bd.Line((0, 1), (0, 1 + length))
    column = mech.add(bd.Beam("micro column", line, section, elements=2, **options))
    mech.add(bd.Weld("joint", mech.parts["column0"].end, column.start))
    load = np.pi**2 * section.EI / (2.0 * length) ** 2
    mech.add(bd.Force("micro load", column.end, (0.0, -load)))
    with pytest.warns(bd.BeamdaeWarning, match="unstable in 2 directions since"):
        path = bd.equilibrium(mech, to=1.3)
    factors = [point.factor for point in path.critical]
    assert factors == pytest.approx([1.0, 1.0 / 0.9], rel=2e-3)


def test_regression_a_stiffer_part_does_not_hide_soft_springs():
    mech = bd.Mechanism()
    for k, size in enumerate((1e-6, 1.0)):
        bar = mech.add(bd.RigidBody.rod(f"bar{k}", (k, 0.0), (k, size), mass=1.0))
        foot = mech.ground.at(k, 0.0), bar.at(k, 0.0)
        mech.add(bd.Revolute(f"hinge{k}", *foot))
        mech.add(bd.TorsionSpring(f"spring{k}", *foot, size**3))
        mech.add(bd.Force(f"load{k}", bar.at(k, size), (0.0, -(1.0 - 0.1 * k) * size**2)))
    with pytest.warns(bd.BeamdaeWarning, match="unstable in 2 directions since"):
        path = bd.equilibrium(mech, to=1.3)
    assert [x.factor for x in path.critical] == pytest.approx([1.0, 1.0 / 0.9], rel=1e-9)
