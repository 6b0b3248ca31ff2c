"""Benchmark of record: data, scorer and second code; a few mechanisms by beamdae."""

import ast
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import typer
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

FOLDER = Path(__file__).parents[2] / "validation" / "record"
sys.path.insert(0, str(FOLDER))

import geometry  # noqa: E402
import record  # noqa: E402
import scorer  # noqa: E402

MECHANISMS = FOLDER / "mechanisms"
CONFIRMED = [
    name
    for name in record.all_names()
    if json.loads((MECHANISMS / name / "confirmation.json").read_text())["status"] == "confirmed"
]


def read(name, table="reference"):
    return pd.read_csv(MECHANISMS / name / f"{table}.csv")


@pytest.mark.slow(reason="a quarter of a second")
def test_problems_follow_the_schema_and_files_their_checksums():
    pytest.importorskip("jsonschema")
    assert [message for name in record.all_names() for message in record.check(name)] == []


@pytest.mark.slow(reason="a quarter of a second")
def test_data_and_scorer_do_not_depend_on_beamdae():
    for path in FOLDER.glob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text())))
        modules = [alias.name for x in nodes if isinstance(x, ast.Import) for alias in x.names]
        modules += [x.module or "" for x in nodes if isinstance(x, ast.ImportFrom)]
        assert not any(name.split(".")[0] == "beamdae" for name in modules), path.name


def test_at_least_twenty_mechanisms_are_confirmed_by_a_second_code():
    assert len(record.all_names()) >= 25
    assert len(CONFIRMED) >= 20
    for name in CONFIRMED:
        confirmation = json.loads((MECHANISMS / name / "confirmation.json").read_text())
        differences = [x["largest"] for x in confirmation["codes"] if x["largest"] is not None]
        assert confirmation["code"] == "plain"
        assert min(differences) <= confirmation["uncertainty"] * (1.0 + 1e-9) <= 1e-4


def test_reference_of_the_rod_is_the_closed_form():
    # Angle from the lowest position, starting at rest from a right angle: sin(phi/2) = k sn.
    table = read("rod_pendulum")
    rate, modulus = np.sqrt(1.5 * 9.81), 0.5
    sn, *_ = ellipj(ellipk(modulus) - rate * table["t [s]"].to_numpy(), modulus)
    phi = 2.0 * np.arcsin(np.sqrt(modulus) * sn)
    error = table["end.angle [rad]"] - (np.pi / 2.0 - phi)
    uncertainty = read("rod_pendulum", "uncertainty")["end.angle [rad]"]
    assert np.all(np.abs(error) <= uncertainty + 1e-8)


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


def test_contact_force_follows_its_law():
    contact = {
        "a": {"point": [0.0, 1.0]},
        "normal": [0.0, 1.0],
        "stiffness": 100.0,
        "exponent": 2.0,
        "hysteresis": 0.5,
        "friction": 0.2,
        "friction_speed": 1.0,
    }
    force = geometry.contact_force(contact, np.array([3.0, 0.9]), np.array([1.0, -0.4]))
    normal = 100.0 * 0.1**2 * (1.0 + 0.5 * 0.4)
    np.testing.assert_allclose(force, [-0.2 * normal * np.tanh(1.0), normal])
    assert not geometry.contact_force(contact, np.array([0.0, 1.1]), np.zeros(2)).any()
    # The force never pulls.
    assert not geometry.contact_force(contact, np.array([0.0, 0.9]), np.array([0.0, 3.0])).any()


def test_resumed_runs_are_kept(tmp_path, monkeypatch):
    calls = []

    def run(tool, problem, setting, elements):
        calls.append(problem["name"])
        return pd.DataFrame({"t [s]": [0.0]}), {"success": True, "reason": ""}

    monkeypatch.setattr(record, "run_tool", run)
    for elements in (2, 2, 4):
        record.solve("beamdae", ["roll_up"], "Auto", elements, tmp_path, True)
    assert calls == ["roll_up", "roll_up"]


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """Record of two mechanisms without runs, with stub runs that equal the stored references."""
    names = ("double_four_bar", "rod_pendulum")
    for name in names:
        shutil.copytree(MECHANISMS / name, tmp_path / "mechanisms" / name)
    (tmp_path / "results").mkdir()
    scores = pd.read_csv(FOLDER / "results" / "scores.csv")
    scores = scores[scores["mechanism"].isin(names)]
    scores.to_csv(tmp_path / "results" / "scores.csv", index=False, float_format="%.4g")

    def run_tool(tool, problem, setting, elements):
        if tool == "beamdae" and problem["name"] == "double_four_bar":
            raise RuntimeError("stopped")
        return read(problem["name"]), {"success": True, "reason": "stub", "processor_time": 1.0}

    def run_solve(arguments, exudyn_python, resume):
        tool, *names, _, setting = arguments
        record.solve(tool, names, setting, results=tmp_path / "results", resume=resume)

    monkeypatch.setattr(record, "MECHANISMS", tmp_path / "mechanisms")
    monkeypatch.setattr(record, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(record, "run_tool", run_tool)
    monkeypatch.setattr(record, "run_solve", run_solve)
    monkeypatch.setattr(record, "require_tools", lambda *arguments: None)
    for name in ("draw", "write_iftomm"):
        monkeypatch.setattr(record.documents, name, lambda *arguments: None)
    monkeypatch.setattr(scorer, "plot_work_precision", lambda *arguments: None)
    return tmp_path


@pytest.mark.slow(reason="half a second")
def test_regression_rebuild_of_one_mechanism_keeps_the_scores_of_the_others(clone):
    file = clone / "results" / "scores.csv"
    before = pd.read_csv(file)
    record.rebuild(["rod_pendulum"], workers=1)
    after = pd.read_csv(file)
    is_new = after["mechanism"] == "rod_pendulum"
    pd.testing.assert_frame_equal(
        after[~is_new], before[before["mechanism"] != "rod_pendulum"], check_dtype=False
    )
    assert set(after.loc[is_new, "reason"]) == {"stub"}
    assert len(after) == len(before)
    assert "double_four_bar" in (clone / "results" / "scores.md").read_text()


def test_regression_documents_are_rebuilt_without_runs(clone):
    contents = {file: file.read_bytes() for file in clone.rglob("*.*") if file.is_file()}
    record.rebuild(["all"], documents_only=True)
    assert {file for file in clone.rglob("*.*") if file.is_file()} == set(contents)
    assert [file for file, content in contents.items() if file.read_bytes() != content] == []


def test_regression_scores_without_runs_are_kept(clone):
    file = clone / "results" / "scores.csv"
    content = file.read_bytes()
    with pytest.raises(typer.BadParameter, match="contains no runs"):
        record.score(clone / "results")
    assert file.read_bytes() == content


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("name", ["double_four_bar", "rod_pendulum"])
def test_regression_rebuild_without_exudyn_keeps_its_entries(clone, name):
    file = clone / "mechanisms" / name / "confirmation.json"
    stored = json.loads(file.read_text())["codes"][1]
    scores = pd.read_csv(clone / "results" / "scores.csv").set_index(["tool", "mechanism"])
    record.rebuild([name], workers=1, without_exudyn=True)
    confirmation = json.loads(file.read_text())
    assert confirmation["codes"][1] == stored
    assert confirmation["status"] == "confirmed"
    if name == "double_four_bar":
        # Only Exudyn confirms it.
        assert confirmation["uncertainty"] == stored["largest"]
        uncertainty = pd.read_csv(file.with_name("uncertainty.csv"))
        pd.testing.assert_frame_equal(uncertainty, read(name, "uncertainty"))
    rebuilt = pd.read_csv(clone / "results" / "scores.csv").set_index(["tool", "mechanism"])
    row = ("exudyn_fine", name)
    pd.testing.assert_series_equal(rebuilt.loc[row], scores.loc[row])
    assert rebuilt.loc[("plain_coarse", name), "reason"] == "stub"


@pytest.mark.slow(reason="a fifth of a second")
def test_entries_of_another_problem_are_not_kept(clone):
    file = clone / "mechanisms" / "rod_pendulum" / "problem.json"
    file.write_text(file.read_text() + "\n")
    record.rebuild(["rod_pendulum"], workers=1, without_exudyn=True)
    codes = json.loads(file.with_name("confirmation.json").read_text())["codes"]
    assert [code["tool"] for code in codes] == ["beamdae"]


def test_rebuild_refuses_unknown_mechanisms_before_the_first_run(clone):
    with pytest.raises(typer.BadParameter, match="unknown mechanism"):
        record.rebuild(["rod_pendulum", "rod"])
    assert [path.name for path in (clone / "results").iterdir()] == ["scores.csv"]


@pytest.mark.slow(reason="starts two processes")
def test_regression_rebuild_stops_if_a_tool_cannot_be_imported(tmp_path):
    with pytest.raises(typer.BadParameter, match=r"exudyn: .*No such file.*--without-exudyn"):
        record.require_tools(["exudyn"], str(tmp_path / "python"))
    (tmp_path / "exudyn.py").write_text("raise ImportError('no wheel')")
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nPYTHONPATH={tmp_path} exec {sys.executable} "$@"\n')
    python.chmod(0o755)
    with pytest.raises(typer.BadParameter, match=r"exudyn: .*no wheel.*--exudyn-python"):
        record.require_tools(["exudyn"], str(python))
    record.require_tools(["plain"], str(python))


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x: x.drop(columns="tip.x [m]"), "columns"),
        (lambda x: x.iloc[:-1], "not all times"),
        (lambda x: x.iloc[:0], "not all times"),
        (lambda x: x.assign(**{"t [s]": np.nan}), "not all times"),
        (lambda x: x.assign(**{"tip.x [m]": np.nan}), "not finite"),
    ],
)
def test_incomplete_results_are_failed_rows(tmp_path, change, message):
    folder, results = tmp_path / "bar", tmp_path / "results" / "tool"
    folder.mkdir()
    results.mkdir(parents=True)
    reference = pd.DataFrame({"t [s]": [0.0, 1.0], "tip.x [m]": [0.0, 2.0]})
    reference.to_csv(folder / "reference.csv", index=False)
    reference.to_csv(folder / "uncertainty.csv", index=False)
    change(reference).to_csv(results / "bar.csv", index=False)
    row = scorer.score_result(folder, results / "bar.csv")
    assert not row["success"]
    assert message in row["reason"]


def test_stored_scores_include_failures_and_at_least_three_tools():
    scores = pd.read_csv(FOLDER / "results" / "scores.csv")
    assert len({tool.split("_")[0] for tool in scores["tool"]}) >= 3
    for name in ("beamdae_Auto", "beamdae_certify_0.01", "beamdae_certify_0.001"):
        assert set(scores.loc[scores["tool"] == name, "mechanism"]) == set(record.all_names())


@pytest.mark.slow(reason="runs of three mechanisms")
@pytest.mark.parametrize("name", ["hub_beam_60", "two_link_chain", "spinning_ring"])
def test_exact_beams_agree_with_the_reference(name):
    from adapters import beamdae_adapter

    problem = record.load_problem(name)
    table, information = beamdae_adapter.solve(problem, "Radau 1e-8", 12, "exact")
    assert information["success"]
    scores = scorer.score_columns(read(name), read(name, "uncertainty"), table)
    assert scores["error"].max() < 5e-5


@pytest.mark.slow(reason="starts a process")
def test_data_packages_pass_frictionless():
    pytest.importorskip("frictionless")
    paths = [str(MECHANISMS / name / "datapackage.json") for name in record.all_names()[:3]]
    for path in paths:
        command = [sys.executable, "-m", "frictionless", "validate", path]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout
