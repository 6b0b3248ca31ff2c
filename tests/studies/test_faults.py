"""Whatever goes wrong in a study ends in a sentence, and nothing computed is lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from slow_study import slow_study

import beamdae as bd
from beamdae.results.outcome import Status
from beamdae.studies.execution import executors, study_run
from beamdae.studies.execution.deferred_interrupts import DeferredInterrupts
from beamdae.studies.execution.executors import LocalPool, SerialPool
from beamdae.studies.execution.study_progress import TimeEstimator
from beamdae.studies.execution.study_run import StudyResults
from beamdae.studies.execution.tasks import Limits, Outcome
from beamdae.studies.study_page import create_study_page

ALPHA = bd.GeneralizedAlpha(step=5e-3)
REFERENCES = (bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3))


@bd.model(t_end=0.1)
def swing(mass=2.0, extra=None):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("end", bob.at(2.0, 0.0))
    return mech


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
    if kind == "hanging":
        time.sleep(1000.0)
    if kind == "greedy":
        assert [np.ones(10_000_000) for _ in range(1000)]
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


def made(*cases, **settings):
    return bd.Study("made", cases, references=REFERENCES, **settings)


def faults(*kinds):
    return [bd.Case(faulty, {"kind": kind}, ALPHA) for kind in kinds]


RAISED = {
    "exit": "the model called sys.exit(3)",
    "exit with words": "the model called sys.exit('enough')",
    "generator": "GeneratorExit",
    "base": "BaseException: odd",
    "mute": "MuteError",
}


def test_regression_what_a_model_raises_is_the_row_of_its_case(tmp_path):
    """sys.exit() in one of them ended the study with exit code 0 and without tables."""
    study = made(*faults("none", *RAISED, "long"))
    results = study_run.run_study(study, tmp_path, SerialPool())
    assert results.table["status"][0] == "ok"
    assert list(results.table["reason"][1:-1]) == list(RAISED.values())
    (*_, last) = results.table["reason"]
    assert len(last) < 300
    assert "\n" not in last
    assert (tmp_path / "cases.csv").is_file()


def test_regression_compare_gives_a_row_for_whatever_a_model_raises(tmp_path, monkeypatch):
    table = bd.compare([*faults(*RAISED, "long"), bd.Case(swing, {}, ALPHA)])
    assert list(table["reason"][:-2]) == list(RAISED.values())
    assert list(table["status"]) == ["failed"] * 6 + ["ok"]
    with pytest.raises(bd.BeamdaeError, match=r"the reference failed, .*sys\.exit\(3\)"):
        bd.compare([bd.Case(swing)], reference=faults("exit")[0])
    interrupted = bd.compare([*faults("interrupt"), bd.Case(swing, {}, ALPHA)])
    assert list(interrupted["status"]) == ["interrupted"] * 2


# States of a study that is not complete ----------------------------------------------------------


def complete(results: StudyResults) -> StudyResults:
    """All that pictures, page and terminal ask for is there."""
    assert len(results.table) == len(results.study.cases)
    for column in ("status", "reason", "error [-]", "wall time [s]", "below resolution", "steps"):
        assert column in results.table
    assert set(results.references) == set(results.table["group"])
    assert next(iter(results.summary)) == "group"
    assert pd.read_csv(results.folder / "cases.csv").shape == results.table.shape
    assert create_study_page(results)["cases"]
    for case in results.study.cases:
        assert isinstance(results.outcome(case), Outcome)
        results.frames_of(case)
    return results


def test_regression_a_study_without_any_success_is_complete(tmp_path):
    results = complete(study_run.run_study(made(*faults("base", "mute")), tmp_path, SerialPool()))
    assert results.failed
    assert not results.interrupted
    # Again at every start.
    again = complete(study_run.run_study(results.study, tmp_path, SerialPool()))
    assert list(again.table["reason"]) == list(results.table["reason"])


def test_a_group_without_a_success_beside_one_with(tmp_path):
    study = made(*faults("base"), bd.Case(swing, {}, ALPHA))
    results = complete(study_run.run_study(study, tmp_path, SerialPool()))
    assert results.failed
    assert list(results.table["status"]) == ["failed", "ok"]


class Interrupting(SerialPool):
    """Ctrl-C after so many runs, `times` of them."""

    def __init__(self, after, times=1):
        self.after, self.times = after, times

    def run_tasks(self, tasks):
        for k, found in enumerate(super().run_tasks(tasks)):
            if k == self.after:
                for _ in range(self.times):
                    signal.raise_signal(signal.SIGINT)
            yield found


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("after", [0, 2, 4])
def test_an_interrupt_at_any_moment_leaves_a_complete_study(tmp_path, after):
    """Before the first run ended, during references, during the cases."""
    study = made(bd.Case(swing, {}, ALPHA), bd.Case(swing, {}, bd.Ida(rtol=1e-3)))
    results = complete(study_run.run_study(study, tmp_path, Interrupting(after)))
    assert results.interrupted
    assert len(results.outcomes) == after
    assert list(results.table["status"]) == ["interrupted" if after < 4 else "ok", "interrupted"]
    seen = []
    assert not complete(study_run.run_study(study, tmp_path, SerialPool(), seen.append)).interrupted
    assert seen[0].stored == after


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("where", ["_load_stored_outcomes", "_evaluate_outcomes", "_write_tables"])
def test_an_interrupt_while_files_are_read_or_written_waits(tmp_path, monkeypatch, where):
    study = made(bd.Case(swing, {}, ALPHA))
    study_run.run_study(study, tmp_path, SerialPool())
    real = getattr(study_run, where)

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        return real(*arguments)

    monkeypatch.setattr(study_run, where, interrupted)
    standings = []
    results = complete(study_run.run_study(study, tmp_path, SerialPool(), standings.append))
    assert results.interrupted
    assert len(standings) == 1


def test_interrupts_are_held_back_noted_and_heard_by_those_before():
    heard = []
    before = signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    try:
        with DeferredInterrupts() as interrupts:
            signal.raise_signal(signal.SIGINT)
            assert interrupts.received
        assert signal.getsignal(signal.SIGINT)(2, None) is None
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [2, 2]
    with DeferredInterrupts() as interrupts:
        interrupts.immediate = True
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
    ignored = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with DeferredInterrupts() as interrupts:
            signal.raise_signal(signal.SIGINT)
        assert not interrupts.received
    finally:
        signal.signal(signal.SIGINT, ignored)


def lives(number):
    found = subprocess.run(["ps", "-o", "stat=", "-p", number], capture_output=True, text=True)
    return found.stdout.strip() not in ("", "Z", "Zs", "ZN", "Z+")


# Processes ------------------------------------------------------------------------------------


@pytest.mark.slow(reason="processes die and are started again")
def test_processes_that_die_hang_or_leave_something_are_rows(tmp_path, monkeypatch, capfd):
    # The start of a process is within it, and machines are slow.
    monkeypatch.setattr(executors, "_KILL_DELAY", 20.0)
    marker = tmp_path / "children"
    kinds = [*RAISED, "interrupt", "at once", "at once, 3", "killed", "hanging", "greedy"]
    left = ["talkative", "threads", "children", "fork", "elsewhere", "none"]
    cases = [
        bd.Case(faulty, {"kind": kind, "marker": str(marker)}, ALPHA) for kind in [*kinds, *left]
    ]
    study = made(*cases, limits=Limits(time=2.0, memory=1.0))
    # References may take ten times as long.
    tasks = [study.task(case) for case in cases]
    begin = time.monotonic()
    found = {
        task.case.parameters["kind"]: (outcome, keep)
        for task, outcome, keep in LocalPool(2).run_tasks(tasks)
    }
    assert time.monotonic() - begin < 120.0
    sentences = {kind: outcome.status.sentence for kind, (outcome, _) in found.items()}
    assert {kind: sentences[kind] for kind in RAISED} == RAISED
    assert sentences["interrupt"] == "the model raised KeyboardInterrupt"
    died = "its process died 2 times, it"
    assert sentences["at once"] == f"{died} ended with exit code 0"
    assert sentences["at once, 3"] == f"{died} ended with exit code 3"
    assert sentences["killed"] == f"{died} was killed by SIGKILL"
    assert sentences["hanging"] == "killed, it did not end at its time limit"
    assert "memory" in sentences["greedy"]
    assert all(found[kind][0].status.success for kind in left)
    assert [kind for kind, (_, keep) in found.items() if not keep] == [
        kind for kind in found if sentences[kind].startswith(died)
    ]
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")
    assert not any(map(lives, marker.read_text().split()))


DRIVER = """
import sys
from pathlib import Path
if __name__ == "__main__":
    from beamdae.cli.model_files.model_file import ModelFile
    from beamdae.studies.execution import study_run
    from beamdae.studies.execution.executors import LocalPool
    study = ModelFile(Path("file.py")).studies["masses"]
    print("ready", flush=True)
    tell = lambda standing: print("done", standing.done, flush=True)
    results = study_run.run_study(study, Path("out"), LocalPool(2), tell)
    print("end", results.interrupted, len(results.table), flush=True)
    print("bye", flush=True)
    sys.stdin.read()
"""


@pytest.mark.slow(reason="processes are interrupted as they start, work and end")
@pytest.mark.parametrize(("line", "seconds"), [("ready", 0.1), ("ready", 0.8), ("done 2", 0.0)])
@pytest.mark.parametrize("presses", [1, 3])
def test_regression_an_interrupt_is_quiet(tmp_path, line, seconds, presses):
    """Processes that import, and those that end, told tracebacks."""
    (tmp_path / "file.py").write_text(slow_study(cases=8, seconds=0.3))
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
        # As a terminal does: to all processes of the command.
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.01)
    while (told := process.stdout.readline().strip()) and not told.startswith("end"):
        pass
    _, errors = process.communicate("", timeout=30.0)
    assert told == "end True 8"
    assert errors == ""
    assert not list(tmp_path.rglob("*.scratch"))


# Names ----------------------------------------------------------------------------------------

NAMES = ["../x", "/etc/x", "..", ".", ".hidden", "a/b", "a\\b", "x" * 300, "a\nb", "a\0b", "CON"]
NAMES += ["nul.txt", "com1", "", " a", "a ", "a.", "a:b", "\u202ea", "\ud800", "é" * 100]


@pytest.mark.parametrize("name", NAMES)
def test_regression_names_that_lead_out_of_a_folder_are_refused(name):
    """They wrote outside of --out."""
    with pytest.raises(bd.BeamdaeError, match="study: its name must be a valid folder name"):
        bd.Study(name, (bd.Case(swing),))

    def build(mass=1.0):
        return swing()

    build.__name__ = name
    with pytest.raises(bd.BeamdaeError, match="model: build: its name must be a valid folder name"):
        bd.model(t_end=1.0)(build)


@pytest.mark.parametrize("name", ["a", "hub_beam_compare_x=0.5", "größe", "梁", "Con2", "a.b c"])
def test_names_of_folders_are_names(name):
    assert bd.Study(name, (bd.Case(swing),)).name == name


# Wrong arguments --------------------------------------------------------------------------------

CASE = bd.Case(swing)


class Unspeakable:
    def __repr__(self):
        raise RuntimeError


WRONG_CASES = {
    "integrator a text": lambda: bd.Case(swing, integrator="ida"),
    "integrator a class": lambda: bd.Case(swing, integrator=bd.Ida),
    "integrator None": lambda: bd.Case(swing, integrator=None),
    "model None": lambda: bd.Case(None),
    "model a function": lambda: bd.Case(lambda: None),
    "model a mechanism": lambda: bd.Case(swing()),
    "parameters a list": lambda: bd.Case(swing, [1, 2]),
    "parameters None": lambda: bd.Case(swing, None),
    "parameters a text": lambda: bd.Case(swing, "mass=1"),
    "names of parameters": lambda: bd.Case(swing, {1: 2.0}),
    "parameters odd": lambda: bd.Case(swing, Unspeakable()),
}
WRONG_STUDIES = {
    "name None": {"name": None},
    "name a number": {"name": 5},
    "cases None": {"cases": None},
    "cases a case": {"cases": CASE},
    "cases of None": {"cases": (CASE, None)},
    "cases a text": {"cases": "abc"},
    "cases a set": {"cases": {1}},
    "cases none": {"cases": ()},
    "references none for errors": {"references": (), "errors": True},
    "errors a text": {"errors": "yes"},
    "references one": {"references": bd.Ida(1e-6)},
    "references one of two": {"references": (bd.Ida(1e-6),)},
    "references three": {"references": (bd.Ida(1e-6), ALPHA, bd.Radau(1e-6))},
    "references texts": {"references": ("ida", "radau")},
    "references a text": {"references": "ab"},
    "references classes": {"references": (bd.Ida, bd.Radau)},
    "references of None": {"references": (bd.Ida(1e-6), None)},
    "columns a text": {"columns": "q"},
    "columns a number": {"columns": 5},
    "columns None": {"columns": None},
    "columns numbers": {"columns": [1, 2]},
    "t_end a text": {"t_end": "x"},
    "t_end a list": {"t_end": [1.0]},
    "t_end negative": {"t_end": -1.0},
    "t_end nan": {"t_end": float("nan")},
    "t_end huge": {"t_end": 10**400},
    "output_step zero": {"output_step": 0.0},
    "limits None": {"limits": None},
    "limits a number": {"limits": 5.0},
    "limits a dict": {"limits": {"time": 5.0}},
    "repetitions half": {"repetitions": 1.5},
    "repetitions a text": {"repetitions": "two"},
    "repetitions None": {"repetitions": None},
    "repetitions infinite": {"repetitions": float("inf")},
    "over a number": {"over": 5},
    "over a list": {"over": ["mass"]},
    "over unknown": {"over": "elements"},
}


@pytest.mark.parametrize("name", WRONG_CASES)
def test_regression_wrong_cases_are_told(name):
    with pytest.raises(bd.BeamdaeError, match=r"^Case(: model| of swing: \w+) must be .*got .*\.$"):
        WRONG_CASES[name]()


@pytest.mark.parametrize("name", WRONG_STUDIES)
def test_regression_wrong_studies_are_told(name):
    good = {"name": "made", "cases": (CASE,), "references": REFERENCES}
    with pytest.raises(bd.BeamdaeError, match=r"^(made|study): .*\.$") as caught:
        bd.Study(**(good | WRONG_STUDIES[name]))
    assert "\n" not in str(caught.value)


def lists(result):
    def listing():
        return result() if callable(result) else result

    return listing


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lists(None), "listing: cases must be a list of at least one Case, got None"),
        (lists(5), "listing: cases must be a list of at least one Case, got 5"),
        (lists([]), "listing: cases must be a list of at least one Case, got "),
        (lists([1]), "listing: cases must be a list of at least one Case, got 1 in it"),
        (lists(lambda: (1 / 0 for _ in "a")), "listing: it cannot list its cases, ZeroDivisionErr"),
        (lists(lambda: sys.exit(3)), r"listing: it cannot list its cases, it called sys.exit\(3\)"),
        (lambda x: [CASE], "it cannot list its cases, TypeError"),
        (5, "study: it must decorate a function, got 5"),
        (None, "study: it must decorate a function, got None"),
    ],
)
def test_regression_wrong_functions_of_studies_are_told(function, words):
    with pytest.raises(bd.BeamdaeError, match=words):
        bd.study()(function)


def test_a_study_may_list_its_cases_one_by_one():
    @bd.study()
    def listing():
        yield from (CASE, CASE)

    assert len(listing.cases) == 2


@pytest.mark.parametrize("name", ["time_limit", "memory_limit", "patience"])
@pytest.mark.parametrize("value", ["x", -1.0, 0, float("nan"), [1.0], 10**400])
def test_limits_that_are_none_are_told(name, value):
    with pytest.raises(bd.BeamdaeError, match=f"study: {name} must"):
        bd.study(**{name: value})
    with pytest.raises(bd.BeamdaeError, match=r"Limits: \w+ must"):
        Limits(value)


@pytest.mark.parametrize("value", [5, None, "abc", b"abc", {"a": 1}, Unspeakable()])
def test_grids_of_what_is_no_list_are_told(value):
    with pytest.raises(bd.BeamdaeError, match="grid: mass must be a list of values, got "):
        bd.grid(mass=value)


def test_grids_that_do_not_end_are_told():
    with pytest.raises(bd.BeamdaeError, match="grid: mass, size must have at most 1000000 comb"):
        bd.grid(mass=range(10_000), size=range(10_000))
    assert len(bd.grid(mass=(m for m in range(3)), size=np.arange(2))) == 6
    assert bd.grid() == [{}]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"columns": "q"}, "columns must be a list of names"),
        ({"columns": 5}, "columns must be a list of names"),
        ({"reference": 5}, "reference must be a Case or a Solution"),
        ({"t_end": "x"}, "t_end must be a number"),
        ({"output_step": -1}, "output_step must be positive"),
        ({"progress": 5}, "progress must be a function"),
    ],
)
def test_wrong_comparisons_are_told_before_the_work(settings, words):
    with pytest.raises(bd.BeamdaeError, match=f"compare: {words}"):
        bd.compare([CASE], **settings)


def test_regression_numbers_of_any_size_are_labels_and_cells(tmp_path):
    values = (10**400, 10**6000, {"a": float("nan")}, {1: 2, "b": 3})
    cases = [bd.Case(swing, {"extra": value}, ALPHA) for value in values]
    assert {case.label for case in cases} == {ALPHA.label}
    assert all(case.group.startswith("swing(extra=") for case in cases)
    assert len({case.fingerprint(0.1, 0.01) for case in cases}) == len(cases)
    results = study_run.run_study(made(*cases), tmp_path, Interrupting(2))
    assert list(results.table["group"]) == [case.group for case in cases]
    assert len(pd.read_csv(tmp_path / "cases.csv")) == len(cases)
    with pytest.raises(bd.BeamdaeError, match="swing: mass must be finite"):
        made(bd.Case(swing, {"mass": 10**400}))


# How long it takes ----------------------------------------------------------------------------


def test_the_time_left_follows_what_runs_have_cost():
    steps, masses = (4e-3, 2e-3, 1e-3, 5e-4), (1.0, 2.0)
    cases = [bd.Case(swing, {"mass": m}, bd.GeneralizedAlpha(h)) for m in masses for h in steps]
    tasks = [made(*cases).task(case) for case in cases]
    forecast = TimeEstimator(tasks, 2)
    assert forecast.remaining_time is None

    def ended(task):
        spent = 0.002 / task.case.integrator.step * task.case.parameters["mass"]
        times = {"setup time [s]": 0.0, "measuring time [s]": 0.0, "wall time [s]": spent}
        return Outcome(Status("ok", ""), times)

    costs = [ended(task).values["wall time [s]"] for task in tasks]
    forecast.add(tasks[0], ended(tasks[0]))
    assert 0.4 < forecast.remaining_time / (sum(costs[1:]) / 2) < 1.5
    for k in (1, 4):
        forecast.add(tasks[k], ended(tasks[k]))
    missing = [cost for k, cost in enumerate(costs) if k not in (0, 1, 4)]
    assert 0.7 < forecast.remaining_time / max(sum(missing) / 2, max(missing)) < 1.3
    for k in (2, 3, 5, 6, 7):
        forecast.add(tasks[k], ended(tasks[k]))
    assert forecast.remaining_time == 0.0


def test_progress_hears_of_the_time_left(tmp_path):
    seen = []
    study = made(bd.Case(swing, {}, ALPHA), bd.Case(swing, {}, bd.Ida(rtol=1e-3)))
    study_run.run_study(study, tmp_path, SerialPool(), seen.append)
    assert seen[0].remaining_time is None
    assert all(standing.remaining_time >= 0.0 for standing in seen[1:])
    assert seen[-1].remaining_time == 0.0
    more = replace(study, cases=(*study.cases, bd.Case(swing, {}, bd.Radau(rtol=1e-3))))
    again = []
    study_run.run_study(more, tmp_path, SerialPool(), again.append)
    assert again[0].remaining_time > 0.0, "what is kept tells as well"
