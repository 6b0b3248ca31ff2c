"""Faults of studies: damaged files, dying cases, interrupts, and what changed since the last start."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pandas as pd

from robustness.bench import Bench, NotRight, Ran, expect, no_traceback, told, wait_for

MODEL = """import os, sys, time
from pathlib import Path

import numpy as np

import beamdae as bd

LENGTH = 1.0


@bd.model(t_end=0.05)
def swing(mass=1.0):
    # more
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, 0.1, (LENGTH, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("bob", bob.at(LENGTH, 0.0))
    return mech
"""
STUDY = """

@bd.study(SETTINGS)
def few():
    methods = (bd.Ida(1e-4), bd.GeneralizedAlpha(1e-3))
    return [bd.Case(swing, {"mass": mass}, method) for mass in (1.0, 2.0) for method in methods]
"""
RUN = ("compare", "study.py", "--workers", "2")


def _study(bench: Bench, more: str = "pass", settings: str = "time_limit=20.0") -> None:
    text = MODEL.replace("# more", more) + STUDY.replace("SETTINGS", settings)
    bench.write("study.py", text)


def _done(bench: Bench, *codes: int, limit: float = 100.0) -> Ran:
    return told(bench.run(*RUN, limit=limit), *codes)


def _results(bench: Bench) -> Path:
    return bench.folder / "results" / "few"


def _cases(bench: Bench) -> pd.DataFrame:
    return pd.read_csv(_results(bench) / "cases.csv")


def _trajectories(bench: Bench) -> dict[str, str]:
    return {p.name: p.read_text() for p in (_results(bench) / "trajectories").glob("*.csv")}


def _mended(bench: Bench, kind: str, damage) -> None:
    """A second start does a damaged run again, says so, and ends as the first one did."""
    _study(bench)
    _done(bench, 0)
    right, table = _trajectories(bench), _cases(bench)
    path = sorted((_results(bench) / kind).iterdir())[0]
    damage(path)
    again = _done(bench, 0)
    found = _trajectories(bench)
    expect(found == right, "the trajectories are others")
    errors = [c for c in table if c.startswith("error")]
    expect(_cases(bench)[errors].equals(table[errors]), "the errors are others")
    expect("again" in again.err or "damaged" in again.err, "not a word of the damage")


def _cut(count: int):
    return lambda path: path.write_bytes(path.read_bytes()[:-count])


def trajectory_cut_by_1(bench: Bench) -> None:
    """A trajectory without its last byte is done again."""
    _mended(bench, "trajectories", _cut(1))


def trajectory_cut_by_12(bench: Bench) -> None:
    """A trajectory without its last digits is done again."""
    _mended(bench, "trajectories", _cut(12))


def trajectory_cut_by_40(bench: Bench) -> None:
    """A trajectory without some of its last columns is done again."""
    _mended(bench, "trajectories", _cut(40))


def trajectory_with_another_digit(bench: Bench) -> None:
    """A trajectory one digit of which changed is done again."""

    def damage(path: Path) -> None:
        text = path.read_text()
        at = text.rindex(".", 0, len(text) // 2) + 1
        path.write_text(text[:at] + str((int(text[at]) + 5) % 10) + text[at + 1 :])

    _mended(bench, "trajectories", damage)


def trajectory_missing(bench: Bench) -> None:
    """A run without its trajectory is done again."""
    _mended(bench, "trajectories", lambda path: path.unlink())


def record_of_garbage(bench: Bench) -> None:
    """A record that is no JSON is done again."""
    _mended(bench, "outcomes", lambda path: path.write_bytes(os.urandom(1000)))


def record_cut(bench: Bench) -> None:
    """Half a record is done again."""
    _mended(bench, "outcomes", lambda path: path.write_bytes(path.read_bytes()[:100]))


def record_of_a_list(bench: Bench) -> None:
    """A record that is another JSON is done again."""
    _mended(bench, "outcomes", lambda path: path.write_text("[1, 2]"))


def record_of_nan(bench: Bench) -> None:
    """A record whose values became NaN is done again."""

    def damage(path: Path) -> None:
        record = json.loads(path.read_text())
        record["values"] = {key: float("nan") for key in record["values"]}
        path.write_text(json.dumps(record))

    _mended(bench, "outcomes", damage)


def record_is_a_folder(bench: Bench) -> None:
    """A folder by the name of a record is told in a sentence, or moved out of the way."""

    def damage(path: Path) -> None:
        path.unlink()
        path.mkdir()

    _mended(bench, "outcomes", damage)


def _one_dies(bench: Bench, how: str) -> None:
    """The case that dies is a row with a reason, and no other is."""
    _study(bench, f"if mass == 2.0: {how}")
    ran = bench.run(*RUN, limit=100.0)
    told(ran, 0, 1)
    cases = _cases(bench)
    dead = cases["mass"] == 2.0
    expect((cases["status"][~dead] == "ok").all(), "other cases did not end")
    expect((cases["status"][dead] == "failed").all(), "the case that died is not failed")
    expect(cases["reason"][dead].notna().all(), "the case that died has no reason")


# A study is listed in the first process, and its model is built there for its columns.
_WORKER = "__import__('multiprocessing').parent_process() is not None"


def case_killed(bench: Bench) -> None:
    """A case whose process is killed takes no other case with it."""
    _one_dies(bench, f"{_WORKER} and os.kill(os.getpid(), 9)")


def case_that_leaves(bench: Bench) -> None:
    """A case that calls os._exit takes no other case with it."""
    _one_dies(bench, f"{_WORKER} and os._exit(0)")


def case_that_exits(bench: Bench) -> None:
    """A case that calls sys.exit takes no other case with it."""
    _one_dies(bench, "sys.exit(0)")


def case_that_raises_an_interrupt(bench: Bench) -> None:
    """A case that raises KeyboardInterrupt takes no other case with it."""
    _one_dies(bench, f"raise KeyboardInterrupt if {_WORKER} else ValueError")


def case_without_memory(bench: Bench) -> None:
    """A case that asks for more memory than there is fails for that reason."""
    _one_dies(bench, "np.zeros(10**15)")


def memory_limit(bench: Bench) -> None:
    """A case beyond the study's limit of memory is told as such."""
    fill = "if mass == 2.0: globals()['kept'] = np.ones(150_000_000)"
    _study(bench, fill, "time_limit=20.0, memory_limit=0.8")
    told(bench.run(*RUN, limit=100.0), 0, 1)
    cases = _cases(bench)
    heavy = cases[(cases["mass"] == 2.0)]
    expect(heavy["reason"].astype(str).str.contains("memory").all(), "no word of the memory")


def case_that_hangs(bench: Bench) -> None:
    """A model that does not end is killed at the limit and a grace of a minute."""
    hang = f"while mass == 2.0 and {_WORKER}: pass"
    _study(bench, hang, "time_limit=2.0")
    ran = bench.run(*RUN, limit=400.0)
    told(ran, 0, 1)
    cases = _cases(bench)
    expect((cases["status"][cases["mass"] == 1.0] == "ok").all(), "other cases did not end")
    hung = cases[cases["mass"] == 2.0]
    expect((hung["status"] != "ok").all(), "a case that does not end is ok")
    expect(ran.seconds < 250.0, f"it took {ran.seconds:.0f} s")


_SLOW_CASES = "time.sleep(1.0)"


def _interrupted(bench: Bench, ready, times: int = 1) -> None:
    """Ctrl-C ends a study with 130 and a sentence; a second start ends it."""
    _study(bench, _SLOW_CASES)
    process = bench.start(bench.command(*RUN))
    time.sleep(0.5)
    wait_for(lambda: process.poll() is not None or ready(_results(bench)))
    for _ in range(times):
        # As a terminal does: to the whole group.
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            time.sleep(0.4)
    ran = no_traceback(bench.finish(process, 30.0))
    expect(ran.code == 130, f"exit code {ran.code}, {ran.last}")
    if times == 1:
        expect("interrupted" in ran.err, f"not a word of the interrupt: {ran.last}")
    again = _done(bench, 0)
    expect((_cases(bench)["status"] == "ok").all(), f"not all cases ended: {again.last}")


def interrupt_at_the_start(bench: Bench) -> None:
    """Ctrl-C while the study is being read ends it with 130 and no traceback."""
    _study(bench, _SLOW_CASES)
    for seconds in (0.2, 0.5, 0.9):
        process = bench.start(bench.command(*RUN))
        time.sleep(seconds)
        os.killpg(process.pid, signal.SIGINT)
        ran = no_traceback(bench.finish(process, 30.0))
        expect(ran.code in (130, -signal.SIGINT), f"exit code {ran.code}, {ran.last}")


def interrupt_before_the_first_case(bench: Bench) -> None:
    """Ctrl-C before a case ended."""
    _interrupted(bench, lambda results: True)


def interrupt_in_the_middle(bench: Bench) -> None:
    """Ctrl-C after the first case is kept."""
    _interrupted(bench, lambda results: any((results / "outcomes").glob("*.json")))


def interrupt_twice(bench: Bench) -> None:
    """Ctrl-C again while it stops."""
    _interrupted(bench, lambda results: any((results / "outcomes").glob("*.json")), times=3)


def _others(group: int) -> list[str]:
    found = subprocess.run(["pgrep", "-g", str(group)], capture_output=True, text=True, check=False)
    return found.stdout.split()


def study_killed(bench: Bench) -> None:
    """kill -9 leaves no processes behind, and a second start goes on from what was kept."""
    _study(bench, _SLOW_CASES)
    process = bench.start(bench.command(*RUN))
    wait_for(lambda: process.poll() is not None or any(_results(bench).glob("outcomes/*.json")))
    process.kill()
    process.wait()
    kept = len(list(_results(bench).glob("outcomes/*.json")))
    end = time.perf_counter() + 15.0
    while _others(process.pid) and time.perf_counter() < end:
        time.sleep(0.2)
    orphans = _others(process.pid)
    if orphans:
        bench.finish(process, 1.0)
        raise NotRight(f"{len(orphans)} processes go on without their study")
    again = _done(bench, 0)
    expect(f"{kept} kept" in again.err, f"not {kept} kept: {again.last}")
    expect((_cases(bench)["status"] == "ok").all(), "not all cases ended")


FAULTS = (
    trajectory_cut_by_1,
    trajectory_cut_by_12,
    trajectory_cut_by_40,
    trajectory_with_another_digit,
    trajectory_missing,
    record_of_garbage,
    record_cut,
    record_of_a_list,
    record_of_nan,
    record_is_a_folder,
    case_killed,
    case_that_leaves,
    case_that_exits,
    case_that_raises_an_interrupt,
    case_without_memory,
    memory_limit,
    interrupt_at_the_start,
    interrupt_before_the_first_case,
    interrupt_in_the_middle,
    interrupt_twice,
    study_killed,
)
SLOW = (case_that_hangs,)
