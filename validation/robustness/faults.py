"""Faults of the machine: killed processes, limits of users, full disks, missing folders.

`FAULTS` lists them; the docstring of a fault states the right behavior. Closed streams,
signals, locales, damaged records and caches, changed sources and lost clusters have tests
(`tests/cli`, `tests/studies`, `tests/native`).
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from robustness.inputs.command_line import add_line
from robustness.isolation import ScratchFolder
from robustness.judge import find_complaint, outcome_of_command

_MAX_TAIL_LENGTH = 200  # characters of standard error in a complaint
_MAX_OUTPUT_TAIL_LENGTH = 100  # characters of standard output in a complaint
ROOT = Path(__file__).parents[2]

MODEL = """import numpy as np

import beamdae as bd

LENGTH = 1.0


@bd.model(t_end=0.02)
def arm(length=LENGTH, elements=1, label="tip"):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    alloy = bd.Material(E=7e10, nu=0.3, rho=2700.0)
    strip = bd.Section.rectangle(alloy, width=0.02, height=0.005)
    line = bd.Line((0.0, 0.0), (length, 0.0))
    beam = mech.add(bd.Beam("beam", line, strip, elements=elements))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe(label, beam.end)
    # more
    return mech
"""


class WrongBehaviorError(Exception):
    """The outcome of a command is not right; the text is the complaint."""


class UnsupportedMachineError(Exception):
    """The fault cannot be set up on this machine; the text is the reason."""


def expect(condition: bool, complaint: str) -> None:
    """Raise the complaint unless the condition is true."""
    if not condition:
        raise WrongBehaviorError(complaint)


@dataclass(frozen=True)
class CommandResult:
    """Exit code, output and wall time [s] of a command."""

    code: int
    out: str
    err: str
    seconds: float

    @property
    def error_tail(self) -> str:
        """End of standard error, in one line."""
        return " ".join(self.err.split())[-_MAX_TAIL_LENGTH:]


@dataclass
class Bench:
    """Folder with a model file, and the environment of the commands that run in it."""

    folder: Path
    env: dict[str, str] = field(default_factory=lambda: dict(os.environ))

    def __post_init__(self) -> None:
        self.env |= {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        self.write("model.py", MODEL)

    def write(self, name: str, text: str) -> Path:
        """Write a file into the folder and return its path."""
        path = self.folder / name
        path.write_text(text)
        return path

    def command(self, *arguments: str) -> list[str]:
        """Return a command line of beamdae."""
        return [sys.executable, "-m", "beamdae", *arguments]

    def start(self, command: list[str], **options: Any) -> subprocess.Popen[str]:
        """Start a command in a new process group."""
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL}
        return subprocess.Popen(
            command,
            cwd=self.folder,
            env=self.env,
            text=True,
            errors="replace",
            start_new_session=True,
            **pipes | options,
        )

    def finish(self, process: subprocess.Popen[str], time_limit: float = 60.0) -> CommandResult:
        """Return the result of a process; kill its process group after the time limit [s]."""
        begin = time.perf_counter()
        try:
            out, err = process.communicate(timeout=time_limit)
        except subprocess.TimeoutExpired:
            raise WrongBehaviorError(f"no end within {time_limit:g} s") from None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        return CommandResult(process.returncode, out or "", err or "", time.perf_counter() - begin)

    def run(self, *arguments: str, time_limit: float = 60.0, **options: Any) -> CommandResult:
        """Run a command of beamdae."""
        return self.finish(self.start(self.command(*arguments), **options), time_limit)

    def run_in_shell(self, line: str, time_limit: float = 60.0, **options: Any) -> CommandResult:
        """Run a line of bash, in which BEAMDAE stands for the command."""
        words = " ".join(self.command()).replace("\\", "/")
        return self.finish(
            self.start(["bash", "-c", line.replace("BEAMDAE", words)], **options), time_limit
        )

    @property
    def table_text(self) -> str:
        """Text of the table that the model's run wrote."""
        path = self.folder / "results" / "arm.csv"
        expect(path.is_file(), "no table was written")
        return path.read_text()


def expect_code(result: CommandResult, *codes: int) -> None:
    """Check the exit code."""
    tail = result.error_tail or result.out[-_MAX_OUTPUT_TAIL_LENGTH:]
    expect(result.code in codes, f"exit code {result.code}, {tail!r}")


def expect_exit(result: CommandResult, *codes: int) -> CommandResult:
    """Return the result after checking its exit code and its messages."""
    expect_code(result, *codes)
    # Standard output is not judged: a fault may occur after tables have been printed.
    complaint = find_complaint(outcome_of_command(result.code, "", result.err))
    expect(not complaint, f"{complaint}: {result.error_tail}")
    return result


def expect_no_traceback(result: CommandResult) -> CommandResult:
    """Return the result after checking that it shows no traceback of beamdae.

    An interrupt may also hit the start of Python, whose traceback does not mention beamdae.
    """
    output = result.out + result.err
    if "beamdae" in output:
        for text in ("Traceback (most recent", "Exception ignored", "Segmentation fault"):
            expect(text not in output, f"{text}: {result.error_tail}")
    return result


def drop_privileges(command: list[str]) -> list[str]:
    """Return the command without the capabilities of root, so that file permissions apply."""
    if os.geteuid() != 0:
        return command
    if shutil.which("setpriv") is None:
        raise UnsupportedMachineError("root without setpriv, which drops its capabilities")
    return ["setpriv", "--bounding-set=-all", "--inh-caps=-all", *command]


@contextmanager
def mount_small_disk(folder: Path, kilobytes: int) -> Iterator[None]:
    """Mount a file system of this size on the folder."""
    folder.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "none", str(folder)]
    try:
        subprocess.run(mount, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        raise UnsupportedMachineError("not permitted to mount a file system") from None
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=False)


STUDY_TIME_LIMIT = 100.0  # s
_SWEEP = ("sweep", "model.py", "--over", "mass=1:6:6", "--jobs", "2")
_RUN = ("run", "model.py", "--no-estimate")
_KILLS = 5
_ORPHAN_TIME_LIMIT = 10.0  # s; a worker that imports modules notices the end of its parent late
_PROCESSES = {4: 1, 8: 1, 48: 0}  # number of warnings by the limit
_USER = 12345  # user and group id without any other process
# Statements that compute for a while without waiting.
_BUSY_BODY = "import time; end = time.monotonic() + 0.3\n    while time.monotonic() < end: pass"
_TABLE_LINES = 1002  # of a complete run: header and 1001 rows


def _write_model(bench: Bench, body: str = "pass") -> None:
    bench.write("model.py", add_line(body))
    bench.env["ROBUSTNESS"] = bench.folder.name


def _find_processes(bench: Bench) -> list[int]:
    """Return the processes of the bench, in any process group."""
    mark = f"ROBUSTNESS={bench.folder.name}".encode()
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if mark in path.read_bytes().split(b"\0"):
                found.append(int(path.parent.name))
    return found


def _kill(bench: Bench, command: tuple[str, ...], seconds: float) -> None:
    """Kill a command after so many seconds, and check that no process continues."""
    process = bench.start(bench.command(*command))
    with suppress(subprocess.TimeoutExpired):
        process.wait(seconds)
    process.kill()
    process.wait()
    # Its pipes are closed without waiting, because orphans would keep them open.
    for stream in (process.stdout, process.stderr):
        stream.close()
    end = time.perf_counter() + _ORPHAN_TIME_LIMIT
    while (orphans := _find_processes(bench)) and time.perf_counter() < end:
        time.sleep(0.05)
    for orphan in orphans:
        with suppress(ProcessLookupError):
            os.kill(orphan, signal.SIGKILL)
    expect(not orphans, f"{len(orphans)} processes continue without their command")
    scratch = list(bench.folder.glob("results/*/cases.csv"))
    expect(all(path.read_text().endswith("\n") for path in scratch), "half a table remains")


def _kill_often(bench: Bench, command: tuple[str, ...]) -> None:
    """Kill a command at instants over its whole duration, then check that it completes."""
    if not Path("/proc/self/environ").exists():
        raise UnsupportedMachineError("no /proc to find processes in")
    _write_model(bench, _BUSY_BODY)
    complete = expect_exit(bench.run(*command, time_limit=STUDY_TIME_LIMIT), 0)
    shutil.rmtree(bench.folder / "results")
    for k in range(_KILLS):
        _kill(bench, command, complete.seconds * (k + 0.5) / _KILLS)
        if k == _KILLS // 2:
            # Otherwise later commands would find all their cases stored.
            shutil.rmtree(bench.folder / "results", ignore_errors=True)
    expect_exit(bench.run(*command, time_limit=STUDY_TIME_LIMIT), 0)
    for path in bench.folder.glob("results/*/cases.csv"):
        expect((pd.read_csv(path)["status"] == "ok").all(), "not all cases ended")
    leftover = [x.name for x in bench.folder.rglob("*.scratch*")]
    expect(not leftover, f"files of killed processes remain: {leftover[:3]}")


def killed_sweep(bench: Bench) -> None:
    """SIGKILL of a sweep leaves no process and no damaged file, and a restart completes it."""
    _kill_often(bench, _SWEEP)


def killed_run(bench: Bench) -> None:
    """SIGKILL of a run leaves no process and no damaged file, and a restart completes it."""
    _kill_often(bench, _RUN)


def _expect_all_cases(bench: Bench, result: CommandResult) -> None:
    # Standard error is not judged: without threads, memory allocators print messages, too.
    expect_code(expect_no_traceback(result), 0)
    (path,) = bench.folder.glob("results/*/sweep.csv")
    table = pd.read_csv(path)
    expect(len(table) == 6, f"{len(table)} of 6 rows")
    expect((table["status"] == "ok").all(), "not all cases ended")


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


def read_only_results_folder(bench: Bench) -> None:
    """A read-only folder is a usage error, reported before the run."""
    locked = bench.folder / "locked"
    locked.mkdir()
    locked.chmod(0o555)
    command = bench.command("run", "model.py", "--out", "locked")
    expect_exit(bench.finish(bench.start(drop_privileges(command))), 2)


def table_is_a_folder(bench: Bench) -> None:
    """A folder with the name of the table is reported."""
    (bench.folder / "results" / "arm.csv").mkdir(parents=True)
    expect_exit(bench.run(*_RUN), 1, 2)


def picture_is_a_folder(bench: Bench) -> None:
    """A folder with the name of the picture is reported, and the table is kept."""
    (bench.folder / "results" / "arm.png").mkdir(parents=True)
    result = expect_exit(bench.run(*_RUN), 1, 2)
    expect(result.code == 2 or bool(bench.table_text), "no table was written")


def full_disk(bench: Bench) -> None:
    """A full disk is reported, and no truncated table remains."""
    with mount_small_disk(bench.folder / "disk", 16):
        expect_exit(bench.run("run", "model.py", "--quiet", "--out", "disk"), 1, 2)
        table = bench.folder / "disk" / "arm.csv"
        whole = not table.exists() or table.read_text().endswith("\n")
        expect(whole, "half a table stays under its name")


def names_that_lead_out_of_the_folder(bench: Bench) -> None:
    """Parameter values cannot place files outside the results folder."""
    more = ("--set", "label=../../../escaped", "--workers", "2")
    expect_exit(bench.run("compare", "model.py", *more, time_limit=STUDY_TIME_LIMIT), 0, 1)
    expect(not list(bench.folder.parent.glob("*escaped*")), "files were written elsewhere")
    names = sorted(path.name for path in bench.folder.glob("*"))
    expect(names == ["model.py", "results"], f"files beside: {names}")


def _run_in_memory(
    bench: Bench, arguments: str, gigabytes: float, time_limit: float = 60.0
) -> CommandResult:
    kilobytes = int(gigabytes * 1e6)
    return bench.run_in_shell(f"ulimit -v {kilobytes}; BEAMDAE {arguments}", time_limit=time_limit)


def memory_limit_in_the_model(bench: Bench) -> None:
    """A model that allocates more memory than available is reported."""
    bench.write("model.py", MODEL.replace("# more", "np.ones(10**10)"))
    expect_exit(_run_in_memory(bench, "run model.py", 4.0), 1, 2)


def memory_limit_in_the_run(bench: Bench) -> None:
    """Rows that do not fit in memory are reported."""
    more = "--integrator generalized-alpha --step 1e-8 --output-step 2e-9 --t-end 0.02"
    expect_exit(
        _run_in_memory(bench, f"run model.py {more} --no-estimate --time-limit 20", 2.0), 0, 1, 2
    )


def ten_million_elements(bench: Bench) -> None:
    """A mesh that is too large is reported within a minute."""
    result = _run_in_memory(
        bench, "run model.py --set elements=10000000 --no-estimate", 4.0, time_limit=60.0
    )
    expect_exit(result, 1, 2)


def ten_thousand_elements(bench: Bench) -> None:
    """Ida on 10 000 elements in 4 GB ends with a result or a message."""
    more = "--set elements=10000 --integrator ida --no-estimate --t-end 1e-4 --time-limit 60"
    expect_exit(_run_in_memory(bench, f"run model.py {more}", 4.0, time_limit=240.0), 0, 1, 2)


def time_limit_of_a_build(bench: Bench) -> None:
    """--time-limit also applies to a run whose equations alone take longer to build."""
    arguments = ("run", "model.py", "--set", "elements=200000", "--time-limit", "2")
    expect_exit(bench.run(*arguments, time_limit=60.0), 1, 2)


def nonexistent_tmpdir(bench: Bench) -> None:
    """A run works with a TMPDIR that does not exist."""
    bench.env |= {"TMPDIR": "/proc/nowhere"}
    expect_exit(bench.run(*_RUN), 0)


def working_folder_deleted(bench: Bench) -> None:
    """A deleted working folder is reported."""
    line = f"mkdir gone; cd gone; rmdir ../gone; BEAMDAE run {bench.folder}/model.py --no-estimate"
    expect_exit(bench.run_in_shell(line), 1, 2)


def results_folder_deleted(bench: Bench) -> None:
    """A results folder that is deleted during the run is created again."""
    # Runs for many seconds unless it is stopped; longer runs would count as stalled.
    bench.write("model.py", MODEL.replace("t_end=0.02", "t_end=100.0"))
    (bench.folder / "results").mkdir()
    settings = ("--integrator", "ida", "--t-end", "20", "--no-estimate")
    process = bench.start(bench.command("run", "model.py", "--output-step", "1", *settings))
    # The rows are written at the end of the run, long after the deletion.
    time.sleep(2.0)
    shutil.rmtree(bench.folder / "results")
    expect_exit(bench.finish(process), 0)


def two_runs_in_one_folder(bench: Bench) -> None:
    """Two runs into one folder leave complete files."""
    command = bench.command(*_RUN)
    processes = [bench.start(command) for _ in range(2)]
    for result in [bench.finish(process) for process in processes]:
        expect_exit(result, 0)
    json.loads((bench.folder / "results" / "arm.json").read_text())
    expect(bench.table_text.count("\n") == _TABLE_LINES, "the table is incomplete")


FAULTS = {
    fault.__name__.replace("_", " "): fault
    for fault in (
        killed_sweep,
        killed_run,
        few_processes,
        full_disk_of_a_sweep,
        limit_of_file_sizes,
        sweep_without_home,
        read_only_results_folder,
        table_is_a_folder,
        picture_is_a_folder,
        full_disk,
        names_that_lead_out_of_the_folder,
        memory_limit_in_the_model,
        memory_limit_in_the_run,
        ten_million_elements,
        ten_thousand_elements,
        time_limit_of_a_build,
        nonexistent_tmpdir,
        working_folder_deleted,
        results_folder_deleted,
        two_runs_in_one_folder,
    )
}


def list_names() -> list[str]:
    """Return the names of all faults."""
    return list(FAULTS)


def try_name(name: str) -> list[str | None]:
    """Set up the fault and return the complaint; None if this machine does not permit it."""
    # A process started in the background ignores interrupts, and so would the commands it starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with ScratchFolder() as scratch:
        try:
            FAULTS[name](Bench(scratch.folder))
        except UnsupportedMachineError:
            return [None]
        except WrongBehaviorError as error:
            return [str(error)]
    return [""]
