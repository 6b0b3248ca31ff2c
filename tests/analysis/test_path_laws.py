"""Laws that every equilibrium path obeys, on random frames and columns of any slenderness."""

from itertools import pairwise

import numpy as np
import pytest
from mechanisms import clamped_beam, hinged_arch, rectangle, welded_frame
from numpy.testing import assert_allclose
from properties.random_frames import build_frame, check_path, draw_frame, trace

import beamdae as bd

FORMULATIONS = [{"formulation": "exact"}, {"strain": "exact"}]
BOTH = pytest.mark.parametrize("options", FORMULATIONS, ids=["exact", "floating frame"])
CONTROLS = [{"control": "load"}, {"control": "arc length"}, {"step": 0.02}]


def portal(height=0.02, **options):
    """Return a shallow portal of 1 m whose girder snaps through."""
    section = rectangle(height)
    points = [(0.0, 0.0), (0.5, 0.1), (1.0, 0.0)]
    mech, (left, _right) = welded_frame(points, section, 4, (bd.Revolute, bd.Revolute), **options)
    mech.add(bd.Force("press", left.end, (0.0, -section.EI)))
    mech.observe("ridge", left.end)
    return mech


def cantilever(height, elements=8, **options):
    """Return a column of 1 m under the load EI / L^2, and its flexibility in shear."""
    section = rectangle(height)
    mech, beam = clamped_beam(section, elements, (0.0, 1.0), name="column", **options)
    mech.add(bd.Force("press", beam.end, (0.0, -section.EI)))
    mech.observe("tip", beam.end)
    return mech, section.EI * (1.0 / section.GA - 1.0 / section.EA)


def assert_same_points(one, other):
    assert [point.kind for point in one] == [point.kind for point in other]
    assert_allclose([point.factor for point in one], [point.factor for point in other], rtol=1e-8)


def count_growing_modes(mech, path, row):
    values = bd.modes(mech, n=path.q.shape[1], about=path.at(row)).eigenvalues
    growing = values[values.real > 1e-6 * np.abs(values)]
    # An oscillation is a pair of conjugate values, of which one is listed.
    return sum(2 if abs(x.imag) > 1e-6 * abs(x) else 1 for x in growing)


@pytest.mark.slow(reason="a second each")
@pytest.mark.parametrize("seed", range(12))
def test_unstable_directions_are_growing_modes_and_change_at_critical_points(seed):
    frame = draw_frame(seed)
    mech = build_frame(frame)
    path = trace(mech, frame.target, **CONTROLS[seed % 3])
    weights = {one.row: 2 if one.kind == "flutter point" else 1 for one in path.critical}
    regular = [row for row in range(len(path.q)) if row not in weights]
    for a, b in pairwise(regular):
        expected = sum(weights.get(row, 0) for row in range(a, b))
        assert abs(path.unstable[b] - path.unstable[a]) == expected
        if b == a + 2:  # the motion that becomes critical does not count
            assert path.unstable[a + 1] == min(path.unstable[a], path.unstable[b])
    for row in regular[:: len(regular) // 8 + 1]:
        assert path.unstable[row] == count_growing_modes(mech, path, row)


@pytest.mark.slow(reason="a fifth of a second each")
@BOTH
@pytest.mark.parametrize("slenderness", [1e2, 1e3, 1e4, 1e5, 1e6, 1e7])
def test_slenderness_does_not_cost_digits(slenderness, options):
    mech, shear = cantilever(1.0 / slenderness, **options)
    path = bd.equilibrium(mech, to=30.0)
    # Force and moment of a shear-flexible column in balance: P (1 + P (1/GA - 1/EA)) = EI k^2.
    euler = np.array([0.25, 2.25]) * np.pi**2
    expected = 2.0 * euler / (1.0 + np.sqrt(1.0 + 4.0 * shear * euler))
    assert [one.kind for one in path.critical] == ["branch point"] * 2
    assert_allclose([one.factor for one in path.critical], expected, rtol=1e-6)
    assert path.unstable[-1] == 2


@BOTH
def test_long_taut_strips_are_stable(options):
    # The load stiffens each coordinate a thousandfold: determinants exceed the range of numbers.
    section = rectangle(1e-5, 0.01)
    mech, beam = clamped_beam(section, 60, name="strip", **options)
    mech.add(bd.Force("pull", beam.end, (1e-3 * section.EA, 0.0)))
    path = bd.equilibrium(mech)
    assert path.status.success
    assert not path.unstable.any()
    assert not path.critical


@pytest.mark.slow(reason="half a second each")
@BOTH
@pytest.mark.parametrize("height", [2e-2, 1e-4])
def test_critical_points_do_not_depend_on_direction_and_steps(height, options):
    mech, depth = portal(height, **options), -0.06
    there = bd.equilibrium(mech, to={"ridge.y": [depth, 0.1]})
    assert there.status.success
    count = len(there.critical) // 2
    assert count >= 2
    first, back = there.critical[:count], there.critical[count:]
    assert_same_points(first, back[::-1])
    for step in (0.01, 0.005, 0.0025):
        assert_same_points(bd.equilibrium(mech, to={"ridge.y": depth}, step=step).critical, first)
    by_arc = bd.equilibrium(mech, to={"ridge.y": depth}, control="arc length", step=0.02)
    finer = bd.equilibrium(mech, to={"ridge.y": depth}, control="arc length", step=0.01)
    assert_same_points(by_arc.critical, finer.critical)
    assert_same_points(by_arc.critical, first)


@BOTH
@pytest.mark.parametrize("control", ["load", "arc length"])
@pytest.mark.parametrize("relative", [0.0, 1e-12, -1e-12, 1e-10, -1e-10, 1e-9, -1e-9, 1e-7, -1e-7])
def test_targets_at_a_branch_point_are_reached_on_the_path(relative, control, options):
    # The straight column has its tip at x = 0, the shallow portal its ridge at x = 0.5 m.
    for mech, column, x, to in (
        (cantilever(0.01, **options)[0], "tip.x", 0.0, 4.0),
        (portal(0.01, **options), "ridge.x", 0.5, 30.0),
    ):
        branch = bd.equilibrium(mech, to=to, control="arc length").critical[0]
        target = branch.factor * (1.0 + relative)
        path = bd.equilibrium(mech, to=[target, 1.2 * branch.factor], control=control)
        row = int(np.argmin(np.abs(path.factors[:, -1] - target)))
        assert path.factors[row, -1] == pytest.approx(target, rel=1e-11)
        assert path.status.success
        assert [one.kind for one in path.critical] == ["branch point"]
        # Rounding moves points along the mode. The crossing path is 1e-5 m away at 1e-10.
        assert_allclose(path.table()[f"{column} [m]"], x, rtol=0.0, atol=1e-6)
        assert list(np.sort(path.unstable)) == list(path.unstable)
        assert list(path.unstable[[0, -1]]) == [0, 1]


@pytest.mark.slow(reason="a second")
@BOTH
def test_machine_code_finds_the_same_path(options, monkeypatch):
    paths = []
    for native in ("off", "on"):
        monkeypatch.setenv("BEAMDAE_NATIVE", native)
        mech = portal(**options)
        paths.append(bd.equilibrium(mech, to={"ridge.y": -0.06}, control="arc length"))
    assert_same_points(paths[0].critical, paths[1].critical)
    assert_allclose(paths[0].q[-1], paths[1].q[-1], rtol=0.0, atol=1e-8)
    assert paths[0].unstable[-1] == paths[1].unstable[-1]


@pytest.mark.slow(reason="half a second each")
@BOTH
def test_steps_do_not_lead_to_neighboring_paths(options):
    # The load acts 1e-5 of the length beside the crown. The point was a branch point at 8.98758,
    # between the path and that on the other side of the gap that the asymmetry opens.
    radius = (0.25 + 0.05**2) / (2.0 * 0.05)
    angle = np.arcsin(0.5 / radius)
    arc = bd.Arc(-radius, 2.0 * radius * angle, start=(0.0, 0.0), angle=angle)
    mech = hinged_arch(arc, rectangle(0.01), at=0.5 + 1e-5, **options)
    path = bd.equilibrium(mech, to={"crown.y": -0.02}, control="arc length", step=0.01)
    assert path.status.success
    # Displacement control with small steps.
    assert [point.kind for point in path.critical] == ["limit point"]
    assert path.critical[0].factor == pytest.approx(8.97864, rel=1e-5)


# A frame that moves freely without load (67), a path that begins under load with
# large reactions (78), and one on which pivots in a fixed order are unsuitable (80).
@pytest.mark.slow(reason="up to three seconds each")
@pytest.mark.parametrize("seed", [67, 78, 80])
def test_paths_are_reversible_and_depend_on_no_steps_units_or_axes(seed):
    departures = dict(check_path(draw_frame(seed)))
    assert departures == dict.fromkeys(departures, "")
    assert "reversed" in departures
