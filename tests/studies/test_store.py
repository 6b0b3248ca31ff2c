"""Store of results: damaged ones are run again with a warning, unfinished files are removed."""

import json
import os
import pickle
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from study_models import swing
from study_runs import LosingPool, SerialPool, run_study

import beamdae as bd
from beamdae.results.outcome import Status
from beamdae.results.storage.documents import checksum
from beamdae.studies.case_table import tabulate_case
from beamdae.studies.references import REFERENCE_NOT_RUN
from beamdae.studies.run_values import measure_rows
from beamdae.studies.store import Store, format_trajectory
from beamdae.studies.tasks import Outcome, Rows, Task

CASE = bd.Case(swing, {"mass": 1.0}, bd.GeneralizedAlpha(step=0.01))
STUDY = bd.results.Study(
    "made", (CASE,), references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3)), t_end=0.1
)
TASK = STUDY.task(CASE)
TABLE = pd.DataFrame(
    {"=end.x [m]": [0.1 + 0.2, -1e-17, 1 / 3], "end.y [m]": [np.nan, np.pi, -0.0]},
    index=pd.Index([0.0, 0.05, 0.1], name="t [s]"),
)
ROWS = Rows(tuple(TABLE), TABLE.reset_index().to_numpy())
OUTCOME = Outcome(
    values={"steps": np.int64(3), "wall time [s]": float("nan")},
    rows=ROWS,
    text=format_trajectory(ROWS.headers, ROWS.numbers),
)


def trajectory(store):
    return store.folder / "trajectories" / TASK.file


@pytest.fixture
def filled(tmp_path):
    store = Store(tmp_path)
    store.save(TASK, OUTCOME)
    return store


def test_saved_outcomes_are_loaded_bit_for_bit(filled):
    outcome = filled.load(TASK)
    pd.testing.assert_frame_equal(outcome.table, TABLE, check_exact=True)
    assert outcome.values["steps"] == 3
    assert outcome.file == TASK.file
    assert trajectory(filled).read_text().startswith("t [s],'=end.x [m],")


def test_trajectories_are_not_read_if_there_is_no_reference(tmp_path):
    outcome = replace(OUTCOME, rows=Rows(ROWS.headers, tmp_path / "missing.csv"))
    row = tabulate_case(CASE, CASE.group, outcome, REFERENCE_NOT_RUN)
    assert np.isnan(row["error [-]"])


def test_measures_of_a_table_without_rows_are_not_defined():
    assert np.isnan(measure_rows(ROWS.headers, ROWS.numbers[:0])["end.y [m]"]).all()


def change_one_digit(text):
    return text.replace(b"3.14159", b"3.14158")


@pytest.mark.parametrize(
    "damage",
    [lambda x: x[:-1], lambda x: x[:-12], lambda x: x[:-40], lambda x: b"", change_one_digit],
)
def test_regression_a_changed_trajectory_is_not_used(filled, damage):
    """Truncated by 12 bytes it raised a traceback at each start, by 1 or 40 it was accepted."""
    file = trajectory(filled)
    before = file.read_bytes()
    file.write_bytes(damage(before))
    assert file.read_bytes() != before
    assert filled.load(TASK) is None


def test_missing_trajectories_are_not_used(filled):
    trajectory(filled).unlink()
    assert filled.load(TASK) is None


def test_loaded_tables_are_complete_and_copied(filled):
    outcome = filled.load(TASK)
    table = outcome.table
    table.iloc[:, 0] = 0.0
    pd.testing.assert_frame_equal(outcome.table, TABLE, check_exact=True)
    pd.testing.assert_frame_equal(pickle.loads(pickle.dumps(outcome)).table, TABLE)


def write_record(path, content):
    """Write a record with the right checksum."""
    content.pop("checksum")
    path.write_text(json.dumps(content | {"checksum": checksum(content)}))


OLD = {"status": {"kind": "ok", "sentence": ""}, "values": {}, "rows": None, "frames": None}
RECORDS = {
    "list": "[]",
    "null": "null",
    "number": "3",
    "NaN": "NaN",
    "truncated": '{"format": 2',
    "binary": b"\x00\xff\xfe" * 100,
    "empty": b"",
    "nested": "[" * 100_000,
    "invalid content": json.dumps({"format": "record", "version": 4}),
    "without format": json.dumps(OLD),
    "another version": json.dumps({"format": "record", "version": 3, "checksum": "0"}),
}


@pytest.mark.parametrize("name", RECORDS)
def test_regression_invalid_records_are_not_used(filled, name):
    text = RECORDS[name]
    filled.record_path(TASK).write_bytes(text if isinstance(text, bytes) else text.encode())
    assert filled.load(TASK) is None


@pytest.mark.parametrize(
    "change",
    [
        {"status": {"kind": "splendid", "sentence": ""}},
        {"status": {"kind": "ok"}},
        {"values": {"steps": [1]}},
        {"columns": [1]},
        {"repetitions": None},
        {"read": []},
        {"time_limit": "x"},
    ],
)
def test_records_with_unexpected_values_are_not_used(filled, change):
    """Their checksum is right."""
    record = json.loads(filled.record_path(TASK).read_text()) | change
    write_record(filled.record_path(TASK), record)
    assert filled.load(TASK) is None


def test_one_changed_digit_of_a_record_is_detected(filled):
    text = filled.record_path(TASK).read_text()
    filled.record_path(TASK).write_text(text.replace('"steps": 3', '"steps": 4'))
    assert filled.load(TASK) is None
    filled.record_path(TASK).write_text(json.dumps(json.loads(text)))
    assert filled.load(TASK) is not None, "the layout is not part of the content"


def test_too_large_records_are_not_read(filled):
    with open(filled.record_path(TASK), "wb") as file:
        file.truncate(2_000_000_000)
    assert filled.load(TASK) is None


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may read all")
def test_unreadable_records_are_reported(filled):
    filled.record_path(TASK).chmod(0)
    assert "cannot be read: Permission denied" in filled.load(TASK)[1]


def test_a_folder_in_the_place_of_a_file_is_refused(tmp_path):
    # The key depends on values to which the model refers, which other tests may have changed.
    Store(tmp_path).record_path(STUDY.task(CASE)).mkdir(parents=True)
    with pytest.raises(bd.BeamdaeError, match=r"\.json: .*Is a directory"):
        run_study(STUDY, tmp_path, SerialPool())


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    return folder, run_study(STUDY, folder, SerialPool())


@pytest.mark.slow(reason="half a second")
def test_regression_damaged_results_are_run_again(run):
    folder, before = run
    file = folder / before.table["trajectory"][0]
    file.write_bytes(file.read_bytes()[:-12])
    seen = []
    again = run_study(STUDY, folder, SerialPool(), seen.append)
    assert (seen[0].stored, seen[0].total) == (3, 4)
    pd.testing.assert_frame_equal(again.outcome(CASE).table, before.outcome(CASE).table)


def test_trajectories_are_named_after_their_case(run):
    folder, results = run
    name = "trajectories/swing-mass=1.0-GeneralizedAlpha-step=0.01-"
    assert results.table["trajectory"].str.startswith(name).all()
    assert all((folder / name).is_file() for name in results.table["trajectory"])
    assert len(list((folder / "trajectories").iterdir())) == 4


def test_names_of_trajectories_are_valid_in_any_file_system():
    notes = ["a/b\\c:*?\n\ud800", "a b c", "A B C", "\u00fcber \u6881", "u\u0308ber \u6881"]
    notes += ["x" * 300, "x" * 300 + "y", "\u6881" * 300, "", "."]
    cases = [bd.Case(swing, {"note": note}) for note in notes]
    names = [STUDY.task(case).file.casefold() for case in cases]
    assert len(set(names)) == len(notes)
    assert all(len(name.encode()) < 130 for name in names)
    assert all(set("/\\:*?\n\ud800 ()").isdisjoint(name) for name in names)


@pytest.mark.slow(reason="half a second")
def test_a_run_with_two_labels_is_stored_once(tmp_path, run):
    """A parameter may be given with its default value; the first label counts."""
    by_default, explicit = (
        bd.Case(swing, {}, CASE.integrator),
        bd.Case(swing, {"mass": 2.0}, CASE.integrator),
    )
    for cases in ((by_default, explicit), (explicit, by_default)):
        results = run_study(replace(STUDY, cases=cases), tmp_path, SerialPool())
        assert results.table["trajectory"].nunique() == 1
        assert (tmp_path / results.table["trajectory"][0]).is_file()


# Writing --------------------------------------------------------------------------------------


def write_half(self, content):
    with open(self, "wb") as file:
        file.write(content[: len(content) // 2])
    raise OSError(28, "No space left on device")


@pytest.mark.slow(reason="half a second")
def test_regression_a_full_disk_ends_the_study_with_an_error(tmp_path, monkeypatch):
    """Stored results stay valid, and no unfinished file is left."""
    writes, write_bytes = [], Path.write_bytes

    def write_three_files(self, content):
        writes.append(self)
        return write_bytes(self, content) if len(writes) < 4 else write_half(self, content)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", write_three_files)
        with pytest.raises(
            bd.BeamdaeError, match="the file cannot be written: No space left on device"
        ):
            run_study(STUDY, tmp_path, SerialPool())
    assert not list(tmp_path.rglob("*.scratch"))
    seen = []
    results = run_study(STUDY, tmp_path, SerialPool(), seen.append)
    assert seen[0].stored == 1
    assert set(results.table["status"]) == {"ok"}


# Cells ----------------------------------------------------------------------------------------


@pytest.mark.slow(reason="a fifth of a second")
def test_formulas_in_tables_are_escaped_and_numbers_stay_numbers(tmp_path):
    cases = (bd.Case(swing, {"note": "=1+2", "mass": 1.0}, CASE.integrator),)
    results = run_study(replace(STUDY, cases=cases), tmp_path, SerialPool())
    table = pd.read_csv(tmp_path / "cases.csv")
    assert table["note"][0] == "'=1+2"
    assert table["mass"][0] == 1.0
    assert results.table["note"][0] == "=1+2"
    assert pd.api.types.is_numeric_dtype(table["error [-]"])
    for path in (tmp_path / "trajectories").iterdir():
        assert all(map(pd.api.types.is_numeric_dtype, pd.read_csv(path).dtypes))


def test_limits_and_status_of_a_failure_are_stored(tmp_path):
    failed = Outcome(Status("failed", "=1+2, it broke"))
    Store(tmp_path).save(TASK, failed)
    assert Store(tmp_path).load(TASK).status == failed.status
    other = Task(TASK.key, CASE, 0.1, 0.01, 3.0)
    assert Store(tmp_path).load(other) is None


# Studies whose processes, cluster, folder or limits fail: no orphans, no lost or wrong rows.

MODEL = """import os
import sys
import time

import beamdae as bd


@bd.model(t_end=0.05)
def swing(mass=1.0):
    BODY
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, 0.1, (1.0, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("bob", bob.at(1.0, 0.0))
    return mech
"""
OVER = ("--over", "mass=1,2,3")

SWINGS = bd.results.Study("swings", tuple(bd.Case(swing, {"mass": m}) for m in (1.0, 2.0, 3.0)))


# Reasons and cells ----------------------------------------------------------------------------


@pytest.mark.slow(reason="draws pictures")
def test_exit_code_of_a_study_with_lost_tasks(tmp_path, monkeypatch):
    executor = "beamdae.studies.executors.create_executor"
    monkeypatch.setattr(executor, lambda *_: LosingPool())
    model = tmp_path / "model.py"
    model.write_text(MODEL.replace("BODY", "pass"))
    command = ["sweep", str(model), *OVER, "--out", str(tmp_path / "results")]
    result = invoke(*command)
    assert result.exit_code == 3
    assert "not run: 2 of 3 runs, because connection-lost. Client lost; run the same" in (
        result.output
    )
    assert "failed:" not in result.output


# Processes ------------------------------------------------------------------------------------


def run_beamdae(folder, *arguments, shell="", **options):
    """Start beamdae in a folder after the shell commands `shell`, in an own process group."""
    env = {**os.environ, "PYTHONPATH": str(Path(bd.__file__).parents[1]), "OWNER": folder.name}
    line = f'{shell} exec "$@"'
    return subprocess.Popen(
        ["bash", "-c", line, "bash", sys.executable, "-m", "beamdae", *arguments],
        cwd=folder,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **options,
    )


@pytest.mark.slow(reason="starts a command")
@pytest.mark.parametrize("limit", [14, 20, 32])
def test_study_works_with_few_open_files(tmp_path, limit):
    (tmp_path / "model.py").write_text(MODEL.replace("BODY", "pass"))
    command = ("sweep", "model.py", *OVER, "--jobs", "2")
    process = run_beamdae(tmp_path, *command, shell=f"ulimit -n {limit};")
    _, err = process.communicate(timeout=120.0)
    assert process.returncode == 0
    assert "Traceback" not in err
    assert err.count("warning: ") == err.count("worker processes can be started") <= 1


def find_processes(owner):
    """Return the processes with this owner in their environment, in any process group."""
    processes = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if f"OWNER={owner}".encode() in path.read_bytes().split(b"\0"):
                processes.append(int(path.parent.name))
        except OSError:
            pass
    return processes


def wait_until(condition):
    """Wait until a condition is true; a minute covers a busy machine."""
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.slow(reason="starts processes")
@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="no /proc")
def test_regression_workers_end_with_a_killed_study(tmp_path):
    """They used to compute until their case ended, and competed with the resumed study."""
    # A busy loop, during which the process reads nothing from its parent.
    body = (
        "marker = open(f'{mass}.txt', 'w')\n    while mass > 1.0 and not os.path.exists('go'): pass"
    )
    (tmp_path / "model.py").write_text(MODEL.replace("BODY", body))
    command = ("sweep", "model.py", *OVER, "--jobs", "2")
    process = run_beamdae(tmp_path, *command)
    wait_until(lambda: len([*tmp_path.glob("[23].0.txt"), *tmp_path.rglob("outcomes/*.json")]) == 3)
    wait_until(lambda: len(find_processes(tmp_path.name)) > 2)
    process.kill()
    process.wait()
    # Orphans would keep the pipes open.
    for stream in (process.stdout, process.stderr):
        stream.close()
    wait_until(lambda: not find_processes(tmp_path.name))
    (tmp_path / "go").touch()
    resumed = run_beamdae(tmp_path, *command)
    _, err = resumed.communicate(timeout=120.0)
    assert resumed.returncode == 0, err
    assert "1 stored before" in err


# Folders --------------------------------------------------------------------------------------


@pytest.mark.slow(reason="half a second")
def test_results_folder_is_locked_while_a_study_runs(tmp_path):
    def start_another(progress):
        with pytest.raises(bd.BeamdaeError, match=r"another process is running a study"):
            run_study(SWINGS, tmp_path, SerialPool())

    run_study(SWINGS, tmp_path, SerialPool(), start_another)
    run_study(SWINGS, tmp_path, SerialPool())


@pytest.mark.slow(reason="half a second")
def test_deleted_working_folder_is_reported(tmp_path, monkeypatch):
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)

    def delete(progress):
        if folder.exists() and progress.done:
            for path in sorted(folder.rglob("*"), reverse=True):
                path.rmdir() if path.is_dir() else path.unlink()
            folder.rmdir()

    with pytest.raises(bd.BeamdaeError, match=r"^results/.*: the working folder has been deleted"):
        bd.sweep(swing, {"mass": [1.0, 2.0]}, folder="results", progress=delete)
    # Without a folder, results need no working folder.
    assert list(bd.sweep(swing, {"mass": [1.0, 2.0]}).table["status"]) == ["ok", "ok"]
