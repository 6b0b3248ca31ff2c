"""The equilibria of validation/benchmarks: stored answers, and what follows from the paths."""

import numpy as np
import pandas as pd
import pytest
from benchmarks import equilibria
from benchmarks.run import SUMMARY
from numpy.testing import assert_allclose

import beamdae as bd

# Largest relative error, by case and setting: the digits of the tables, and what the mesh leaves.
BOUNDS = {
    ("elastica cantilever", "8 exact elements"): 1e-5,
    ("shallow arch", "8 elements, exact"): 2e-4,
    ("shallow arch", "16 elements, exact"): 2e-6,
    # Its strain is good to moderate bending, and the arch is bent.
    ("shallow arch", "8 elements, floating frame"): 4e-3,
    # Three digits of an inextensible arch.
    ("deep arch", "16 exact elements"): 5e-4,
    ("Euler column", "8 exact elements"): 1e-6,
    # Four digits.
    ("Beck column", "8 exact elements"): 1e-4,
}


def test_stored_answers_keep_their_bounds():
    stored = pd.read_csv(SUMMARY)
    stored = stored[stored["case"].isin({case for case, _ in BOUNDS})]
    worst = stored.groupby(["case", "setting"])["relative"].max()
    assert set(worst.index) == set(BOUNDS)
    for key, bound in BOUNDS.items():
        assert worst[key] < bound, key
    # What the arch has to show: its limit load to 1e-4.
    first = stored[stored["quantity"] == "first limit load"].set_index("setting")["relative"]
    assert first["8 elements, exact"] < 1e-4


@pytest.mark.slow(reason="collocation at a hundred heights, and four paths")
def test_the_answers_are_those_stored():
    stored = pd.read_csv(SUMMARY).set_index(["case", "setting", "quantity"])
    found = [(case.name, one) for case in equilibria.PATH_CASES for one in case.results()]
    for name, one in found:
        line = stored.loc[(name, one.setting, one.quantity)]
        # Collocation to 1e-8, and heights at a limit load, where it is flat, to the root of that.
        assert one.known == pytest.approx(float(line["published"]), rel=2e-6)
        assert one.computed == pytest.approx(float(line["ours"]), rel=1e-8)


def test_the_elastica_by_load_steps():
    # Half a unit of the last digit of the table, and 5e-6 of the mesh.
    rows = equilibria.tabulate_tip(equilibria.solve_elastica())
    assert_allclose(rows, list(equilibria.ELASTICA.values()), atol=1e-5)


@pytest.fixture(scope="module")
def snap():
    return equilibria.solve_shallow_arch()


def test_a_shallow_arch_is_followed_through_both_limit_loads(snap):
    assert snap.status.success
    first, second = snap.critical
    assert (first.kind, second.kind) == ("limit point", "limit point")
    height = snap.columns["crown.y [m]"]
    down = height[0] - height
    assert down[-1] > 2.0 * down[first.row]
    between = slice(first.row + 1, second.row)
    assert np.all(snap.unstable[between] == 1)
    assert np.all(snap.unstable[: first.row] == 0)
    assert np.all(snap.unstable[second.row + 1 :] == 0)
    # By arc length it is the same path.
    along = bd.equilibrium(equilibria.shallow_arch, to=1.001 * first.factor, control="arc length")
    factors = [one.factor for one in along.critical]
    assert_allclose(factors, [first.factor, second.factor], rtol=1e-9)


def test_the_arch_jumps_from_its_limit_load(snap):
    first = snap.critical[0]
    above = 1.001 * first.factor
    arch = equilibria.shallow_arch(
        load=above * equilibria.shallow_arch.parameters["load"], damping=5e-3
    )
    jump = bd.simulate(arch, bd.Radau(1e-5), 1.0, start=snap.at(first.row))
    below = bd.equilibrium(equilibria.shallow_arch, to=above, control="arc length")
    assert below.stable
    # Its slowest motion has died away.
    assert_allclose(jump.q[-1], below.q[-1], atol=1e-9)
    heights = jump["crown.y"]
    assert heights.iloc[0] == pytest.approx(4.9e-3, abs=1e-4)
    assert heights.iloc[-1] < -4e-3


@pytest.mark.slow(reason="two runs of a second")
def test_from_the_unstable_branch_the_arch_goes_either_way(snap):
    first, second = snap.critical
    row = (first.row + second.row) // 2
    ends = []
    for share in (0.999, 1.001):
        load = share * snap.factors[row, 0] * equilibria.shallow_arch.parameters["load"]
        arch = equilibria.shallow_arch(load=load, damping=2e-3)
        run = bd.simulate(arch, bd.Radau(1e-5), 1.0, start=snap.at(row))
        ends.append(run["crown.y"].iloc[-1])
    assert ends[0] > 5e-3
    assert ends[1] < -3e-3


@pytest.mark.slow(reason="a path of a hundred points, twice")
def test_a_frame_is_followed_around_turning_points():
    coarse, fine = (
        bd.equilibrium(equilibria.lee_frame(k), to={"load.y": 30.0}, control="arc length")
        for k in (4, 8)
    )
    for path in (coarse, fine):
        assert [one.kind for one in path.critical] == ["limit point"] * 2
        down = np.diff(path.columns["load.y [m]"])
        # Beyond the limit load it comes back up, and goes down again.
        assert np.count_nonzero(np.diff(np.sign(down))) == 2
    factors = [[one.factor for one in path.critical] for path in (coarse, fine)]
    # What four elements leave.
    assert_allclose(factors[0], factors[1], rtol=3e-5)
    with pytest.warns(bd.BeamdaeWarning, match="continues where a displacement turns back"):
        bd.equilibrium(equilibria.lee_frame(4), to={"load.y": 30.0})


@pytest.mark.slow(reason="three paths of an arch, twice")
@pytest.mark.parametrize("side", [1, -1])
def test_an_arch_that_leans_comes_back_where_it_left(side):
    """A pinned arch leaves symmetry at a branch point, and meets it again hanging."""
    arch = equilibria.shallow_arch(rise=0.012)
    whole = bd.equilibrium(arch, to={"crown.y": -0.015}, control="arc length")
    kinds = [one.kind for one in whole.critical]
    assert kinds == ["limit point", "branch point", "branch point", "limit point"]
    branches = [one.factor for one in whole.critical if one.kind == "branch point"]
    with pytest.warns(bd.BeamdaeWarning, match="the path is closed"):
        around = bd.equilibrium(arch, to={"crown.y": -0.015}, switch=side)
    found = [one.factor for one in around.critical if one.kind == "branch point"]
    # At the second one the leaning path only touches the other.
    assert_allclose(found, [*branches, branches[0]], rtol=1e-6)
    leaning = slice(around.critical[1].row + 1, around.critical[2].row)
    assert np.all(around.unstable[leaning] == 1)
    turn = around.columns["crown.angle [rad]"] - np.pi
    assert np.all(np.abs(turn[leaning]) > 1e-4)
    again = bd.equilibrium(arch, to={"crown.y": -0.015}, switch=[side, -1])
    assert again.status.success
    assert again.stable
    assert_allclose(again.q[-1], whole.q[-1], atol=1e-9)


def test_a_follower_load_on_a_thin_column_is_none_with_a_potential():
    """It holds twice what a dead load holds, and more: nothing is lost below 20.05 EI / L^2."""
    path = bd.equilibrium(equilibria.column("body", 1.0, elements=12), to=[15.0, 21.0], step=15.0)
    (flutter,) = path.critical
    assert flutter.kind == "flutter point"
    # Digits of the published load.
    assert flutter.factor == pytest.approx(20.05, abs=5e-3)
    assert path.unstable[[0, 1, -1]].tolist() == [0, 0, 2]


@pytest.mark.parametrize("size", [1e-7, 1e7])
def test_a_path_is_the_same_whatever_load_the_factor_counts(size):
    load = 0.25 * np.pi**2 * size
    path = bd.equilibrium(equilibria.column("inertial", load, elements=4), to=1.2 / size)
    (branch,) = path.critical
    assert branch.kind == "branch point"
    # What rounding leaves beside a stretch that is 1e7 times as stiff.
    assert branch.factor * size == pytest.approx(1.0, rel=2e-6)
