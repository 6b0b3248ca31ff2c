"""Benchmark of record: data, scorer and second code; a few mechanisms by beamdae."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.special import ellipj, ellipk

FOLDER = Path(__file__).parents[2] / "validation" / "record"
sys.path.insert(0, str(FOLDER))

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


def test_problems_follow_the_schema_and_files_their_checksums():
    pytest.importorskip("jsonschema")
    assert [message for name in record.all_names() for message in record.check(name)] == []


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
