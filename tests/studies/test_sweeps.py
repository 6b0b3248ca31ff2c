"""Many cases that differ in numbers: what they are sent and kept with, and no references."""

from __future__ import annotations

import io
import pickle
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

import beamdae as bd
from beamdae.cli.app import app
from beamdae.report.page.page_file import write_page
from beamdae.studies import study_page as page_data
from beamdae.studies.execution import study_run
from beamdae.studies.execution.executors import LocalPool, SerialPool
from beamdae.studies.execution.study_run import StudyPlan
from beamdae.studies.execution.tasks import serialize_value
from beamdae.studies.store import trajectory_csv as rows
from beamdae.studies.study_pictures import list_plots

ALPHA = bd.GeneralizedAlpha(step=5e-3)


@bd.model(t_end=0.1)
def swing(mass=2.0, marker="", arm=(1.0, 0.0)):
    if marker:
        Path(marker).touch()
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=arm))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("end", bob.at(2.0, 0.0))
    return mech


def sweep(*values, **settings):
    cases = tuple(bd.Case(swing, x, ALPHA) for x in values)
    return bd.Study("sweep", cases, references=(), **settings)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    study = sweep(*bd.grid(mass=[1.0, -1.0, *range(2, 6)]))
    return study_run.run_study(study, tmp_path_factory.mktemp("sweep"), SerialPool())


# Rows as text -------------------------------------------------------------------------------------

ROWS = pd.DataFrame(
    {
        '=a, "b"': [0.1 + 0.2, -1e-17, 5e-324, 1e22],
        "c": [np.nan, np.pi, -0.0, 12.0],
        "d": [np.inf, -np.inf, 1.7976931348623157e308, 123456.789],
    },
    index=pd.Index([0.0, 1 / 3, 0.5, 1.0], name="t [s]"),
)


def test_rows_are_the_text_pandas_writes():
    expected = ROWS.rename(columns={'=a, "b"': '\'=a, "b"'}).to_csv(lineterminator="\n")
    assert rows.format_trajectory(ROWS) == expected.encode()


@pytest.mark.parametrize("table", [ROWS, ROWS[[]], ROWS.iloc[:0], ROWS.iloc[:1]])
def test_rows_are_read_back_to_the_last_bit(table):
    found = rows.parse_trajectory(rows.format_trajectory(table), list(table))
    pd.testing.assert_frame_equal(found, table, check_exact=True, check_column_type=False)
    assert np.array_equal(np.signbit(found), np.signbit(table))


# Packing ------------------------------------------------------------------------------------------


def test_the_model_of_tasks_that_differ_in_numbers_is_packed_once(monkeypatch):
    serialized = []
    monkeypatch.setattr(
        "beamdae.studies.execution.tasks.serialize_value",
        lambda x: serialized.append(x) or serialize_value(x),
    )
    study = sweep(*bd.grid(mass=[1.0, np.float64(2.0), 3]))
    known = {}
    tasks = [study.task(case) for case in study.cases]
    found = [pickle.loads(task.serialize(known)) for task in tasks]
    assert serialized == [swing]
    assert [task.case.parameters["mass"] for task in found] == [1.0, 2.0, 3]
    assert [task.key for task in found] == [task.key for task in tasks]
    # As in separate packings: what a model does to its own values stays in its case.
    assert found[0].case.model.build.__globals__ is not found[1].case.model.build.__globals__


class Arm(tuple):
    """What a user defines."""


def test_a_parameter_of_the_users_own_kind_goes_with_the_model(monkeypatch):
    around = []
    monkeypatch.setattr(
        "beamdae.studies.execution.tasks.serialize_with_model", lambda *_: around.append(1)
    )
    task = replace(
        sweep({}).task(sweep({}).cases[0]), case=bd.Case(swing, {"arm": Arm((1.0, 0.0))})
    )
    assert pickle.loads(task.serialize({})).case.parameters["arm"] == (1.0, 0.0)
    assert around == []


# Order --------------------------------------------------------------------------------------------


@pytest.mark.slow(reason="processes of their own")
def test_a_process_has_its_next_case_before_the_last_one_is_kept(tmp_path):
    markers = [str(tmp_path / f"{k}") for k in range(2)]
    study = sweep(*bd.grid(marker=markers))
    found = LocalPool(1).run_tasks([study.task(case) for case in study.cases])
    try:
        next(found)
        # Nobody asks for the second outcome yet.
        latest = time.monotonic() + 60.0
        while not Path(markers[1]).exists():
            assert time.monotonic() < latest
            time.sleep(0.01)
    finally:
        found.close()


# References where errors are asked for ------------------------------------------------------------

FINE = (bd.Radau(rtol=1e-5), bd.GeneralizedAlpha(step=1e-3))
MIXED = [bd.Case(swing, {"mass": m}, x) for m, x in ((1.0, ALPHA), (2.0, ALPHA), (2.0, FINE[0]))]


def measured(cases, **settings):
    """The groups with a reference."""
    return list(StudyPlan.of(bd.Study("made", tuple(cases), **settings)).methods)


def test_references_are_of_groups_that_compare_integrators_unless_errors_are_asked_for():
    one, two = "swing(mass=1.0)", "swing(mass=2.0)"
    assert measured(MIXED) == [two]
    assert measured(MIXED[:2]) == []
    assert measured(MIXED[:2] * 2) == [], "the same case twice compares nothing"
    assert measured(MIXED, errors=True) == measured(MIXED, references=FINE) == [one, two]
    assert measured(MIXED, columns=("end.x [m]",)) == [one, two]
    for none in ({"errors": False}, {"references": ()}, {"references": FINE, "errors": False}):
        assert measured(MIXED, **none) == []
    assert measured(MIXED[:2], over="mass") == [f"swing, {ALPHA.label}"]
    assert measured(MIXED[:2], over="mass", errors=False) == []


def test_cases_of_equal_parameters_share_a_reference_however_they_are_told():
    told = [{}, {"mass": 2}, {"mass": 2.0, "marker": ""}, {"marker": "", "mass": 2.0}]
    cases = [
        bd.Case(swing, x, bd.GeneralizedAlpha(step=h))
        for x, h in zip(told, (1, 2, 3, 4), strict=True)
    ]
    plan = StudyPlan.of(bd.Study("made", tuple(cases), t_end=10.0))
    assert set(plan.group_by_case.values()) == {"swing"}
    # Two methods, one of them with two steps.
    assert len(plan.tasks) == 4 + 3


def test_regression_parameters_that_read_alike_are_no_group():
    """Text and number, and arrays that differ in digits that are not shown."""
    values = (3, "3", np.array([0.1]), np.array([0.1 + 1e-12]), "a", "A")
    free = replace(swing, parameters={"x": None})
    cases = [bd.Case(free, {"x": x}, y) for x in values for y in (ALPHA, FINE[0])]
    plan = StudyPlan.of(bd.Study("made", tuple(cases)))
    names = ["swing(x=3)", "swing(x=3) (2)", "swing(x=[0.1])", "swing(x=[0.1]) (2)"]
    names += ["swing(x=a)", "swing(x=A)"]
    assert list(plan.methods) == names
    assert [plan.group_by_case[id(case)] for case in cases[::2]] == names


def test_a_study_has_errors_of_some_cases(tmp_path):
    cases = [*MIXED, bd.Case(swing, {"mass": -1.0}, ALPHA)]
    results = study_run.run_study(bd.Study("made", tuple(cases)), tmp_path, SerialPool())
    assert list(results.table["error [-]"].notna()) == [False, True, True, False]
    assert not results.table["below resolution"][[0, 3]].any()
    assert set(results.summary["group"]) <= {"swing(mass=2.0)"}
    assert not results.failed
    page = page_data.create_study_page(results)
    assert [(x["label"], x["reference"]["accepted"]) for x in page["groups"]] == [
        ("swing(mass=2.0)", True),
        ("made", True),
    ]
    assert [case["label"] for case in page["cases"][:2]] == [
        f"swing(mass=1.0), {ALPHA.label}",
        ALPHA.label,
    ]
    assert write_page(tmp_path / "report.html", page).is_file()
    kinds = {column["label"]: column["kind"] for column in page["columns"]}
    assert [kinds[x] for x in ("error", "wall time", "steps")] == ["error", "cost", "number"]
    # Differences to the reference where there is one, which the table has the largest of.
    differences = [case["curves"]["difference"] for case in page["cases"][:3]]
    assert differences[0] == {}
    assert list(differences[1]) == ["observed", "energy"]
    reference = results.references["swing(mass=2.0)"]
    (column, *_) = reference.columns
    found = results.outcome(cases[1]).table[column] - reference.table[column]
    assert_allclose(differences[1]["observed"][column], found)


# Without references -------------------------------------------------------------------------------


def test_a_sweep_runs_its_cases_alone(swept):
    assert len(swept.outcomes) == 6
    assert list(swept.table["status"]) == ["ok", "failed", *["ok"] * 4]
    assert "error [-]" not in swept.table
    assert swept.references == {}
    assert swept.summary.empty
    assert not swept.failed


def test_a_sweep_goes_on_where_it_stopped(swept, tmp_path):
    def refused(tasks):
        assert list(tasks) == []
        yield from ()

    pool = SerialPool()
    pool.outcomes = refused
    again = study_run.run_study(swept.study, swept.folder, pool)
    pd.testing.assert_frame_equal(again.table, swept.table)
    for key, outcome in swept.outcomes.items():
        if outcome.table is not None:
            pd.testing.assert_frame_equal(again.outcomes[key].table, outcome.table)


def test_the_page_of_a_sweep_has_one_group_and_the_curves_of_the_first_cases(
    swept, tmp_path, monkeypatch
):
    monkeypatch.setattr(page_data, "_MAX_CURVES", 4)
    page = page_data.create_study_page(swept)
    assert [group["id"] for group in page["groups"]] == ["sweep"]
    assert page["cases"][0]["label"] == f"swing(mass=1.0), {ALPHA.label}"
    drawn = [case["curves"] is not None for case in page["cases"]]
    assert drawn == [True, False, True, True, False, False]
    assert page["notes"] == [
        "Curves are shown for the first 4 cases; those of all cases are in trajectories/."
    ]
    assert write_page(tmp_path / "report.html", page).stat().st_size > 10_000
    assert list_plots(swept) == {}


def test_references_are_two_or_none():
    with pytest.raises(
        bd.BeamdaeError, match=r"two integrators with different methods, or \(\) for"
    ):
        replace(sweep({}), references=3)
    assert replace(sweep({}), references=[]).references == ()


SWEEP_FILE = f"""
import beamdae as bd

swing = bd.load_model({str(Path(__file__))!r})


@bd.study()
def masses():
    return [bd.Case(swing, x, bd.GeneralizedAlpha(step=5e-3)) for x in bd.grid(mass=[1.0, -1.0])]
"""


@pytest.mark.slow(reason="processes of their own")
def test_the_command_tells_how_many_cases_of_a_sweep_reached_their_end(tmp_path):
    (tmp_path / "study.py").write_text(SWEEP_FILE)
    arguments = ["compare", str(tmp_path / "study.py"), "--workers", "1", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0
    assert "2 cases, 1 reached their end" in result.output
    assert "failed: swing(mass=-1.0), " in result.output
    assert (tmp_path / "masses" / "report.html").is_file()
    table = pd.read_csv(io.BytesIO((tmp_path / "masses" / "cases.csv").read_bytes()))
    assert list(table["mass"]) == [1.0, -1.0]
