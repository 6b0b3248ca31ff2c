"""Faults of the infrastructure: killed processes, limits of users, full disks, lost clusters."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

import pandas as pd

from robustness.faults.bench import (
    ROOT,
    Bench,
    CommandResult,
    UnsupportedMachineError,
    expect,
    expect_code,
    expect_exit,
    expect_no_traceback,
    mount_small_disk,
    wait_for,
)
from robustness.faults.damaged_studies import MODEL, STUDY_TIME_LIMIT

_OVER = ("--over", "mass=1:6:6")
_SWEEP = ("sweep", "model.py", *_OVER, "--jobs", "2")
_RUN = ("run", "model.py", "--no-estimate")
_COMPARE = ("compare", "model.py", "--workers", "2")
_KILLS = 20  # per command
_QUICK_KILLS = 3
_ORPHAN_TIME_LIMIT = 10.0  # s; a worker that imports modules notices the end of its parent late
_OPEN_FILES = (14, 20, 32)
_PROCESSES = {4: 1, 8: 1, 48: 0}  # number of warnings by the limit
_USER = 12345  # user and group id without any other process
_LARGE_SWEEP = 2000  # cases
_NOT_RUN_CODE = 3
_BUSY_SECONDS = 0.3  # duration of a case without machine code and sleep


def _write_model(bench: Bench, body: str = "pass") -> None:
    bench.write("model.py", MODEL.replace("# more", body))
    bench.env["ROBUSTNESS"] = bench.folder.name


def _busy_body(seconds: float = _BUSY_SECONDS) -> str:
    """Return statements that compute for so long without waiting."""
    return f"end = time.monotonic() + {seconds}\n    while time.monotonic() < end: pass"


def _find_processes(bench: Bench) -> list[int]:
    """Return the processes of the bench, in any process group."""
    mark = f"ROBUSTNESS={bench.folder.name}".encode()
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if mark in path.read_bytes().split(b"\0"):
                found.append(int(path.parent.name))
    return found


def _stored(bench: Bench) -> int:
    return len(list(bench.folder.glob("results/*/outcomes/*.json")))


def _kill_process(process: subprocess.Popen[str]) -> None:
    """Kill a process without waiting for its pipes, which orphans would keep open."""
    process.kill()
    process.wait()
    for stream in (process.stdout, process.stderr):
        if stream is not None:
            stream.close()


def _kill(bench: Bench, command: tuple[str, ...], seconds: float) -> None:
    """Kill a command after so many seconds, and check that no process continues."""
    process = bench.start(bench.command(*command))
    with suppress(subprocess.TimeoutExpired):
        process.wait(seconds)
    _kill_process(process)
    end = time.perf_counter() + _ORPHAN_TIME_LIMIT
    while (orphans := _find_processes(bench)) and time.perf_counter() < end:
        time.sleep(0.05)
    for orphan in orphans:
        with suppress(ProcessLookupError):
            os.kill(orphan, signal.SIGKILL)
    expect(not orphans, f"{len(orphans)} processes continue without their command")
    scratch = list(bench.folder.glob("results/*/cases.csv"))
    expect(all(path.read_text().endswith("\n") for path in scratch), "half a table remains")


def _kill_often(bench: Bench, command: tuple[str, ...], kills: int) -> None:
    """Kill a command at instants over its whole duration, then check that it completes."""
    if not Path("/proc/self/environ").exists():
        raise UnsupportedMachineError("no /proc to find processes in")
    _write_model(bench, _busy_body())
    complete = expect_exit(bench.run(*command, time_limit=STUDY_TIME_LIMIT), 0)
    shutil.rmtree(bench.folder / "results")
    for k in range(kills):
        _kill(bench, command, complete.seconds * (k + 0.5) / kills)
        if k % 4 == 3:
            # Otherwise later commands would find all their cases stored.
            shutil.rmtree(bench.folder / "results", ignore_errors=True)
    expect_exit(bench.run(*command, time_limit=STUDY_TIME_LIMIT), 0)
    leftover = [x.name for x in bench.folder.rglob("*") if x.suffix in (".scratch", ".lock")]
    expect(not leftover, f"files of killed processes remain: {leftover[:3]}")
    for path in bench.folder.glob("results/*/cases.csv"):
        expect((pd.read_csv(path)["status"] == "ok").all(), "not all cases ended")


def sweep_killed_in_a_case(bench: Bench) -> None:
    """SIGKILL of a sweep leaves no process and no damaged file, and a restart completes it."""
    _kill_often(bench, _SWEEP, _QUICK_KILLS)


def sweep_killed_20_times(bench: Bench) -> None:
    """The same for 20 instants over the whole sweep."""
    _kill_often(bench, _SWEEP, _KILLS)


def compare_killed_20_times(bench: Bench) -> None:
    """SIGKILL of a comparison at 20 instants leaves no process and no damaged file."""
    _kill_often(bench, _COMPARE, _KILLS)


def run_killed_20_times(bench: Bench) -> None:
    """SIGKILL of a run at 20 instants leaves no process and no damaged file."""
    _kill_often(bench, _RUN, _KILLS)


def _expect_all_cases(bench: Bench, result: CommandResult, count: int = 6) -> None:
    # Standard error is not judged: without threads, memory allocators print messages, too.
    expect_code(expect_no_traceback(result), 0)
    (path,) = bench.folder.glob("results/*/sweep.csv")
    table = pd.read_csv(path)
    expect(len(table) == count, f"{len(table)} of {count} rows")
    expect((table["status"] == "ok").all(), "not all cases ended")


def large_sweep_killed_and_resumed(bench: Bench) -> None:
    """A sweep of 2 000 cases that is killed three times resumes without repeating a case."""
    _write_model(bench)
    command = ("sweep", "model.py", "--over", f"mass=1:2:{_LARGE_SWEEP}", "--jobs", "2")
    for share in (0.1, 0.4, 0.8):
        process = bench.start(bench.command(*command))
        wait_for(
            lambda process=process, share=share: (
                process.poll() is not None or _stored(bench) > share * _LARGE_SWEEP
            ),
            500.0,
        )
        _kill_process(process)
    kept = _stored(bench)
    result = bench.run(*command, time_limit=500.0)
    _expect_all_cases(bench, result, _LARGE_SWEEP)
    expect(f"{kept} stored before" in result.err, f"not {kept} stored before")


def few_open_files(bench: Bench) -> None:
    """With 14 to 32 open files a sweep uses fewer processes, with at most one warning."""
    _write_model(bench)
    for limit in _OPEN_FILES:
        shutil.rmtree(bench.folder / "results", ignore_errors=True)
        result = bench.run_in_shell(f"ulimit -n {limit}; BEAMDAE {' '.join(_SWEEP)}")
        _expect_all_cases(bench, result)
        expect(result.err.count("processes can be started") <= 1, "more than one warning")


def few_processes(bench: Bench) -> None:
    """With 4 or 8 processes and threads a sweep uses fewer processes, with one warning."""
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        raise UnsupportedMachineError("only root can start a process of a user without others")
    _write_model(bench)
    os.chown(bench.folder, _USER, _USER)
    for folder in bench.folder.parents:
        if folder.name.startswith("robustness-"):
            folder.chmod(0o711)
    # These capabilities only let the other user read Python.
    rights = "+dac_override,+dac_read_search"
    other = f"--reuid={_USER} --regid={_USER} --clear-groups"
    user = f"setpriv {other} --inh-caps={rights} --ambient-caps={rights}"
    bench.env |= {"HOME": str(bench.folder), "BEAMDAE_NATIVE": "off"}
    bench.env.pop("XDG_CACHE_HOME", None)
    for limit, warnings in _PROCESSES.items():
        shutil.rmtree(bench.folder / "results", ignore_errors=True)
        sweep = " ".join((*_SWEEP[:-1], "8"))
        line = f"{user} bash -c 'ulimit -u {limit}; BEAMDAE {sweep}'"
        result = bench.run_in_shell(line, STUDY_TIME_LIMIT)
        _expect_all_cases(bench, result)
        count = result.err.count("processes can be started")
        expect(count == warnings, f"{count} warnings in place of {warnings}")


def working_folder_deleted_in_a_sweep(bench: Bench) -> None:
    """A working folder that is deleted during a sweep is reported in one sentence."""
    _write_model(bench, "time.sleep(1.0)")
    for jobs in ("1", "2"):
        folder = bench.folder / "work"
        folder.mkdir()
        arguments = ("sweep", str(bench.folder / "model.py"), *_OVER, "--jobs", jobs)
        line = shlex.join(bench.command(*arguments))
        process = bench.start(["bash", "-c", f"cd work; exec {line}"])
        wait_for(
            lambda process=process, folder=folder: (
                process.poll() is not None or [*folder.glob("results/*/.lock")]
            )
        )
        # The sweep may write files during the deletion.
        wait_for(lambda folder=folder: _delete(folder))
        result = expect_no_traceback(bench.finish(process))
        expect_code(result, 2)
        expect("the working folder has been deleted" in result.err, result.error_tail)


def _delete(folder: Path) -> bool:
    shutil.rmtree(folder, ignore_errors=True)
    return not folder.exists()


def two_sweeps_in_one_folder(bench: Bench) -> None:
    """The second sweep in one results folder ends with a message that names the first one."""
    _write_model(bench, "while not os.path.exists('go'): time.sleep(0.05)")
    first = bench.start(bench.command(*_SWEEP))
    wait_for(lambda: first.poll() is not None or [*bench.folder.glob("results/*/.lock")])
    second = expect_exit(bench.run(*_SWEEP), 2)
    bench.write("go", "")
    expect(f"process {first.pid}" in second.err, second.error_tail)
    _expect_all_cases(bench, bench.finish(first))


def full_disk_of_a_sweep(bench: Bench) -> None:
    """A sweep on a full disk ends with a message; with more space it resumes."""
    _write_model(bench)
    with mount_small_disk(bench.folder / "results", 100):
        expect_exit(bench.run(*_SWEEP, time_limit=STUDY_TIME_LIMIT), 1, 2)
    _expect_all_cases(bench, bench.run(*_SWEEP, time_limit=STUDY_TIME_LIMIT))


def limit_of_file_sizes(bench: Bench) -> None:
    """A sweep whose files exceed `ulimit -f` ends with a message, after one on the core."""
    _write_model(bench)
    line = f"ulimit -f 4; BEAMDAE {' '.join(_SWEEP)}"
    result = expect_no_traceback(bench.run_in_shell(line, STUDY_TIME_LIMIT))
    expect(result.code in (1, 2), f"exit code {result.code}")
    expect("cannot be written" in result.err, result.error_tail)


def sweep_without_home(bench: Bench) -> None:
    """A sweep works without HOME and without a cache; the warning is the same as of a run."""
    _write_model(bench)
    bench.env |= {"HOME": "/proc/nowhere"}
    bench.env.pop("XDG_CACHE_HOME", None)
    messages = []
    for command in (_RUN, _SWEEP):
        result = expect_exit(bench.run(*command, time_limit=STUDY_TIME_LIMIT), 0)
        messages.append([x for x in result.err.splitlines() if x.startswith("warning: ")])
    expect(len(messages[0]) == 1, f"{len(messages[0])} warnings of a run")
    expect(messages[0] == messages[1], f"the warnings of a sweep are {messages[1]}")


def _hide_packages(bench: Bench, *packages: str) -> None:
    (shadow := bench.folder / "shadow").mkdir()
    for package in packages:
        (shadow / f"{package}.py").write_text("raise ImportError('it is broken')\n")
    bench.env["PYTHONPATH"] = os.pathsep.join([str(shadow), str(ROOT)])
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "empty cache")


def sweep_without_llvmlite(bench: Bench) -> None:
    """A sweep works without llvmlite, with one warning."""
    _write_model(bench)
    _hide_packages(bench, "llvmlite")
    result = bench.run(*_SWEEP, time_limit=STUDY_TIME_LIMIT)
    _expect_all_cases(bench, result)
    expect(result.err.count("warning: llvmlite") == 1, result.error_tail)


def sweep_without_ida(bench: Bench) -> None:
    """A sweep works without llvmlite and scikit-sundae, and reports it."""
    _write_model(bench)
    _hide_packages(bench, "llvmlite", "sksundae")
    result = bench.run(*_SWEEP, time_limit=STUDY_TIME_LIMIT)
    _expect_all_cases(bench, result)
    expect(result.err.count("Radau is used instead of Ida") == 1, result.error_tail)


@contextmanager
def _dask_cluster(bench: Bench, workers: int = 2) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """Start a scheduler and workers; yield the address and the processes."""
    if find_spec("distributed") is None:
        raise UnsupportedMachineError("Dask is not installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler = ("dask_scheduler", "--port", str(port), "--no-dashboard")
    worker = ("dask_worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny")
    processes = []
    try:
        for command in (scheduler, *[worker] * workers):
            module, *arguments = command
            line = [sys.executable, "-m", f"distributed.cli.{module}", *arguments]
            null = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            processes.append(bench.start(line, **null))
            if len(processes) == 1:
                wait_for(lambda: _accepts_connections(port))
        yield address, processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _accepts_connections(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def _sweep_on_cluster(bench: Bench, lost: int) -> CommandResult:
    """Return the result of a sweep on a cluster, one process of which is killed in mid-sweep."""
    _write_model(bench, "time.sleep(1.0)")
    with _dask_cluster(bench) as (address, processes):
        command = ("sweep", "model.py", *_OVER, "--scheduler", address)
        # The scheduler rejects studies until it has a worker.
        for _ in range(20):
            process = bench.start(bench.command(*command))
            wait_for(lambda process=process: process.poll() is not None or _stored(bench), 60.0)
            if process.poll() is None or _stored(bench):
                break
            process.communicate()
        processes[lost].kill()
        return bench.finish(process, STUDY_TIME_LIMIT)


def dask_worker_lost(bench: Bench) -> None:
    """If a Dask worker is killed, another one runs its cases."""
    _expect_all_cases(bench, _sweep_on_cluster(bench, lost=1))


def dask_scheduler_lost(bench: Bench) -> None:
    """If the Dask scheduler is killed, missing cases have their own status and exit code."""
    result = _sweep_on_cluster(bench, lost=0)
    expect_code(result, _NOT_RUN_CODE)
    expect("Traceback" not in result.err, result.error_tail)
    (path,) = bench.folder.glob("results/*/sweep.csv")
    table = pd.read_csv(path)
    expect(set(table["status"]) == {"ok", "not run"}, f"statuses {set(table['status'])}")
    reasons = set(table["reason"].dropna())
    expect(reasons == {"the connection to the Dask cluster was lost"}, f"reasons {reasons}")
    expect(len(path.read_text().splitlines()) == len(table) + 1, "a cell has a line break")
    _expect_all_cases(bench, bench.run(*_SWEEP, time_limit=STUDY_TIME_LIMIT))


FAULTS = (
    sweep_killed_in_a_case,
    few_open_files,
    few_processes,
    working_folder_deleted_in_a_sweep,
    two_sweeps_in_one_folder,
    full_disk_of_a_sweep,
    limit_of_file_sizes,
    sweep_without_home,
    sweep_without_llvmlite,
    sweep_without_ida,
    dask_scheduler_lost,
)
# Slow, or similar to one of the faults above.
SLOW = (
    sweep_killed_20_times,
    compare_killed_20_times,
    run_killed_20_times,
    large_sweep_killed_and_resumed,
    dask_worker_lost,
)
