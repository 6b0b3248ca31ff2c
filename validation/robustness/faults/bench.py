"""Test bench of a fault: a folder with a model, real commands, and checks of their outcomes."""

from __future__ import annotations

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

from robustness.judge import find_complaint, outcome_of_command

_MAX_TAIL_LENGTH = 200  # characters of standard error in a complaint
_MAX_OUTPUT_TAIL_LENGTH = 100  # characters of standard output in a complaint
ROOT = Path(__file__).parents[3]

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
# Runs for many seconds unless it is stopped; longer runs would count as stalled.
LONG_MODEL = MODEL.replace("t_end=0.02", "t_end=100.0")


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

    def run_model(self, *more: str, time_limit: float = 60.0, **options: Any) -> CommandResult:
        """Run the model, which has to succeed."""
        command = ("run", "model.py", "--no-estimate", *more)
        return expect_exit(self.run(*command, time_limit=time_limit, **options), 0)

    @property
    def table_text(self) -> str:
        """Text of the table that the model's run wrote."""
        path = self.folder / "results" / "arm.csv"
        expect(path.is_file(), "no table was written")
        return path.read_text()

    def list_files(self, pattern: str) -> list[str]:
        """Return names of the files that match the pattern."""
        return sorted(path.name for path in self.folder.glob(pattern))


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
