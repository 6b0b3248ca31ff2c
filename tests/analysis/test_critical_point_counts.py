"""Every change of the number of unstable directions is a critical point, for random structures."""

from itertools import pairwise

import numpy as np
import pytest

import beamdae as bd
from beamdae.analysis.statics.corrector import EquilibriumPoint
from beamdae.analysis.statics.critical_points import (
    SegmentCriticalPoint,
    _cancel_opposite_changes,
    _kinked_root,
)

FORMULATIONS = [{"formulation": "exact"}, {"strain": "exact"}]
CONTROLS = [
    {},
    {"control": "arc length"},
    {"control": "arc length", "step": 0.02},
    {"control": "arc length", "step": 0.3},
]


def random_structure(rng):
    """Return a column, frame or arch of random size, slenderness and supports, and its load."""
    size, options = 10.0 ** rng.uniform(-1.0, 3.0), FORMULATIONS[rng.integers(2)]
    material = bd.Material(E=10.0 ** rng.uniform(5.0, 11.5), nu=0.3, rho=10.0 ** rng.uniform(0, 4))
    height = size * 10.0 ** rng.uniform(-4.0, -1.5)
    section = bd.Section.rectangle(material, width=0.02 * size, height=height)
    mech, kind = bd.Mechanism(), ("column", "frame", "arch")[rng.integers(3)]
    elements = int(rng.integers(2, 9))
    corners = [np.zeros(2), size * np.array([rng.uniform(-0.1, 0.1), 1.0])]
    if kind == "column":
        curves = [bd.Line((0.0, 0.0), (0.0, size))]
    elif kind == "frame":
        corners.append(
            corners[1] + size * np.array([rng.uniform(0.5, 1.5), rng.uniform(-0.2, 0.2)])
        )
        if rng.uniform() < 0.5:
            corners.append(np.array([corners[2][0], 0.0]))
        curves = [bd.Line(tuple(a), tuple(b)) for a, b in pairwise(corners)]
    else:
        half = rng.uniform(0.1, 1.5)
        curves = [bd.Arc(-size, 2.0 * half * size, start=(0.0, 0.0), angle=half)]
    beams = [
        mech.add(bd.Beam(f"beam {k}", curve, section, elements, **options))
        for k, curve in enumerate(curves)
    ]
    for k, (one, other) in enumerate(pairwise(beams)):
        mech.add(bd.Weld(f"corner {k}", one.end, other.start))
    joints = [(bd.Weld, bd.Revolute)[rng.integers(2)] for _ in range(2)]
    mech.add(joints[0]("first", mech.ground.at(*beams[0].start.point), beams[0].start))
    if kind != "column" or joints[0] is bd.Revolute:
        mech.add(joints[1]("last", mech.ground.at(*beams[-1].end.point), beams[-1].end))
    # A symmetric load, in half of the structures, has branch points.
    at = beams[0].at(beams[0].length * (0.5 if kind == "arch" else 1.0))
    if kind == "column" and "last" in mech.parts:
        at = beams[0].at(0.5 * size)
    sideways = rng.choice([0.0, 0.05])
    force = section.EI / size**2 * np.array([sideways, -1.0])
    axes = ("inertial", "body")[rng.integers(2)] if kind == "column" else "inertial"
    mech.add(bd.Force("press", at, tuple(force), axes=axes))
    return mech


def count_changes(path):
    """Return the changes of the number of unstable directions, and those of the critical points.

    There is one pair for each critical point or group of successive ones.
    """
    weights = np.zeros(len(path.q))
    for point in path.critical:
        weights[point.row] += 2 if point.kind == "flutter point" else 1
    regular = [row for row in range(len(path.q)) if not weights[row]]
    pairs = pairwise(regular)
    return [
        (abs(int(path.unstable[b] - path.unstable[a])), int(weights[a:b].sum()))
        for a, b in pairs
        if path.unstable[a] >= 0 and path.unstable[b] >= 0
    ]


def trace_random_path(seed):
    rng = np.random.default_rng(seed)
    mech, settings = random_structure(rng), CONTROLS[rng.integers(len(CONTROLS))]
    target = 10.0 ** rng.uniform(1.0, 2.5)
    return bd.equilibrium(mech, to=target, max_points=120, **settings)


def check_law(seed):
    path = trace_random_path(seed)
    assert path.critical
    for change, expected in count_changes(path):
        assert change == expected


# Seeds of 0 to 79 with limit points, branch points and flutter; all 80 satisfy the law.
@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize("seed", [6, 43])
def test_changes_of_stability_are_critical_points(seed):
    check_law(seed)


@pytest.mark.slow(reason="seconds")
@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize("seed", [2, 15, 18, 19, 21, 25, 31])
def test_more_changes_of_stability_are_critical_points(seed):
    check_law(seed)


@pytest.mark.slow(reason="one second")
@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
def test_end_before_a_limit_point_is_not_rechecked():
    # The finer mesh has its limit point slightly earlier, so that it has no equilibrium there.
    path = trace_random_path(4)
    assert path.status.kind == "failed"
    assert path.notes == ()


@pytest.mark.parametrize(
    ("loads", "changes", "remaining"),
    [
        ([2.99, 3.0, 3.0001], [1, 1, 2], [2.99, 3.0, 3.0001]),
        ([3.0, 3.0, 3.0001, 3.0002], [1, 1, -1, 1], [3.0, 3.0]),
        ([3.0, 3.0001, 3.0002, 3.0003], [1, -1, 1, -1], []),
        ([3.0, 3.0001, 3.0002], [2, -1, -1], []),
        ([3.0, 3.1], [1, -1], [3.0, 3.1]),
        # Flutter of one part where another part becomes stable or unstable.
        ([3.0, 3.0001], [2, -1], [3.0]),
        ([3.0, 3.0001], [-1, 2], [3.0001]),
        ([3.0, 3.0001], [1, -2], [3.0001]),
        ([3.0, 3.0001, 3.0002], [2, 2, -1], [3.0, 3.0001]),
    ],
)
def test_changes_that_cancel_at_one_load_are_no_critical_points(loads, changes, remaining):
    points = [
        SegmentCriticalPoint(
            0.0,
            EquilibriumPoint(None, np.zeros(0), load),
            "branch point",
            np.zeros(0),
            1e-3,
            change,
        )
        for load, change in zip(loads, changes, strict=True)
    ]
    kept = _cancel_opposite_changes(points)
    assert [one.point.mu for one in kept] == remaining
    has_range = 0 < len(kept) < len(points)
    assert [one.loads for one in kept] == [(loads[0], loads[-1]) if has_range else None] * len(kept)


@pytest.mark.parametrize("slopes", [(-1.0, -3.3), (-3.3, -1.0), (1.0, 3.3), (3.3, 1.0)])
@pytest.mark.parametrize("select", [np.minimum, np.maximum])
def test_regression_eigenvalues_that_change_their_order_where_they_vanish(slopes, select):
    # The root of a cubic polynomial through the four samples is 1e-2 off.
    positions = np.array([0.42, 0.47, 0.52, 0.57])
    roots = np.array([0.4951, 0.4952])
    first, second = (slope * (positions - root) for slope, root in zip(slopes, roots, strict=True))
    root = _kinked_root(positions, select(first, second), 0.49)
    assert np.min(np.abs(roots - root)) < 1e-12


def test_roots_of_smooth_eigenvalues_are_those_of_a_polynomial():
    positions = np.array([0.42, 0.47, 0.52, 0.57])
    root = _kinked_root(positions, (0.5 - positions) * (1.0 + positions), 0.49)
    assert root == pytest.approx(0.5, rel=1e-12)


@pytest.mark.slow(reason="half a second each")
@pytest.mark.parametrize("options", FORMULATIONS, ids=["exact", "floating frame"])
def test_regression_a_step_to_a_neighboring_path_has_no_branch_point(options):
    # The load acts 1e-5 of the length beside the crown. The point was a branch point at 8.98758,
    # between the path and that on the other side of the gap that the asymmetry opens.
    mech, radius = bd.Mechanism(), (0.25 + 0.05**2) / (2.0 * 0.05)
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.01)
    angle = np.arcsin(0.5 / radius)
    arc = bd.Arc(-radius, 2.0 * radius * angle, start=(0.0, 0.0), angle=angle)
    beam = mech.add(bd.Beam("arch", arc, section, 8, **options))
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Revolute("right", mech.ground.at(*beam.end.point), beam.end))
    mech.add(bd.Force("press", beam.at((0.5 + 1e-5) * beam.length), (0.0, -section.EI)))
    mech.observe("crown", beam.at(0.5 * beam.length))
    path = bd.equilibrium(mech, to={"crown.y": -0.02}, control="arc length", step=0.01)
    assert path.status.success
    # Displacement control with small steps.
    assert [point.kind for point in path.critical] == ["limit point"]
    assert path.critical[0].factor == pytest.approx(8.97864, rel=1e-5)
