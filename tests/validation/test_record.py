"""Benchmark of record: data, scorer and second code; a few mechanisms by beamdae."""

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

FOLDER = Path(__file__).parents[2] / "validation" / "record"
sys.path.insert(0, str(FOLDER))

import record  # noqa: E402
import scorer  # noqa: E402


@cache
def read_all():
    return scorer.read_references(record.REFERENCES)


def read(name):
    return read_all()[name][0]


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.parametrize("name", ["princeton_cantilever", "lee_frame_static"])
def test_equations_for_casadi_agree_with_the_reference(name):
    from adapters import equations_adapter

    problem = record.load_problem(name)
    problem["time"]["end"] = 5.0 * problem["time"]["output_step"]
    table, information = equations_adapter.solve(problem, "casadi", "idas", 4)
    assert information["success"], information["reason"]
    reference = read(name).iloc[:6]
    assert list(table.columns) == list(reference.columns)
    np.testing.assert_allclose(table, reference, rtol=1e-4, atol=1e-5)


@pytest.mark.slow
def test_table_of_results_shows_the_stored_scores(tmp_path):
    scores = record.read_scores(FOLDER / "results" / "scores.csv")
    scorer.write_markdown(scores, tmp_path / "scores.md", record.FIRST)
    table = (tmp_path / "scores.md").read_text()
    assert table == (FOLDER / "results" / "scores.md").read_text()


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hub_beam_60", "two_link_chain", "spinning_ring"])
def test_exact_beams_agree_with_the_reference(name):
    from adapters import beamdae_adapter

    problem = record.load_problem(name)
    table, information = beamdae_adapter.solve(problem, "Radau 1e-8", 12, "exact")
    assert information["success"]
    scores = scorer.score_columns(*read_all()[name], table)
    assert scores["error"].max() < 5e-5
