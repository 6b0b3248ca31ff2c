"""Equilibria of structures that are very soft in bending, unstiffened, or held by stiff springs."""

import warnings
from itertools import pairwise

import numpy as np
import pytest
from mechanisms import EARTH, free_ball, hinged_beam, portal_points, rectangle, welded_frame
from numpy.testing import assert_allclose
from scipy.optimize import brentq

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


# Load control from positions in which only the stretched structure carries the loads.

AXIAL_STIFFNESS, WEIGHT, LENGTH = 4.45e5, 1.46, 30.0  # N, N/m, m


def straight_cable(second_moment, angle=0.0, elements=20):
    """Return a cable drawn straight between two hinges."""
    area = 1e-5
    material = bd.Material(E=AXIAL_STIFFNESS / area, nu=0.3, rho=WEIGHT / 9.81 / area)
    end = (LENGTH * np.cos(angle), LENGTH * np.sin(angle))
    section = bd.Section(material, area, second_moment)
    mech, beam = hinged_beam(section, elements, end, name="cable", gravity=9.81, strain="exact")
    mech.add(bd.Revolute("B", mech.ground.at(*end), beam.end))
    mech.observe("middle", beam.at(LENGTH / 2))
    return mech


def sag(weight):
    """Return the sag of the elastic catenary between level supports (Irvine 1981)."""
    v = weight * LENGTH / 2

    def stretch(h):
        return h * LENGTH / AXIAL_STIFFNESS + 2 * h / weight * np.arcsinh(v / h) - LENGTH

    h = brentq(stretch, 1.0, 1e6)
    return v * LENGTH / (4 * AXIAL_STIFFNESS) + h / weight * (np.hypot(1.0, v / h) - 1.0)


# The smallest bending stiffness is 1e-15 of the axial one, beyond double precision.
@pytest.mark.parametrize("second_moment", [1e-11, 1e-12, 1e-14, 1e-20])
def test_straight_cable_hangs_in_a_catenary(second_moment):
    path = bd.equilibrium(straight_cable(second_moment))
    assert path.status.success
    assert path.unstable[-1] == 0
    # The interpolation of 20 elements, and the bending stiffness at the hinges, leave 4e-7.
    assert path["middle.y"].iloc[-1] == pytest.approx(-sag(WEIGHT), rel=2e-6)


@pytest.mark.slow(reason="several runs")
def test_path_of_a_straight_cable_is_continuous_through_each_target():
    path = bd.equilibrium(straight_cable(1e-12), to=[1e-3, 0.5, 1.0])
    middle = path["middle.y"]
    for factor in (0.5, 1.0):
        assert middle.loc[factor] == pytest.approx(-sag(factor * WEIGHT), rel=2e-6)
    assert np.all(np.diff(middle) < 0.0)
    assert np.max(np.abs(np.diff(middle))) < 0.1 * sag(WEIGHT)


@pytest.mark.slow(reason="several runs")
def test_inclined_cable_is_where_a_run_in_equilibrium_starts():
    mech = straight_cable(1e-12, angle=np.pi / 6)
    path = bd.equilibrium(mech)
    run = bd.simulate(mech, t_end=1e-4, start="equilibrium")
    assert path["middle.y"].iloc[-1] == pytest.approx(run["middle.y"].iloc[0], abs=1e-9)


# Springs and bushings of any stiffness: stiff ones act as joints, and no digits are lost.

EXACT_BEAMS = [{"formulation": "exact"}, {"strain": "exact"}]
BOTH = pytest.mark.parametrize("options", EXACT_BEAMS, ids=["exact", "floating frame"])
STIFFNESSES = 10.0 ** np.array([3, 6, 9, 12, 18])


def connect(mech, name, points, stiffness, section, time=0.0):
    """Join two points by a weld or by a bushing of so many bending stiffnesses of 1 m."""
    k, c = stiffness * section.EI, time * stiffness * section.EI
    if np.isinf(k):
        mech.add(bd.Weld(name, *points))
    else:
        mech.add(bd.Bushing(name, *points, kx=k, ky=k, ktheta=k, cx=c, cy=c, ctheta=c))


def column(stiffness, height, loads, time=0.0, **options):
    """Return a column of 1 m on a bushing under loads, given in EI / L^2 by their axes."""
    section = rectangle(height, damping=time)
    mech, line = bd.Mechanism(), bd.Line((0.0, 0.0), (0.0, 1.0))
    beam = mech.add(bd.Beam("column", line, section, 8, **options))
    connect(mech, "foot", (mech.ground.at(0.0, 0.0), beam.start), stiffness, section, time)
    for axes, load in loads.items():
        force = tuple(section.EI * np.array(load))
        mech.add(bd.Force(f"{axes} load", beam.end, force, axes=axes))
    mech.observe("point", beam.end)
    return mech


def cantilever(stiffness, height, **options):
    return column(stiffness, height, {"inertial": (0.03, -3.0)}, **options)


def footing(stiffness, height, **options):
    """Return a column on a rigid footing and under a rigid head, all of them on bushings."""
    mech, section = bd.Mechanism(), rectangle(height)
    foot = mech.add(bd.RigidBody("foot", mass=1.0, inertia=0.1, center=(0.1, -0.1)))
    beam = mech.add(bd.Beam("column", bd.Line((0.0, 0.0), (0.0, 1.0)), section, 8, **options))
    head = mech.add(bd.RigidBody("head", mass=1.0, inertia=0.1, center=(0.0, 1.0)))
    soil = mech.ground.at(0.1, -0.2), foot.at(0.1, -0.2)
    pairs = soil, (foot.at(0.0, 0.0), beam.start), (beam.end, head.at(0.0, 1.0))
    for k, pair in enumerate(pairs):
        connect(mech, f"bushing {k}", pair, stiffness, section)
    mech.add(bd.Force("load", head.at(0.0, 1.0), (0.03 * section.EI, -3.0 * section.EI)))
    mech.observe("point", beam.end)
    return mech


def portal(stiffness, height, **options):
    mech, section = bd.Mechanism(), rectangle(height)
    corners = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)]
    beams = [
        mech.add(bd.Beam(f"beam {k}", bd.Line(*ends), section, 4, **options))
        for k, ends in enumerate(pairwise(corners))
    ]
    feet = [(mech.ground.at(*x.point), x) for x in (beams[0].start, beams[-1].end)]
    for k, pair in enumerate([*feet, *((a.end, b.start) for a, b in pairwise(beams))]):
        connect(mech, f"corner {k}", pair, stiffness, section)
    for k, point in enumerate((beams[0].end, beams[-1].start)):
        mech.add(bd.Force(f"load {k}", point, (0.1 * k * section.EI, -6.0 * section.EI)))
    mech.observe("point", beams[0].end)
    return mech


@pytest.mark.slow(reason="one to two seconds")
@BOTH
@pytest.mark.parametrize("height", [1e-2, 1e-5])
@pytest.mark.parametrize("structure", [cantilever, footing, portal])
def test_equilibria_on_stiff_bushings_tend_to_those_of_welds(structure, height, options):
    def end(stiffness):
        path = bd.equilibrium(structure(stiffness, height, **options))
        assert path.stable
        return np.array([path["point.x"].to_numpy()[-1], path["point.y"].to_numpy()[-1]])

    welded = end(np.inf)
    changes = [end(k) - welded for k in STIFFNESSES]
    for k, change in zip(STIFFNESSES, changes, strict=True):
        # The change is c / k + O(1 / k^2). Corrections end at 1e-10.
        expected = changes[1] * STIFFNESSES[1] / k
        assert_allclose(change, expected, rtol=100.0 / k + 1e-3, atol=1e-10)


@pytest.mark.slow(reason="one second")
@BOTH
@pytest.mark.parametrize("height", [1e-3, 1e-5])
@pytest.mark.parametrize("stiffness", [1e-2, 1.0, *STIFFNESSES])
def test_critical_loads_of_a_column_on_a_bushing(stiffness, height, options):
    path = bd.equilibrium(column(stiffness, height, {"inertial": (0.0, -25.0)}, **options))
    # x tan(x) = k L / EI with x = L sqrt(P / EI).
    ends = np.array([0.0, 0.5 * np.pi + 1e-9])
    expected = [
        brentq(lambda x: x * np.sin(x) - stiffness * np.cos(x), *(ends + n * np.pi)) ** 2
        for n in range(2)
    ]
    # 8 elements; shear minus compression, P / GA - P / EA.
    tolerance = 1e-6 + 5.0 * height**2
    factors = [25.0 * point.factor for point in path.critical]
    assert factors == pytest.approx(expected, rel=tolerance)
    assert [point.kind for point in path.critical] == ["branch point"] * 2
    assert path.unstable[-1] == 2


@pytest.mark.slow(reason="several seconds")
@BOTH
@pytest.mark.parametrize("time", [0.0, 1e-3])
def test_flutter_loads_on_stiff_bushings_tend_to_those_of_a_clamp(time, options):
    def flutter(stiffness):
        loads = {"body": (0.0, -25.0)}
        path = bd.equilibrium(column(stiffness, 1e-3, loads, time, **options))
        (point,) = path.critical
        assert point.kind == "flutter point"
        return point.factor

    clamped = flutter(np.inf)
    change = 1e6 * (flutter(1e6) - clamped)
    for k in STIFFNESSES[3:]:
        # Flutter points are bisected to 1e-7 of the load.
        assert flutter(k) - clamped == pytest.approx(change / k, rel=1e-2, abs=3e-7)


@pytest.mark.slow(reason="two seconds each")
@BOTH
@pytest.mark.parametrize("ends", [(0.0, 15.0), (15.0, 0.0), (0.5, 1.5)])
@pytest.mark.parametrize("height", [1e-3, 1e-5])
def test_stability_over_the_stiffness_of_a_bushing(height, ends, options):
    @bd.model(t_end=1.0)
    def model(exponent=3.0):
        return column(10.0**exponent, height, {"inertial": (0.0, -2.0)}, **options)

    first, last = ends
    path = bd.equilibrium(model, over="exponent", from_=first, to=last, t=1.0)
    assert path.status.success
    (point,) = path.critical
    x = np.sqrt(2.0)
    assert 10.0**point.factor == pytest.approx(x * np.tan(x), rel=1e-5)
    assert path.unstable[[0, -1]].tolist() == [int(first < last), int(last < first)]


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e12, 1e15])
def test_stiff_and_soft_bushings_between_links(ratio):
    mech, stiffnesses = bd.Mechanism(), [1.0, ratio, 1.0]
    last = mech.ground.at(0.0, 0.0)
    for y, k in enumerate(stiffnesses):
        ends = (0.0, float(y)), (0.0, y + 1.0)
        link = mech.add(bd.RigidBody.rod(f"link {y}", *ends, mass=1.0))
        joint = last, link.at(*ends[0])
        mech.add(bd.Bushing(f"bushing {y}", *joint, kx=1e3 * k, ky=1e3 * k, ktheta=k))
        last = link.at(*ends[1])
    mech.add(bd.Force("load", last, (0.0, -1.0)))
    path = bd.equilibrium(mech, to=1.2)
    # Rotations under moments of the links; their reciprocal eigenvalues are critical loads.
    sums = np.tril(np.ones((3, 3)))
    factors = 1.0 / np.linalg.eigvalsh(sums / stiffnesses @ sums.T)[::-1]
    expected = factors[(factors > 0.0) & (factors < 1.2)]
    assert [point.factor for point in path.critical] == pytest.approx(expected, rel=3e-7)
    assert path.unstable[-1] == len(expected)


@pytest.mark.parametrize("stiffness", [1e-3, 1.0, 1e6, 1e12])
@pytest.mark.parametrize("ends", [(0.0, -2.0), (-2.0, 0.0)])
def test_preloads_of_stiff_springs(stiffness, ends):
    # Two springs in line push a mass aside if twice their thrust exceeds the stiffness across.
    @bd.model(t_end=1.0)
    def model(tension=0.0):
        mech, mass = free_ball(name="mass")
        for x in (-1.0, 1.0):
            at = mech.ground.at(x, 0.0)
            name = f"spring {x}"
            mech.add(bd.Spring(name, at, mass.point, stiffness, preload=tension))
        across = mech.ground.at(0.0, -1.0), mass.point
        mech.add(bd.Spring("across", *across, 3.0))
        return mech

    path = bd.equilibrium(model, over="tension", from_=ends[0], to=ends[1], t=1.0)
    (point,) = path.critical
    assert point.kind == "branch point"
    assert point.factor == pytest.approx(-1.5, rel=1e-7)
    assert sorted(path.unstable[[0, -1]].tolist()) == [0, 1]
