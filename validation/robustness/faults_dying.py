"""Faults of studies: cases that die or hang, interrupts, a killed study."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from pathlib import Path

from robustness.bench import Bench, NotPossibleError, expect, no_traceback, told, wait_for
from robustness.faults_studies import RUN, cases, done, results, write_study


def _one_dies(bench: Bench, how: str) -> None:
    """The case that dies is a row with a reason, and no other is."""
    write_study(bench, f"if mass == 2.0: {how}")
    ran = bench.run(*RUN, limit=100.0)
    told(ran, 0, 1)
    ended = cases(bench)
    dead = ended["mass"] == 2.0
    expect((ended["status"][~dead] == "ok").all(), "other cases did not end")
    expect((ended["status"][dead] == "failed").all(), "the case that died is not failed")
    expect(ended["reason"][dead].notna().all(), "the case that died has no reason")


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
    write_study(bench, fill, "time_limit=20.0, memory_limit=0.8")
    told(bench.run(*RUN, limit=100.0), 0, 1)
    ended = cases(bench)
    heavy = ended[(ended["mass"] == 2.0)]
    expect(heavy["reason"].astype(str).str.contains("memory").all(), "no word of the memory")


def case_that_hangs(bench: Bench) -> None:
    """A model that does not end is killed at the limit and a grace of a minute."""
    hang = f"while mass == 2.0 and {_WORKER}: pass"
    write_study(bench, hang, "time_limit=2.0")
    ran = bench.run(*RUN, limit=400.0)
    told(ran, 0, 1)
    ended = cases(bench)
    expect((ended["status"][ended["mass"] == 1.0] == "ok").all(), "other cases did not end")
    hung = ended[ended["mass"] == 2.0]
    expect((hung["status"] != "ok").all(), "a case that does not end is ok")
    expect(ran.seconds < 250.0, f"it took {ran.seconds:.0f} s")


_SLOW_CASES = "time.sleep(1.0)"


def _interrupted(bench: Bench, ready, times: int = 1) -> None:
    """Ctrl-C ends a study with 130 and a sentence; a second start ends it."""
    write_study(bench, _SLOW_CASES)
    process = bench.start(bench.command(*RUN))
    time.sleep(2.0)
    wait_for(lambda: process.poll() is not None or ready(results(bench)))
    for _ in range(times):
        # As a terminal does: to the whole group.
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            time.sleep(0.4)
    ran = no_traceback(bench.finish(process, 30.0))
    expect(ran.code == 130, f"exit code {ran.code}, {ran.last}")
    if times == 1 and any(results(bench).glob("outcomes/*.json")):
        expect("stopped" in ran.err, f"not a word of the interrupt: {ran.last}")
    again = done(bench, 0)
    expect((cases(bench)["status"] == "ok").all(), f"not all cases ended: {again.last}")


def interrupt_at_the_start(bench: Bench) -> None:
    """Ctrl-C while the study is being read ends it with 130 and no traceback."""
    write_study(bench, _SLOW_CASES)
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


def _alive(mark: str) -> int:
    """How many processes were started with this in their environment, in whatever group."""
    count = 0
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            count += mark.encode() in path.read_bytes().split(b"\0")
    return count


def study_killed(bench: Bench) -> None:
    """Kill -9 leaves no processes behind, and a second start goes on from what was kept."""
    if not Path("/proc/self/environ").exists():
        raise NotPossibleError("no /proc to find processes in")
    write_study(bench, _SLOW_CASES)
    bench.env["ROBUSTNESS"] = bench.folder.name
    process, mark = bench.start(bench.command(*RUN)), f"ROBUSTNESS={bench.folder.name}"
    wait_for(
        lambda: process.poll() is not None or any(results(bench).glob("outcomes/*.json")), 100.0
    )
    working = _alive(mark)
    process.kill()
    process.wait()
    for stream in (process.stdout, process.stderr):
        if stream is not None:
            stream.close()
    kept = len(list(results(bench).glob("outcomes/*.json")))
    expect(working > 1 and kept > 0, f"killed with {working} processes and {kept} outcomes")
    end = time.perf_counter() + 40.0
    while (orphans := _alive(mark)) and time.perf_counter() < end:
        time.sleep(0.2)
    expect(not orphans, f"{orphans} processes go on without their study")
    again = done(bench, 0)
    expect(f"{kept} kept" in again.err, f"not {kept} kept: {again.last}")
    expect((cases(bench)["status"] == "ok").all(), "not all cases ended")


FAULTS = (
    case_killed,
    case_that_leaves,
    case_that_exits,
    case_that_raises_an_interrupt,
    case_without_memory,
    memory_limit,
    interrupt_at_the_start,
    interrupt_in_the_middle,
    interrupt_twice,
    study_killed,
)
# Slow, or much like one of those.
SLOW = (
    case_that_hangs,
    interrupt_before_the_first_case,
)
