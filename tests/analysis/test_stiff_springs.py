"""Springs and bushings of any stiffness: stiff ones act as joints, and no digits are lost."""

from itertools import pairwise

import numpy as np
import pytest
from mechanisms import free_ball, rectangle
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import beamdae as bd

FORMULATIONS = [{"formulation": "exact"}, {"strain": "exact"}]
BOTH = pytest.mark.parametrize("options", FORMULATIONS, ids=["exact", "floating frame"])
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
