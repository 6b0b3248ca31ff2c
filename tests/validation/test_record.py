"""Benchmark of record, scoreboard, and programs of validation/performance."""

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scoreboard
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

FOLDER = Path(__file__).parents[2] / "validation" / "record"
PERFORMANCE = FOLDER.with_name("performance")
sys.path[:0] = [str(FOLDER), str(PERFORMANCE)]

import record  # noqa: E402
import scorer  # noqa: E402


@cache
def read_all():
    return scorer.read_references(record.REFERENCES)


def read(name):
    return read_all()[name][0]


@pytest.mark.slow(reason="a quarter of a second")
def test_problems_follow_the_schema_and_are_those_that_were_confirmed():
    pytest.importorskip("jsonschema")
    assert record.check(record.all_names()) == []


def test_reference_of_the_rod_is_the_closed_form():
    # Angle from the lowest position, starting at rest from a right angle: sin(phi/2) = k sn.
    table, uncertainty = read_all()["rod_pendulum"]
    rate, modulus = np.sqrt(1.5 * 9.81), 0.5
    sn, *_ = ellipj(ellipk(modulus) - rate * table["t [s]"].to_numpy(), modulus)
    phi = 2.0 * np.arcsin(np.sqrt(modulus) * sn)
    error = table["end.angle [rad]"] - (np.pi / 2.0 - phi)
    assert np.all(np.abs(error) <= uncertainty["end.angle [rad]"] + 1e-8)


def elastic_line(load):
    """Return x/L and y/L of the tip of an inextensible cantilever under the dead load P L^2/EI."""

    def rates(s, state):
        return [state[1], -load * np.cos(state[0]), np.cos(state[0]), np.sin(state[0])]

    def shoot(curvature):
        run = solve_ivp(rates, (0.0, 1.0), [0.0, curvature, 0.0, 0.0], rtol=1e-11, atol=1e-12)
        return run.y[:, -1]

    curvature = brentq(lambda x: shoot(x)[1], 0.0, load)
    return shoot(curvature)[2:]


def test_reference_of_the_princeton_beam_is_the_elastic_line():
    section = record.load_problem("princeton_cantilever")["sections"]["strip"]
    bending_stiffness, length = 71.7e9 * section["second_moment"], 0.508
    last = read("princeton_cantilever").iloc[-1]
    x, y = elastic_line(3.0 * 4.4482216 * length**2 / bending_stiffness)
    # Shear and extension change the deflection by about (h/L)^2.
    assert last["tip.x [m]"] == pytest.approx(length * x, rel=1e-4)
    assert last["tip.y [m]"] == pytest.approx(-length * y, rel=1e-4)


def test_reference_of_the_roll_up_is_a_circle():
    table = read("roll_up_static").iloc[1:]
    turn = 2.0 * np.pi * table["t [s]"].to_numpy()
    np.testing.assert_allclose(table["tip.angle [rad]"], turn, atol=1e-8)
    np.testing.assert_allclose(table["tip.x [m]"], np.sin(turn) / turn, atol=1e-6)
    np.testing.assert_allclose(table["tip.y [m]"], (1.0 - np.cos(turn)) / turn, atol=1e-6)


def test_static_paths_pass_published_critical_loads():
    section = record.load_problem("deep_arch_static")["sections"]["strip"]
    bending_stiffness = 210e9 * section["second_moment"]
    lee = read("lee_frame_static")["load.factor [-]"].to_numpy()
    bar = 72e9 * record.load_problem("lee_frame_static")["sections"]["bar"]["second_moment"]
    # Lee's frame: 18.55 EI/L^2 and -9.4 EI/L^2 with L = 1.2 m.
    assert lee.max() * 1000.0 * 1.2**2 / bar == pytest.approx(18.5, rel=5e-3)
    assert lee.min() * 1000.0 * 1.2**2 / bar == pytest.approx(-9.39, rel=5e-3)
    arch = read("deep_arch_static")["load.factor [-]"].to_numpy()
    # The path ends just before the limit point of DaDeppo and Schmidt at 8.97 EI/R^2.
    assert 8.8 < arch[-1] / bending_stiffness < 8.97


@pytest.mark.slow(reason="a fifth of a second")
def test_parallelogram_agrees_with_published_elastic_lines():
    # Row Ax = -5, Ay = 7, B = 0 of the boundary-value problems of Su and Servey (2026), which
    # neglect extension and shear: ux/L, uy/L, rotation.
    import plain_beams

    problem = record.load_problem("parallelogram_stage_static")
    problem["sections"]["leaf"]["area"] *= 100.0
    problem["time"] = {"end": 8.0, "output_step": 4.0}
    columns = plain_beams.solve(problem, 4, 4)["columns"]
    x, y, angle = (columns[f"stage.{name}"][-1] for name in ("x [m]", "y [m]", "angle [rad]"))
    published = [-0.07431185, 0.34324368]
    np.testing.assert_allclose([x / 0.25 - 1.0, y / 0.25], published, rtol=2e-4)
    assert angle == pytest.approx(0.00500975, abs=2e-5)


def test_references_of_iftomm_problems_are_those_of_one_unknown():
    last = read("iftomm_a01").iloc[-1]
    assert last["mass.x [m]"] == pytest.approx(-0.275087462577, abs=1e-6)
    assert last["mass.y [m]"] == pytest.approx(-0.961419205099, abs=1e-6)
    # All rockers of A02 turn alike: three rods about their feet, two couplers in translation.
    table = read("double_four_bar")
    run = solve_ivp(
        lambda t, y: [y[1], 9.81 * 3.5 * np.sin(y[0]) / 3.0],
        (0.0, 10.0),
        [0.0, 1.0],
        "DOP853",
        table["t [s]"],
        rtol=1e-12,
        atol=1e-12,
    )
    for rocker in ("rocker", "far rocker"):
        np.testing.assert_allclose(table[f"{rocker}.angle [rad]"], -run.y[0], atol=1e-4)


@pytest.mark.slow(reason="half a second")
def test_table_of_results_shows_the_stored_scores(tmp_path):
    scores = record.read_scores(FOLDER / "results" / "scores.csv")
    scorer.write_markdown(scores, tmp_path / "scores.md", record.FIRST)
    table = (tmp_path / "scores.md").read_text()
    assert table == (FOLDER / "results" / "scores.md").read_text()


@pytest.mark.slow(reason="a fifth of a second")
def test_plain_code_reproduces_its_reference():
    import plain_beams

    problem = record.load_problem("rod_pendulum")
    problem["time"]["end"] = 0.25
    columns = plain_beams.solve(problem, 1, 4)["columns"]
    reference = read("rod_pendulum").iloc[:11]
    for name in reference.columns:
        np.testing.assert_allclose(columns[name], reference[name], rtol=0.0, atol=1e-7)


def test_scores_of_a_known_error():
    reference = pd.DataFrame({"t [s]": [0.0, 1.0, 2.0], "tip.x [m]": [-1.0, 3.0, 1.0]})
    uncertainty = reference * [1.0, 0.0]
    result = reference.iloc[::-1].sort_values("t [s]").copy()
    assert scorer.score_columns(reference, uncertainty, result).loc["tip.x [m]", "error"] == 0.0
    result.loc[1, "tip.x [m]"] += 0.02
    scores = scorer.score_columns(reference, uncertainty, result).loc["tip.x [m]"]
    assert scores["error"] == pytest.approx(0.01)
    assert scores["is_resolved"]
    scores = scorer.score_columns(reference, uncertainty + 0.03, result).loc["tip.x [m]"]
    assert not scores["is_resolved"]


def test_stored_scores_include_failures_and_at_least_three_tools():
    scores = pd.read_csv(FOLDER / "results" / "scores.csv")
    assert len({tool.split("_")[0] for tool in scores["tool"]}) >= 3
    for name in ("beamdae_Auto", "beamdae_refine_0.01", "beamdae_refine_0.001"):
        assert set(scores.loc[scores["tool"] == name, "mechanism"]) == set(record.all_names())


@pytest.mark.slow(reason="runs of three mechanisms")
@pytest.mark.parametrize("name", ["hub_beam_60", "two_link_chain", "spinning_ring"])
def test_exact_beams_agree_with_the_reference(name):
    from adapters import beamdae_adapter

    problem = record.load_problem(name)
    table, information = beamdae_adapter.solve(problem, "Radau 1e-8", 12, "exact")
    assert information["success"]
    scores = scorer.score_columns(*read_all()[name], table)
    assert scores["error"].max() < 5e-5


@pytest.mark.slow(reason="starts worker processes")
def test_worse_values_are_refused(monkeypatch, tmp_path, capsys):
    path = tmp_path / "scoreboard.csv"
    modes = next(x for x in scoreboard.BOARDS if x.name == "modes")
    names = list(modes.cases())[:2]
    board = scoreboard.Board("modes", lambda: names, modes.attempt, quick=2)
    broken = scoreboard.Board("broken", lambda: ["no number"], int, quick=1)
    monkeypatch.setattr(scoreboard, "BOARDS", (board, broken))
    monkeypatch.setattr(scoreboard, "STORED", path)
    monkeypatch.setattr("sys.argv", ["scoreboard.py", "--store"])
    assert scoreboard.main() == 0
    rows = scoreboard.read_stored(path)
    assert list(rows["verdict"]) == ["right", "right", "missed"]
    assert rows["reason"].iloc[-1].startswith("ValueError")
    # Worst digits of a board may decrease by less than 0.3.
    assert not scoreboard.find_losses(rows[:2], rows.assign(digits=rows["digits"] + 0.2))
    losses = scoreboard.find_losses(rows[:2], rows.assign(digits=rows["digits"] + 0.4))
    assert losses[0].startswith("modes: digits ")
    # Machines differ, but not tenfold.
    assert not scoreboard.find_losses(rows[:2], rows.assign(seconds=0.2 * rows["seconds"]))
    losses = scoreboard.find_losses(rows[:2].assign(seconds=200.0), rows.assign(seconds=2.0))
    assert losses[0] == "modes: seconds 2.0 -> 200"
    # What becomes better is no loss.
    assert not scoreboard.find_losses(rows[:2], rows.assign(verdict="false"))
    rows.assign(verdict="right").to_csv(path, index=False)
    monkeypatch.setattr("sys.argv", ["scoreboard.py"])
    capsys.readouterr()
    assert scoreboard.main() == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2] == "broken: right 1 -> 0, missed 0 -> 1"
    assert lines[-1].startswith("  no number: missed, ValueError")


BOARDS = (
    *("critical loads", "tolerances", "record"),
    *("equilibria", "modes", "periodic motions", "section forces"),
    *("errors of equilibria", "errors of modes", "errors of motions"),
)


STORED = scoreboard.read_stored(scoreboard.STORED)
ATTEMPTS = {board.name: board.attempt for board in scoreboard.BOARDS}


def short_cases():
    cases = STORED[STORED["board"].isin(BOARDS) & (STORED["seconds"] < 3.0)]
    for row in cases.itertuples():
        marks = [] if row.seconds < 0.1 else [pytest.mark.slow(reason="0.1 to 3 s")]
        yield pytest.param(
            row.board, row.case, row.verdict, id=f"{row.board}: {row.case}", marks=marks
        )


@pytest.mark.parametrize(("board", "case", "verdict"), list(short_cases()))
def test_no_verdict_is_worse_than_the_stored_one(board, case, verdict):
    for outcome in scoreboard.run_case(ATTEMPTS[board], case):
        order = scoreboard.VERDICTS.index
        assert order(outcome.verdict) <= order(verdict), outcome.reason


SLOW = pytest.mark.slow(reason="repeats runs in turns")


@SLOW
def test_checkout_takes_the_same_time_as_itself():
    import benchmark

    table = benchmark.compare_with_checkout(PERFORMANCE.parents[1], 3, benchmark.SYSTEMS[:1])
    assert table["of medians"].between(0.2, 5.0).all()


@SLOW
def test_errors_against_the_stored_reference():
    import work_precision as wp

    case = wp.CASES[0]
    settings = [
        setting
        for setting in wp.list_settings(case, None, quick=False)
        if setting.mesh == "1 x 6" and setting.integrator in ("GeneralizedAlpha(step=0.001)",)
    ]
    table = wp.run_settings(case, settings, wp.load_reference(case.name))
    table = wp.time_finalists(table, settings, 1)
    # Mesh and floating frame have an error of 0.02 mm; the steps of 1 ms add to it.
    assert table["error [mm]"].between(0.005, 0.1).all()
    assert wp.select_fastest(table)["beamdae"].notna().any()
