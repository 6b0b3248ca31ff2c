"""Runs of studies: serialized tasks, stored rows, the plan of references, and the page."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from study_models import swing

import beamdae as bd
from beamdae.report.page.page_file import write_page
from beamdae.studies import study_page
from beamdae.studies.execution import study_run
from beamdae.studies.execution.executors import SerialPool
from beamdae.studies.execution.study_run import StudyPlan, StudyResults
from beamdae.studies.store.trajectory_csv import format_trajectory, parse_trajectory
from beamdae.studies.study_pictures import list_plots

ALPHA = bd.GeneralizedAlpha(step=5e-3)


def sweep(*values, **settings):
    cases = tuple(bd.Case(swing, x, ALPHA) for x in values)
    return bd.Study("sweep", cases, references=(), **settings)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    study = sweep(*bd.grid(mass=[1.0, -1.0, *range(2, 6)]))
    return study_run.run_study(study, tmp_path_factory.mktemp("sweep"), SerialPool())


# Trajectory files ---------------------------------------------------------------------------------

ROWS = pd.DataFrame(
    {
        '=a, "b"': [0.1 + 0.2, -1e-17, 5e-324, 1e22],
        "c": [np.nan, np.pi, -0.0, 12.0],
        "d": [np.inf, -np.inf, 1.7976931348623157e308, 123456.789],
    },
    index=pd.Index([0.0, 1 / 3, 0.5, 1.0], name="t [s]"),
)


def test_trajectory_file_is_the_csv_of_pandas():
    expected = ROWS.rename(columns={'=a, "b"': '\'=a, "b"'}).to_csv(lineterminator="\n")
    assert format_trajectory(ROWS) == expected.encode()


@pytest.mark.parametrize("table", [ROWS, ROWS[[]], ROWS.iloc[:0], ROWS.iloc[:1]])
def test_trajectory_file_preserves_all_bits(table):
    parsed = parse_trajectory(format_trajectory(table), table.index.name, list(table))
    pd.testing.assert_frame_equal(parsed, table, check_exact=True, check_column_type=False)
    assert np.array_equal(np.signbit(parsed), np.signbit(table))


# Serialization ------------------------------------------------------------------------------------


# Order of tasks -----------------------------------------------------------------------------------


# Plan of references -------------------------------------------------------------------------------

FINE = (bd.Radau(rtol=1e-5), bd.GeneralizedAlpha(step=1e-3))
MIXED = [bd.Case(swing, {"mass": m}, x) for m, x in ((1.0, ALPHA), (2.0, ALPHA), (2.0, FINE[0]))]


def referenced_groups(cases, **settings):
    """Return the groups with a reference."""
    return list(StudyPlan.of(bd.Study("mixed", tuple(cases), **settings)).methods)


def test_groups_that_compare_integrators_have_references_unless_errors_says_otherwise():
    one, two = "swing(mass=1.0)", "swing(mass=2.0)"
    assert referenced_groups(MIXED) == [two]
    assert referenced_groups(MIXED[:2]) == []
    assert referenced_groups(MIXED[:2] * 2) == [], "the same case twice compares nothing"
    assert (
        referenced_groups(MIXED, errors=True)
        == referenced_groups(MIXED, references=FINE)
        == [one, two]
    )
    assert referenced_groups(MIXED, columns=("end.x [m]",)) == [one, two]
    for none in ({"errors": False}, {"references": ()}, {"references": FINE, "errors": False}):
        assert referenced_groups(MIXED, **none) == []
    assert referenced_groups(MIXED[:2], over="mass") == [f"swing, {ALPHA.label}"]
    assert referenced_groups(MIXED[:2], over="mass", errors=False) == []


def test_cases_with_equal_parameters_share_a_reference():
    parameters = [{}, {"mass": 2}, {"mass": 2.0, "marker": ""}, {"marker": "", "mass": 2.0}]
    cases = [
        bd.Case(swing, x, bd.GeneralizedAlpha(step=h))
        for x, h in zip(parameters, (1, 2, 3, 4), strict=True)
    ]
    plan = StudyPlan.of(bd.Study("mixed", tuple(cases), t_end=10.0))
    assert set(plan.group_by_case.values()) == {"swing"}
    # The references are three runs: two methods, one of them with two steps.
    assert len(plan.tasks) == 4 + 3


def test_regression_different_parameters_with_equal_labels_are_different_groups():
    """Labels of strings and numbers, and of arrays with equal leading digits, are equal."""
    values = (3, "3", np.array([0.1]), np.array([0.1 + 1e-12]), "a", "A")
    free = replace(swing, parameters={"x": None})
    cases = [bd.Case(free, {"x": x}, y) for x in values for y in (ALPHA, FINE[0])]
    plan = StudyPlan.of(bd.Study("mixed", tuple(cases)))
    names = ["swing(x=3)", "swing(x=3) (2)", "swing(x=[0.1])", "swing(x=[0.1]) (2)"]
    names += ["swing(x=a)", "swing(x=A)"]
    assert list(plan.methods) == names
    assert [plan.group_by_case[id(case)] for case in cases[::2]] == names


@pytest.mark.slow(reason="half a second")
def test_study_with_errors_of_some_cases(tmp_path):
    cases = [*MIXED, bd.Case(swing, {"mass": -1.0}, ALPHA)]
    results = study_run.run_study(bd.Study("mixed", tuple(cases)), tmp_path, SerialPool())
    assert list(results.table["error bound [-]"].notna()) == [False, True, True, False]
    assert not results.table["below resolution"][[0, 3]].any()
    assert set(results.summary["group"]) <= {"swing(mass=2.0)"}
    assert not results.failed
    page = study_page.create_study_page(results)
    assert [(x["label"], x["reference"]["accepted"]) for x in page["groups"]] == [
        ("swing(mass=2.0)", True),
        ("mixed", True),
    ]
    assert [case["label"] for case in page["cases"][:2]] == [
        f"swing(mass=1.0), {ALPHA.label}",
        ALPHA.label,
    ]
    assert "bob" in [symbol["name"] for symbol in page["groups"][0]["frames"]["symbols"]]
    assert write_page(tmp_path / "report.html", page).is_file()
    kinds = {column["label"]: column["kind"] for column in page["columns"]}
    assert [kinds[x] for x in ("error", "wall time", "steps")] == ["error", "cost", "number"]
    # Only cases with a reference have differences.
    differences = [case["curves"]["difference"] for case in page["cases"][:3]]
    assert differences[0] == {}
    assert list(differences[1]) == ["observed", "energy"]
    reference = results.references["swing(mass=2.0)"]
    (column, *_) = reference.columns
    expected = results.outcome(cases[1]).table[column] - reference.table[column]
    assert_allclose(differences[1]["observed"][column], expected)


# Studies without references -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("masses", "settings"),
    [
        ((1.0, 1.0), {}),
        ((1.0, 2.0), {}),
        ((1.0, -1.0), {"references": ()}),
        ((1.0, 2.0), {"over": "mass", "errors": False}),
    ],
)
def test_study_without_references_has_no_errors_and_no_summary(masses, settings, tmp_path):
    """Groups of a single run need no reference."""
    cases = tuple(bd.Case(swing, {"mass": mass}, ALPHA) for mass in masses)
    results = study_run.run_study(bd.Study("pair", cases, **settings), tmp_path, SerialPool())
    assert len(results.outcomes) == len(set(masses))
    assert list(results.table["status"]) == ["ok" if mass > 0.0 else "failed" for mass in masses]
    assert "error [-]" not in results.table
    assert results.references == {}
    assert results.summary.empty
    assert not (tmp_path / "summary.csv").exists()
    assert not results.failed


def test_finished_study_runs_no_task_again(swept, tmp_path):
    def require_no_tasks(tasks):
        assert list(tasks) == []
        yield from ()

    pool = SerialPool()
    pool.run_tasks = require_no_tasks
    repeated = study_run.run_study(swept.study, swept.folder, pool)
    pd.testing.assert_frame_equal(repeated.table, swept.table)
    for key, outcome in swept.outcomes.items():
        if outcome.table is not None:
            pd.testing.assert_frame_equal(repeated.outcomes[key].table, outcome.table)


def test_page_without_references_has_one_group_and_the_curves_of_the_first_cases(
    swept, tmp_path, monkeypatch
):
    monkeypatch.setattr(study_page, "MAX_CURVES", 4)
    page = study_page.create_study_page(swept)
    assert [group["id"] for group in page["groups"]] == ["sweep"]
    assert page["cases"][0]["label"] == f"swing(mass=1.0), {ALPHA.label}"
    has_curves = [case["curves"] is not None for case in page["cases"]]
    assert has_curves == [True, False, True, True, False, False]
    blocks = [case.get("block") for case in page["cases"]]
    assert blocks == [None, None, None, None, 0, 0]
    assert page["notes"] == [
        "The curves of 2 of 6 cases are in a folder beside this page, which loads them when you "
        "select the cases."
    ]
    assert page["groups"][0]["reference"] is None
    assert write_page(tmp_path / "report.html", page).stat().st_size > 10_000
    assert list_plots(swept) == {}


def test_regression_warnings_that_several_cases_share_are_described_once():
    """Texts of several warnings differed in their combination: one paragraph per case."""
    bent = "arm: the beam bends {} rad. Use strain='exact' (see arm.x); or more elements."
    missed = "tip.x_dot: the output rows miss {} m/s at t = 1 s, also in tip.y (2 m){}."
    other = "arm.x: the output rows miss its {} value, {} N at t = 1 s."
    texts = [
        f"Further: no. {other.format('largest', 3)}",
        f"{bent.format(0.1)} {missed.format(2, '')}",
        missed.format(3.5, ", tip.z (1 m)"),
        f"{bent.format(0.2)} {missed.format(1e-5, '')} Further: no. "
        f"{other.replace('arm', 'tip').format('smallest', 1)}",
    ]
    study = SimpleNamespace(name="heights", cases=range(4), tag="case {}".format)
    table = pd.DataFrame({"warnings": texts, "group": "a"})
    results = SimpleNamespace(study=study, table=table, references={})
    sentences = StudyResults.describe_warnings(results)
    assert sentences == [
        "heights: warnings in 2 of 4 cases, for example case 0: Further: no.",
        f"heights: warnings in 2 of 4 cases, for example case 0: {other.format('largest', 3)}",
        "heights: warnings in 2 of 4 cases, with the ranges of numbers: "
        f"{bent.format('0.1 to 0.2')}",
        "heights: warnings in 3 of 4 cases, with the ranges of numbers: "
        f"{missed.format('1e-05 to 3.5', '')}",
    ]
