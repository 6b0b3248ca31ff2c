"""Equilibrium paths of validation/benchmarks: stored results and properties of the paths."""

import numpy as np
import pandas as pd
import pytest
from benchmarks import equilibria
from benchmarks.run import SUMMARY
from numpy.testing import assert_allclose

import beamdae as bd

# Largest relative error by case and setting: printed digits and the error of the mesh.
BOUNDS = {
    ("elastica cantilever", "8 exact elements"): 1e-5,
    ("shallow arch", "8 elements, exact"): 2e-4,
    ("shallow arch", "16 elements, exact"): 2e-6,
    # Strain for moderate bending, which the arch exceeds.
    ("shallow arch", "8 elements, floating frame"): 4e-3,
    # Three digits are published, for an inextensible arch.
    ("deep arch", "16 exact elements"): 5e-4,
    ("Euler column", "8 exact elements"): 1e-6,
    # Four digits are published.
    ("Beck column", "8 exact elements"): 1e-4,
}


def test_stored_results_are_within_their_bounds():
    stored = pd.read_csv(SUMMARY)
    stored = stored[stored["case"].isin({case for case, _ in BOUNDS})]
    worst = stored.groupby(["case", "setting"])["relative"].max()
    assert set(worst.index) == set(BOUNDS)
    for key, bound in BOUNDS.items():
        assert worst[key] < bound, key
    # The limit load is required to 1e-4.
    first_limit = stored[stored["quantity"] == "first limit load"].set_index("setting")["relative"]
    assert first_limit["8 elements, exact"] < 1e-4


@pytest.mark.slow(reason="collocation at a hundred heights, and four paths")
def test_results_reproduce_the_table():
    stored = pd.read_csv(SUMMARY).set_index(["case", "setting", "quantity"])
    results = [(case.name, result) for case in equilibria.PATH_CASES for result in case.results()]
    for name, result in results:
        row = stored.loc[(name, result.setting, result.quantity)]
        # Collocation to 1e-8; heights at a limit load, a flat extremum, to the square root of it.
        assert result.reference == pytest.approx(float(row["published"]), rel=2e-6)
        # The eigenvalue of the column changes by 0.08 J per load factor, and rounding of its
        # stiffness, up to 9e8 J, is 1e-7 J. Flutter is as sensitive.
        rounding = 3e-6 if result.quantity.startswith(("branch point", "flutter point")) else 1e-8
        assert result.computed == pytest.approx(float(row["ours"]), rel=rounding)


def test_elastica_matches_published_table():
    # Half a unit of the last digit of the table, and 5e-6 from the mesh.
    rows = equilibria.tabulate_tip(equilibria.solve_elastica())
    assert_allclose(rows, list(equilibria.ELASTICA.values()), atol=1e-5)


@pytest.fixture(scope="module")
def arch_path():
    return equilibria.solve_shallow_arch()


def test_path_of_the_shallow_arch_passes_both_limit_points(arch_path):
    assert arch_path.status.success
    first, second = arch_path.critical
    assert (first.kind, second.kind) == ("limit point", "limit point")
    height = arch_path.columns["crown.y [m]"]
    deflection = height[0] - height
    assert deflection[-1] > 2.0 * deflection[first.row]
    between = slice(first.row + 1, second.row)
    assert np.all(arch_path.unstable[between] == 1)
    assert np.all(arch_path.unstable[: first.row] == 0)
    assert np.all(arch_path.unstable[second.row + 1 :] == 0)
    # Arc-length control follows the same path.
    arc_length_path = bd.equilibrium(
        equilibria.shallow_arch, to=1.001 * first.factor, control="arc length"
    )
    factors = [point.factor for point in arc_length_path.critical]
    assert_allclose(factors, [first.factor, second.factor], rtol=1e-9)


@pytest.mark.slow(reason="half a second and more")
def test_arch_snaps_through_above_its_limit_load(arch_path):
    first = arch_path.critical[0]
    above = 1.001 * first.factor
    arch = equilibria.shallow_arch(
        load=above * equilibria.shallow_arch.parameters["load"], damping=5e-3
    )
    jump = bd.simulate(arch, bd.Radau(1e-5), 1.0, start=arch_path.at(first.row))
    below = bd.equilibrium(equilibria.shallow_arch, to=above, control="arc length")
    assert below.stable
    # The slowest vibration has decayed.
    assert_allclose(jump.q[-1], below.q[-1], atol=1e-9)
    heights = jump["crown.y"]
    assert heights.iloc[0] == pytest.approx(4.9e-3, abs=1e-4)
    assert heights.iloc[-1] < -4e-3


@pytest.mark.slow(reason="two runs of a second")
def test_arch_leaves_the_unstable_branch_in_either_direction(arch_path):
    first, second = arch_path.critical
    row = (first.row + second.row) // 2
    ends = []
    for factor in (0.999, 1.001):
        load = factor * arch_path.factors[row, 0] * equilibria.shallow_arch.parameters["load"]
        arch = equilibria.shallow_arch(load=load, damping=2e-3)
        run = bd.simulate(arch, bd.Radau(1e-5), 1.0, start=arch_path.at(row))
        ends.append(run["crown.y"].iloc[-1])
    assert ends[0] > 5e-3
    assert ends[1] < -3e-3


@pytest.mark.slow(reason="a path of a hundred points, twice")
def test_path_of_a_frame_passes_turning_points():
    coarse, fine = (
        bd.equilibrium(equilibria.lee_frame(k), to={"load.y": 30.0}, control="arc length")
        for k in (4, 8)
    )
    for path in (coarse, fine):
        assert [point.kind for point in path.critical] == ["limit point"] * 2
        steps = np.diff(path.columns["load.y [m]"])
        # Beyond the limit load the displacement reverses twice.
        assert np.count_nonzero(np.diff(np.sign(steps))) == 2
    factors = [[point.factor for point in path.critical] for path in (coarse, fine)]
    # Mesh error of four elements.
    assert_allclose(factors[0], factors[1], rtol=3e-5)
    with pytest.warns(bd.BeamdaeWarning, match="to continue where a displacement reverses"):
        bd.equilibrium(equilibria.lee_frame(4), to={"load.y": 30.0})


@pytest.mark.slow(reason="three paths of an arch, twice")
@pytest.mark.parametrize("side", [1, -1])
def test_asymmetric_path_of_an_arch_is_closed(side):
    """The arch loses symmetry at a branch point and regains it in the inverted position."""
    arch = equilibria.shallow_arch(rise=0.012)
    symmetric_path = bd.equilibrium(arch, to={"crown.y": -0.015}, control="arc length")
    kinds = [point.kind for point in symmetric_path.critical]
    assert kinds == ["limit point", "branch point", "branch point", "limit point"]
    branches = [point.factor for point in symmetric_path.critical if point.kind == "branch point"]
    with pytest.warns(bd.BeamdaeWarning, match="the path is closed"):
        closed_path = bd.equilibrium(arch, to={"crown.y": -0.015}, switch=side)
    branch_factors = [
        point.factor for point in closed_path.critical if point.kind == "branch point"
    ]
    # The asymmetric path touches the symmetric one at the second branch point.
    assert_allclose(branch_factors, [*branches, branches[0]], rtol=1e-6)
    asymmetric = slice(closed_path.critical[1].row + 1, closed_path.critical[2].row)
    assert np.all(closed_path.unstable[asymmetric] == 1)
    rotation = closed_path.columns["crown.angle [rad]"] - np.pi
    assert np.all(np.abs(rotation[asymmetric]) > 1e-4)
    symmetric_again = bd.equilibrium(arch, to={"crown.y": -0.015}, switch=[side, -1])
    assert symmetric_again.status.success
    assert symmetric_again.stable
    assert_allclose(symmetric_again.q[-1], symmetric_path.q[-1], atol=1e-9)


@pytest.mark.slow(reason="half a second and more")
def test_follower_load_causes_flutter_without_buckling():
    """A follower load has no potential: the column is stable up to 20.05 EI / L^2."""
    path = bd.equilibrium(equilibria.column("body", 1.0, elements=12), to=[15.0, 21.0], step=15.0)
    (flutter,) = path.critical
    assert flutter.kind == "flutter point"
    # Half a unit of the last published digit.
    assert flutter.factor == pytest.approx(20.05, abs=5e-3)
    assert path.unstable[[0, 1, -1]].tolist() == [0, 0, 2]


@pytest.mark.parametrize("scale", [1e-7, 1e7])
def test_path_is_independent_of_the_scale_of_the_load(scale):
    load = 0.25 * np.pi**2 * scale
    path = bd.equilibrium(equilibria.column("inertial", load, elements=4), to=1.2 / scale)
    (branch,) = path.critical
    assert branch.kind == "branch point"
    # Rounding: the axial stiffness is 1e7 times the bending stiffness.
    assert branch.factor * scale == pytest.approx(1.0, rel=2e-6)


@pytest.mark.slow(reason="half a second")
def test_path_of_the_deep_arch_passes_both_limit_points_and_the_reversal():
    # Control of the displacement ends at 5.6 EI / R^2, where the crown turns back.
    path = bd.equilibrium(equilibria.deep_arch(), to={"crown.y": -40.0}, control="arc length")
    assert path.status.success, path.status.sentence
    assert [point.kind for point in path.critical] == ["limit point", "limit point"]
    # On 32 elements, the loads are 8.97275 and -0.7304.
    assert path.critical[0].factor == pytest.approx(8.9728, rel=1e-4)
    assert path.critical[1].factor == pytest.approx(-0.7304, rel=1e-3)
