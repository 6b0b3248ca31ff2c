"""Executors of studies, and faults of processes, files and models."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future

import pandas as pd
import pytest
from study_models import swing
from study_runs import LocalPool, SerialPool, create_executor, create_study_page, run_study

import beamdae as bd


@pytest.fixture
def distributed():
    """Import Dask for the tests that need it; the import takes long."""
    return pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")


QUIETLY = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
STUDY = bd.results.Study(
    "swings",
    tuple(
        bd.Case(swing, {"mass": mass}, bd.GeneralizedAlpha(step=h))
        for mass in (1.0, 2.0, 3.0)
        for h in (2e-3, 1e-3, 5e-4, 2e-4)
    ),
    references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=5e-4)),
)


# Columns that differ between runs and processes.
VARIABLE_COLUMNS = ["wall time [s]", "setup time [s]", "measuring time [s]"]


@QUIETLY
@pytest.mark.slow(reason="starts a scheduler and two workers")
def test_study_survives_a_killed_worker_and_has_the_serial_table(tmp_path, distributed):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        pids = [worker.process.pid for worker in cluster.workers.values()]

        def kill_one(progress):
            if progress.done == 4 and len(pids) == 2:
                os.kill(pids.pop(), signal.SIGKILL)

        results = run_study(
            STUDY, tmp_path / "dask", create_executor("study", "", None, address), kill_one
        )
        repeated = run_study(STUDY, tmp_path / "dask", create_executor("study", "", None, address))
        # The second run had no tasks, and its connection must be closed nevertheless.
        with pytest.raises(ValueError, match="No clients found"):
            distributed.Client.current()
        over = {"mass": [1.0, -1.0, 2.0]}
        outputs = {"rows": lambda run: len(run.t)}
        with pytest.warns(bd.BeamdaeWarning, match="1 of 3 runs did not reach the end time"):
            swept = bd.sweep(swing, over, outputs=outputs, scheduler=address)
    assert list(swept.table["rows"].fillna(0.0)) == [401.0, 0.0, 401.0]
    assert len(pids) == 1
    assert len(repeated.table) == len(STUDY.cases)
    serial = run_study(STUDY, tmp_path / "serial", SerialPool())
    assert set(results.table["status"]) == {"ok"}
    pd.testing.assert_frame_equal(
        results.table.drop(columns=VARIABLE_COLUMNS), serial.table.drop(columns=VARIABLE_COLUMNS)
    )


class InlineExecutor(Executor):
    """Executor that runs tasks at once, and loses those after the first `reliable` ones."""

    def __init__(self, reliable):
        self.reliable = reliable

    def submit(self, function, *arguments):
        future = Future()
        self.reliable -= 1
        if self.reliable >= 0:
            future.set_result(function(*arguments))
        else:
            future.set_exception(OSError("the node is lost"))
        return future


@QUIETLY
def test_sweeps_run_on_any_executor(tmp_path):
    over = {"mass": [1.0, -1.0, 2.0]}
    with pytest.warns(bd.BeamdaeWarning, match="1 of 3 runs did not reach the end time"):
        swept = bd.sweep(swing, over, folder=tmp_path, scheduler=InlineExecutor(3))
    with pytest.warns(bd.BeamdaeWarning):
        serial = bd.sweep(swing, over)
    columns = [name for name in serial.table if name.endswith(("[m]", "[N]"))]
    pd.testing.assert_frame_equal(swept.table[columns], serial.table[columns])


@QUIETLY
def test_tasks_that_an_executor_loses_are_run_again(tmp_path):
    over = {"mass": [1.0, 2.0]}
    with pytest.warns(bd.BeamdaeWarning, match="the executor failed: OSError: the node is lost"):
        swept = bd.sweep(swing, over, folder=tmp_path, scheduler=InlineExecutor(1))
    assert list(swept.table["status"]) == ["ok", "not run"]
    again = bd.sweep(swing, over, folder=tmp_path)
    assert list(again.table["status"]) == ["ok", "ok"]


@QUIETLY
@pytest.mark.parametrize("address", ["host:8786", "tcp://10.0.0.1:8786", "tls://[fe80::1%eth0]:1"])
def test_message_without_dask(address, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(bd.BeamdaeError, match=r"^swing_sweep: scheduler .* requires Dask, "):
        bd.sweep(swing, {"mass": [1.0]}, scheduler=address)


@QUIETLY
def test_a_scheduler_is_an_address_or_an_executor():
    with pytest.raises(bd.BeamdaeError, match=r"scheduler must be the address .*, got 8786\.$"):
        bd.sweep(swing, {"mass": [1.0]}, scheduler=8786)


@QUIETLY
@pytest.mark.slow(reason="waits for an answer")
@pytest.mark.usefixtures("distributed")
def test_missing_scheduler_is_an_error(monkeypatch):
    monkeypatch.setattr("beamdae.studies.executors._CONNECT_TIMEOUT", 0.2)
    with pytest.raises(bd.BeamdaeError, match=r"scheduler tcp://127\.0\.0\.1:9 does not answer"):
        bd.sweep(swing, {"mass": [1.0]}, scheduler="tcp://127.0.0.1:9")


ALPHA = bd.GeneralizedAlpha(step=5e-3)
REFERENCES = (bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3))


class MuteError(Exception):
    def __str__(self):
        raise ValueError("no text")


@bd.model(t_end=0.1)
def faulty(kind="none", marker=""):
    if kind == "exit":
        sys.exit(3)
    if kind == "exit with words":
        sys.exit("enough")
    if kind == "generator":
        raise GeneratorExit
    if kind == "base":
        raise BaseException("odd")
    if kind == "mute":
        raise MuteError
    if kind == "long":
        raise ValueError("a\nb" * 100_000)
    if kind == "interrupt":
        raise KeyboardInterrupt
    if kind == "at once":
        os._exit(0)
    if kind == "at once, 3":
        os._exit(3)
    if kind == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "killed once" and not os.path.exists(f"{marker} once"):
        open(f"{marker} once", "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "hanging":
        time.sleep(1000.0)
    if kind == "talkative":
        sys.stdout.write("x" * 10_000_000)
        os.write(2, b"z" * 1_000_000)
    if kind == "threads":
        threading.Thread(target=time.sleep, args=(1000.0,)).start()
    if kind == "children":
        with open(marker, "a") as file:
            file.write(f"{subprocess.Popen(['sleep', '1000']).pid}\n")
    if kind == "fork":
        os.fork()
    if kind == "elsewhere":
        os.chdir("/")
    return swing()


def create_study(*cases, **settings):
    return bd.results.Study("faults", cases, references=REFERENCES, **settings)


def create_faulty_cases(*kinds):
    return [bd.Case(faulty, {"kind": kind}, ALPHA) for kind in kinds]


REASONS = {
    "exit": "the model called sys.exit(3)",
    "exit with words": "the model called sys.exit('enough')",
    "generator": "GeneratorExit",
    "base": "BaseException: odd",
    "mute": "MuteError",
}


def test_regression_compare_has_a_row_for_each_exception(tmp_path, monkeypatch):
    table = bd.compare([*create_faulty_cases(*REASONS, "long"), bd.Case(swing, {}, ALPHA)])
    assert list(table["reason"][:-2]) == list(REASONS.values())
    assert len(table["reason"][5]) < 300
    assert "\n" not in table["reason"][5]
    assert list(table["status"]) == ["failed"] * 6 + ["ok"]
    with pytest.raises(
        bd.BeamdaeError, match=r"the reference run with .* failed: .*sys\.exit\(3\)"
    ):
        bd.compare([bd.Case(swing)], reference=create_faulty_cases("exit")[0])
    cases = [*create_faulty_cases("interrupt"), bd.Case(swing, {}, ALPHA)]
    interrupted = bd.compare(cases, partial="return")
    assert list(interrupted["status"]) == ["interrupted"] * 2


# Incomplete studies -------------------------------------------------------------------------------
def check_complete(results):
    """Check that the results have all that pictures, page and terminal need, and return them."""
    assert len(results.table) == len(results.study.cases)
    for column in ("status", "reason", "error [-]", "wall time [s]", "below resolution", "steps"):
        assert column in results.table
    assert set(results.references) == set(results.table["group"])
    assert next(iter(results.summary)) == "group"
    assert pd.read_csv(results.folder / "cases.csv").shape == results.table.shape
    assert create_study_page(results)["cases"]
    for case in results.study.cases:
        assert results.outcome(case).status.kind in ("ok", "failed", "interrupted")
        results.frames_of(case)
    return results


@pytest.mark.parametrize("kinds", [("base", "mute"), ("base", "none")])
def test_regression_study_with_a_group_without_a_successful_case_has_all_tables(tmp_path, kinds):
    study = create_study(*create_faulty_cases(*kinds))
    results = check_complete(run_study(study, tmp_path, SerialPool()))
    assert results.failed
    assert not results.interrupted
    # Stored failures give the same table.
    again = check_complete(run_study(results.study, tmp_path, SerialPool()))
    assert list(again.table["reason"]) == list(results.table["reason"])


class InterruptingPool(SerialPool):
    """Executor that sends Ctrl-C `times` times after `after` runs."""

    def __init__(self, after, times=1):
        self.after, self.times = after, times

    def run_tasks(self, tasks):
        for k, result in enumerate(super().run_tasks(tasks)):
            if k == self.after:
                for _ in range(self.times):
                    signal.raise_signal(signal.SIGINT)
            yield result


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("after", [0, 2, 4])
def test_interrupt_at_any_moment_leaves_a_complete_study(tmp_path, after):
    """The moments are before the first run ends, during the references and during the cases."""
    study = create_study(bd.Case(swing, {}, ALPHA), bd.Case(swing, {}, bd.Ida(rtol=1e-3)))
    results = check_complete(run_study(study, tmp_path, InterruptingPool(after)))
    assert results.interrupted
    assert len(results.outcomes) == after
    assert list(results.table["status"]) == ["interrupted" if after < 4 else "ok", "interrupted"]
    reports = []
    assert not check_complete(run_study(study, tmp_path, SerialPool(), reports.append)).interrupted
    assert reports[0].stored == after


def is_alive(pid):
    ran = subprocess.run(["ps", "-o", "stat=", "-p", pid], capture_output=True, text=True)
    return ran.stdout.strip() not in ("", "Z", "Zs", "ZN", "Z+")


# Processes ------------------------------------------------------------------------------------
@pytest.mark.slow(reason="processes die and are started again")
def test_processes_that_die_or_hang_are_rows(tmp_path, monkeypatch, capfd):
    # It includes the start of a process, which takes seconds on a busy machine.
    monkeypatch.setattr("beamdae.studies.executors._KILL_DELAY", 20.0)
    marker = tmp_path / "children"
    kinds = [*REASONS, "interrupt", "at once", "at once, 3", "killed", "hanging"]
    harmless = ["talkative", "threads", "children", "fork", "elsewhere", "killed once", "none"]
    cases = [
        bd.Case(faulty, {"kind": kind, "marker": str(marker)}, ALPHA)
        for kind in [*kinds, *harmless]
    ]
    study = create_study(*cases, time_limit=5.0)
    tasks = [study.task(case) for case in cases]
    begin = time.monotonic()
    results = {task.case.parameters["kind"]: x for task, x in LocalPool(2).run_tasks(tasks)}
    assert time.monotonic() - begin < 120.0
    sentences = {kind: x.status.sentence for kind, x in results.items()}
    assert {kind: sentences[kind] for kind in REASONS} == REASONS
    assert sentences["interrupt"] == "the model raised KeyboardInterrupt"
    dead = {"at once", "at once, 3", "killed"}
    assert {sentences[kind] for kind in dead} == {"the process died 2 times"}
    assert sentences["hanging"] == "killed because the run did not stop at the time limit"
    assert all(results[kind].status.success for kind in harmless)
    assert {kind for kind, x in results.items() if not x.is_final} == dead
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")
    assert not any(map(is_alive, marker.read_text().split()))


DRIVER = """
import sys
from pathlib import Path
if __name__ == "__main__":
    from study_runs import LocalPool, ModelFile, run_study
    study = ModelFile(Path("file.py")).studies["masses"]
    print("ready", flush=True)
    report = lambda progress: print("done", progress.done, flush=True)
    results = run_study(study, Path("out"), LocalPool(2), report)
    print("end", results.interrupted, len(results.table), flush=True)
    print("bye", flush=True)
    sys.stdin.read()
"""


# Each of its eight models takes 0.3 s to build.
SLOW_STUDY = """
import time

import beamdae as bd


@bd.model(t_end=0.1)
def slow(mass=1.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("end", bob.at(2.0, 0.0))
    time.sleep(0.3)
    return mech


@bd.study(references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3)))
def masses():
    return [bd.Case(slow, {"mass": 1.0 + m}, bd.Ida(rtol=1e-4)) for m in range(8)]
"""


@pytest.mark.slow(reason="processes are interrupted as they start, work and end")
@pytest.mark.parametrize(("line", "seconds"), [("ready", 0.1), ("ready", 0.8), ("done 2", 0.0)])
@pytest.mark.parametrize("presses", [1, 3])
def test_regression_interrupt_prints_no_traceback(tmp_path, line, seconds, presses):
    """Processes interrupted while they import or end used to print tracebacks."""
    (tmp_path / "file.py").write_text(SLOW_STUDY)
    (tmp_path / "driver.py").write_text(DRIVER)
    process = subprocess.Popen(
        [sys.executable, "driver.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while process.stdout.readline().strip() != line:
        assert process.poll() is None
    time.sleep(seconds)
    for _ in range(presses):
        # A terminal sends Ctrl-C to all processes of the command.
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.01)
    while (last_line := process.stdout.readline().strip()) and last_line[:3] != "end":
        pass
    _, errors = process.communicate("", timeout=30.0)
    assert last_line == "end True 8"
    assert errors == ""
    assert not list(tmp_path.rglob("*.scratch"))


# Labels ---------------------------------------------------------------------------------------
def test_regression_numbers_of_any_size_have_labels_and_cells(tmp_path):
    values = (10**400, 10**6000, {"a": float("nan")}, {1: 2, "b": 3})
    cases = [bd.Case(swing, {"note": value}, ALPHA) for value in values]
    assert {case.label for case in cases} == {ALPHA.label}
    assert all(case.group.startswith("swing(note=") for case in cases)
    assert len({case.fingerprint(0.1, 0.01) for case in cases}) == len(cases)
    results = run_study(create_study(*cases), tmp_path, InterruptingPool(2))
    assert list(results.table["group"]) == [case.group for case in cases]
    assert len(pd.read_csv(tmp_path / "cases.csv")) == len(cases)
    with pytest.raises(bd.BeamdaeError, match="swing: mass must be finite"):
        create_study(bd.Case(swing, {"mass": 10**400}))
