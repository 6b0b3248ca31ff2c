"""Faults of running studies: cases that die or hang, interrupts, a killed study."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from robustness.faults.bench import (
    Bench,
    UnsupportedMachineError,
    expect,
    expect_code,
    expect_exit,
    expect_no_traceback,
    wait_for,
)
from robustness.faults.damaged_studies import (
    RUN,
    STUDY_TIME_LIMIT,
    read_cases,
    results_folder,
    run_few,
    write_study,
)
from robustness.judge import EXIT_INTERRUPTED


def _expect_only_one_failure(bench: Bench, how: str) -> None:
    """Check that the case that dies fails with a reason, and that all others succeed."""
    write_study(bench, f"if mass == 2.0: {how}")
    result = bench.run(*RUN, time_limit=STUDY_TIME_LIMIT)
    expect_exit(result, 0, 1)
    ended = read_cases(bench)
    dead = ended["mass"] == 2.0
    expect((ended["status"][~dead] == "ok").all(), "other cases did not end")
    expect((ended["status"][dead] == "failed").all(), "the case that died is not failed")
    expect(ended["reason"][dead].notna().all(), "the case that died has no reason")


# True only in worker processes, so that the process of the command never dies.
_IN_WORKER = "__import__('multiprocessing').parent_process() is not None"


def case_killed(bench: Bench) -> None:
    """A case whose process is killed affects no other case."""
    _expect_only_one_failure(bench, f"{_IN_WORKER} and os.kill(os.getpid(), 9)")


def case_that_calls_os_exit(bench: Bench) -> None:
    """A case that calls os._exit affects no other case."""
    _expect_only_one_failure(bench, f"{_IN_WORKER} and os._exit(0)")


def case_that_calls_sys_exit(bench: Bench) -> None:
    """A case that calls sys.exit affects no other case."""
    _expect_only_one_failure(bench, "sys.exit(0)")


def case_that_raises_an_interrupt(bench: Bench) -> None:
    """A case that raises KeyboardInterrupt affects no other case."""
    _expect_only_one_failure(bench, f"raise KeyboardInterrupt if {_IN_WORKER} else ValueError")


def case_that_exhausts_memory(bench: Bench) -> None:
    """A case that allocates more memory than available fails with that reason."""
    _expect_only_one_failure(bench, "np.zeros(10**15)")


def case_that_hangs(bench: Bench) -> None:
    """A model that does not end is killed one minute after its time limit."""
    hang = f"while mass == 2.0 and {_IN_WORKER}: pass"
    write_study(bench, hang, "time_limit=2.0")
    result = bench.run(*RUN, time_limit=400.0)
    expect_exit(result, 0, 1)
    ended = read_cases(bench)
    expect((ended["status"][ended["mass"] == 1.0] == "ok").all(), "other cases did not end")
    hung = ended[ended["mass"] == 2.0]
    expect((hung["status"] != "ok").all(), "a case that does not end is ok")
    expect(result.seconds < 250.0, f"it took {result.seconds:.0f} s")


_SLOW_CASES = "time.sleep(1.0)"


def _interrupt_study(bench: Bench, is_ready: Callable[[Path], object], signals: int = 1) -> None:
    """Check that Ctrl-C ends a study with 130 and a message, and that a restart completes it."""
    write_study(bench, _SLOW_CASES)
    process = bench.start(bench.command(*RUN))
    time.sleep(2.0)
    wait_for(lambda: process.poll() is not None or is_ready(results_folder(bench)))
    for _ in range(signals):
        # A terminal signals the whole process group.
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            time.sleep(0.4)
    result = expect_no_traceback(bench.finish(process, 30.0))
    expect_code(result, EXIT_INTERRUPTED)
    if signals == 1 and any(results_folder(bench).glob("outcomes/*.json")):
        expect("interrupted" in result.err, f"no message about the interrupt: {result.error_tail}")
    restart = run_few(bench, 0)
    expect(
        (read_cases(bench)["status"] == "ok").all(), f"not all cases ended: {restart.error_tail}"
    )


def interrupt_at_the_start(bench: Bench) -> None:
    """Ctrl-C during the import of the study ends it with 130 and without traceback."""
    write_study(bench, _SLOW_CASES)
    for seconds in (0.2, 0.5, 0.9):
        process = bench.start(bench.command(*RUN))
        time.sleep(seconds)
        os.killpg(process.pid, signal.SIGINT)
        result = expect_no_traceback(bench.finish(process, 30.0))
        expect_code(result, EXIT_INTERRUPTED, -signal.SIGINT)


def interrupt_before_the_first_case(bench: Bench) -> None:
    """Ctrl-C before the first case has ended."""
    _interrupt_study(bench, lambda results: True)


def interrupt_in_the_middle(bench: Bench) -> None:
    """Ctrl-C after the first case is saved."""
    _interrupt_study(bench, lambda results: any((results / "outcomes").glob("*.json")))


def interrupt_twice(bench: Bench) -> None:
    """Ctrl-C repeated while the study stops."""
    _interrupt_study(bench, lambda results: any((results / "outcomes").glob("*.json")), signals=3)


def _count_processes(mark: str) -> int:
    """Count processes with this entry in their environment, in any process group."""
    count = 0
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            count += mark.encode() in path.read_bytes().split(b"\0")
    return count


def study_killed(bench: Bench) -> None:
    """SIGKILL leaves no processes behind, and a restart reuses saved outcomes."""
    if not Path("/proc/self/environ").exists():
        raise UnsupportedMachineError("no /proc to find processes in")
    write_study(bench, _SLOW_CASES)
    bench.env["ROBUSTNESS"] = bench.folder.name
    process, mark = bench.start(bench.command(*RUN)), f"ROBUSTNESS={bench.folder.name}"
    wait_for(
        lambda: process.poll() is not None or any(results_folder(bench).glob("outcomes/*.json")),
        STUDY_TIME_LIMIT,
    )
    working = _count_processes(mark)
    process.kill()
    process.wait()
    for stream in (process.stdout, process.stderr):
        if stream is not None:
            stream.close()
    kept = len(list(results_folder(bench).glob("outcomes/*.json")))
    expect(working > 1 and kept > 0, f"killed with {working} processes and {kept} outcomes")
    end = time.perf_counter() + 40.0
    while (orphans := _count_processes(mark)) and time.perf_counter() < end:
        time.sleep(0.2)
    expect(not orphans, f"{orphans} processes continue without their study")
    restart = run_few(bench, 0)
    complaint = f"not {kept} stored before: {restart.error_tail}"
    expect(f"{kept} stored before" in restart.err, complaint)
    expect((read_cases(bench)["status"] == "ok").all(), "not all cases ended")


FAULTS = (
    case_killed,
    case_that_calls_os_exit,
    case_that_calls_sys_exit,
    case_that_raises_an_interrupt,
    case_that_exhausts_memory,
    interrupt_at_the_start,
    interrupt_in_the_middle,
    interrupt_twice,
    study_killed,
)
# Slow, or similar to one of the faults above.
SLOW = (
    case_that_hangs,
    interrupt_before_the_first_case,
)
