"""Results on disk: what is damaged is run again and told, what is unfinished is swept up."""

from __future__ import annotations

import json
import os
import pickle
import platform
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import beamdae as bd
from beamdae.results.outcome import Status
from beamdae.studies.execution import study_run
from beamdae.studies.execution.case_run import Limits, Outcome, Task
from beamdae.studies.execution.executors import SerialPool
from beamdae.studies.store import store
from beamdae.studies.store.store import Store
from beamdae.studies.unique_names import create_file_names


@bd.model(t_end=0.1)
def swing(mass=2.0, note="", table=None):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("end", bob.at(2.0, 0.0))
    return mech


CASE = bd.Case(swing, {"mass": 1.0}, bd.GeneralizedAlpha(step=0.01))
STUDY = bd.Study(
    "made", (CASE,), references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3)), t_end=0.1
)
TASK = replace(STUDY.task(CASE), name="one")
TABLE = pd.DataFrame(
    {"=end.x [m]": [0.1 + 0.2, -1e-17, 1 / 3], "end.y [m]": [np.nan, np.pi, -0.0]},
    index=pd.Index([0.0, 0.05, 0.1], name="t [s]"),
)
DONE = Outcome(values={"steps": np.int64(3), "wall time [s]": float("nan")}, rows=TABLE)


@pytest.fixture
def filled(tmp_path):
    place = Store(tmp_path)
    place.save(TASK, DONE)
    return place


def test_what_is_kept_is_read_back_to_the_last_bit(filled):
    found, problem = filled.load(TASK)
    assert problem == ""
    pd.testing.assert_frame_equal(found.table, TABLE, check_exact=True)
    assert found.values["steps"] == 3
    assert found.file == filled.trajectory_path(TASK).name
    assert filled.trajectory_path(TASK).read_text().startswith("t [s],'=end.x [m],")


def one_digit(text):
    return text.replace(b"3.14159", b"3.14158")


@pytest.mark.parametrize(
    "damage", [lambda x: x[:-1], lambda x: x[:-12], lambda x: x[:-40], lambda x: b"", one_digit]
)
def test_regression_a_trajectory_that_is_not_what_was_written_is_run_again(filled, damage):
    """Cut by 12 bytes it was a traceback at every start, by 1 or 40 it was taken for good."""
    file = filled.trajectory_path(TASK)
    before = file.read_bytes()
    file.write_bytes(damage(before))
    assert file.read_bytes() != before
    found, problem = filled.load(TASK)
    assert found is None
    assert problem == f"{file.name} is not what was written"


def test_rows_that_are_gone_are_told(filled):
    filled.rows_path(TASK).unlink()
    found, problem = filled.load(TASK)
    assert found is None
    assert problem == "one.csv cannot be read, No such file or directory"


def test_tables_are_read_when_they_are_asked_for(filled):
    """A study that is told again needs few of them."""
    known, asked, late = (filled.load(TASK)[0] for _ in range(3))
    pd.testing.assert_frame_equal(pickle.loads(pickle.dumps(asked)).table, TABLE)
    assert known.table is known.table
    filled.rows_path(TASK).unlink()
    assert known.table is not None
    with pytest.raises(bd.BeamdaeError, match=r"/trajectories: one.csv cannot be read, No such"):
        _ = late.table


def refused(*_):
    raise OSError(1, "Operation not permitted")


@pytest.mark.parametrize("links", [True, False])
def test_trajectories_are_whole_whatever_has_become_of_them(tmp_path, monkeypatch, links):
    """Gone, of an earlier model, or in a file system without links."""
    if not links:
        monkeypatch.setattr(os, "link", refused)
    place = Store(tmp_path)
    place.save(TASK, DONE)
    file = place.trajectory_path(TASK)
    whole = file.read_bytes()
    assert file.samefile(place.rows_path(TASK)) == links
    renamed = replace(TASK, name="other")
    file.unlink()
    place.trajectory_path(renamed).write_bytes(b"of another")
    for task in (TASK, renamed, TASK):
        found, problem = place.load(task)
        assert (found.file, problem) == (f"{task.name}.csv", "")
        assert place.trajectory_path(task).read_bytes() == whole
    assert not list(tmp_path.rglob("*.scratch"))


def changed(record, **values):
    return json.dumps(record | values)


OLD = {"status": {"kind": "ok", "sentence": ""}, "values": {}, "rows": None, "frames": None}
RECORDS = {
    "list": "[]",
    "null": "null",
    "number": "3",
    "NaN": "NaN",
    "cut": '{"format": 2',
    "binary": b"\x00\xff\xfe" * 100,
    "empty": b"",
    "nested": "[" * 100_000,
    "of another version": json.dumps({"format": 3, "outcome": {}}),
    "of an earlier version": json.dumps(OLD),
    "another's": json.dumps({"format": 2, "sha256": "0", "outcome": {}}),
}


@pytest.mark.parametrize("name", RECORDS)
def test_regression_records_that_are_none_are_run_again_and_told(filled, name):
    text = RECORDS[name]
    filled.record_path(TASK).write_bytes(text if isinstance(text, bytes) else text.encode())
    found, problem = filled.load(TASK)
    assert found is None
    assert problem.startswith(filled.record_path(TASK).name)


@pytest.mark.parametrize(
    "change",
    [
        {"status": {"kind": "splendid", "sentence": ""}},
        {"status": {"kind": "ok"}},
        {"values": {"steps": [1]}},
        {"rows": {"columns": []}},
        {"repetitions": None},
        {"read": []},
    ],
)
def test_records_with_values_no_record_has_are_run_again(filled, change):
    """With the right sum: whoever wrote it was no version of this."""
    record = json.loads(filled.record_path(TASK).read_text())
    content = record["outcome"] | change
    filled.record_path(TASK).write_text(
        changed(record, outcome=content, sha256=store._checksum(content))
    )
    assert filled.load(TASK) == (None, f"{filled.record_path(TASK).name} has values no record has")


def test_one_changed_digit_of_a_record_is_seen(filled):
    text = filled.record_path(TASK).read_text()
    filled.record_path(TASK).write_text(text.replace('"steps": 3', '"steps": 4'))
    assert filled.load(TASK)[0] is None
    filled.record_path(TASK).write_text(json.dumps(json.loads(text)))
    assert filled.load(TASK)[0] is not None, "however it is laid out"


def test_a_record_that_is_larger_than_any_is_not_read(filled):
    with open(filled.record_path(TASK), "wb") as file:
        file.truncate(2_000_000_000)
    assert filled.load(TASK)[1].endswith("is larger than any record")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may read all")
def test_a_record_that_may_not_be_read_is_run_again(filled):
    filled.record_path(TASK).chmod(0)
    assert "cannot be read, Permission denied" in filled.load(TASK)[1]


def test_a_folder_in_the_place_of_a_file_is_refused_before_the_work(tmp_path):
    Store(tmp_path).record_path(TASK).mkdir(parents=True)
    with pytest.raises(bd.BeamdaeError, match=r"\.json: it must be a file of results, and is a fo"):
        study_run.run_study(STUDY, tmp_path, SerialPool())


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    return folder, study_run.run_study(STUDY, folder, SerialPool())


def test_regression_damaged_results_are_run_again_and_that_is_told(run):
    folder, before = run
    file = folder / before.table["trajectory"][0]
    file.write_bytes(file.read_bytes()[:-12])
    seen = []
    with pytest.warns(bd.BeamdaeWarning, match=rf"{file.name} is not what was written, so .* run"):
        again = study_run.run_study(STUDY, folder, SerialPool(), seen.append)
    assert (seen[0].kept, seen[0].total) == (3, 4)
    assert len(again.notes) == 1
    pd.testing.assert_frame_equal(again.outcome(CASE).table, before.outcome(CASE).table)
    # Said once: now they are whole.
    assert study_run.run_study(STUDY, folder, SerialPool()).notes == ()


def test_trajectories_are_named_by_their_case(run):
    folder, results = run
    assert list(results.table["trajectory"]) == [
        "trajectories/swing-mass=1.0-GeneralizedAlpha-step=0.01.csv"
    ]
    assert {path.name for path in results.to_parquet()} == {
        "swing-mass=1.0-GeneralizedAlpha-step=0.01.parquet",
        "swing-mass=1.0-GeneralizedAlpha-step=0.0005.parquet",
        "swing-mass=1.0-GeneralizedAlpha-step=0.001.parquet",
        "swing-mass=1.0-Ida-rtol=1e-06.parquet",
    }
    found = {path.name for path in (folder / "trajectories").iterdir()}
    assert all((folder / name).is_file() for name in results.table["trajectory"])
    assert len(found) == 8


def test_names_of_trajectories_do_for_any_file_system():
    method = "Ida(rtol=0.0001)"
    notes = ["a/b\\c:*?\n\ud800", "a b c", "A B C", "\u00fcber \u6881", "u\u0308ber \u6881"]
    notes += ["x" * 300, "x" * 300 + "y", "x" * 301, "", "."]
    found = create_file_names((f"swing(note={note})", method) for note in notes)
    assert found == [
        "swing-note=a-b-c-Ida-rtol=0.0001",
        "swing-note=a-b-c-Ida-rtol=0.0001-2",
        "swing-note=A-B-C-Ida-rtol=0.0001-3",
        "swing-note=\u00fcber-\u6881-Ida-rtol=0.0001",
        "swing-note=\u00fcber-\u6881-Ida-rtol=0.0001-2",
        f"swing-note={'x' * 40}--{'x' * 51}-Ida-rtol=0.0001",
        f"swing-note={'x' * 40}--{'x' * 50}y-Ida-rtol=0.0001",
        f"swing-note={'x' * 40}--{'x' * 51}-Ida-rtol=0.0001-2",
        "swing-note=-Ida-rtol=0.0001",
        "swing-note=-Ida-rtol=0.0001-2",
    ]
    assert len(create_file_names([("\u6881" * 300, "\u6881" * 300)])[0].encode()) < 130


def test_parameters_given_as_they_are_by_default_find_their_file(tmp_path, run):
    """The same run under two labels is kept once, under the first."""
    plain, told = (
        bd.Case(swing, {}, CASE.integrator),
        bd.Case(swing, {"mass": 2.0}, CASE.integrator),
    )
    for cases in ((plain, told), (told, plain)):
        results = study_run.run_study(replace(STUDY, cases=cases), tmp_path, SerialPool())
        assert results.table["trajectory"].nunique() == 1
        assert (tmp_path / results.table["trajectory"][0]).is_file()


# Writing --------------------------------------------------------------------------------------


def no_room(self, content):
    with open(self, "wb") as file:
        file.write(content[: len(content) // 2])
    raise OSError(28, "No space left on device")


def test_regression_a_full_disk_ends_the_study_with_a_sentence(tmp_path, monkeypatch):
    """What was kept stays valid; nothing unfinished is left."""
    writes, real = [], Path.write_bytes

    def sometimes(self, content):
        writes.append(self)
        return real(self, content) if len(writes) < 4 else no_room(self, content)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", sometimes)
        with pytest.raises(bd.BeamdaeError, match="it cannot be written, No space left on device"):
            study_run.run_study(STUDY, tmp_path, SerialPool())
    assert not list(tmp_path.rglob("*.scratch"))
    seen = []
    results = study_run.run_study(STUDY, tmp_path, SerialPool(), seen.append)
    assert seen[0].kept == 1
    assert results.notes == ()
    assert set(results.table["status"]) == {"ok"}


def test_executors_are_closed_before_the_sentence_is_told(tmp_path, monkeypatch):
    closed = []

    class Watched(SerialPool):
        def outcomes(self, tasks):
            try:
                yield from super().outcomes(tasks)
            finally:
                closed.append(True)

    monkeypatch.setattr(Path, "write_bytes", no_room)
    with pytest.raises(bd.BeamdaeError) as caught:
        study_run.run_study(STUDY, tmp_path, Watched())
    assert closed, caught


def test_what_killed_processes_leave_is_swept_up(filled):
    ended = subprocess.Popen([sys.executable, "-S", "-E", "-c", ""])
    ended.wait()
    node, mine = platform.node(), filled.folder / "outcomes"
    names = {
        f".{ended.pid}@{node}@aaaaaaaa.scratch": False,
        f".{os.getpid()}@{node}@bbbbbbbb.scratch": True,
        f".{ended.pid}@elsewhere@cccccccc.scratch": True,
        f".{ended.pid}.scratch": True,
    }
    for name in names:
        (mine / name).write_text("half")
    filled.remove_scratch_files()
    assert {name: (mine / name).exists() for name in names} == names
    assert filled.load(TASK)[0] is not None


# Cells ----------------------------------------------------------------------------------------


def test_tables_are_guarded_and_numbers_stay_numbers(tmp_path):
    cases = (bd.Case(swing, {"note": "=1+2", "mass": 1.0}, CASE.integrator),)
    results = study_run.run_study(replace(STUDY, cases=cases), tmp_path, SerialPool())
    table = pd.read_csv(tmp_path / "cases.csv")
    assert table["note"][0] == "'=1+2"
    assert table["mass"][0] == 1.0
    assert results.table["note"][0] == "=1+2"
    assert pd.api.types.is_numeric_dtype(table["error [-]"])
    for path in (tmp_path / "trajectories").iterdir():
        assert all(map(pd.api.types.is_numeric_dtype, pd.read_csv(path).dtypes))


def test_limits_and_status_of_a_failure_are_kept(tmp_path):
    failed = Outcome(Status("failed", "=1+2, it broke"))
    Store(tmp_path).save(TASK, failed)
    assert Store(tmp_path).load(TASK)[0].status == failed.status
    other = Task(TASK.key, CASE, 0.1, 0.01, Limits(time=3.0))
    assert Store(tmp_path).load(other) == (None, "")
