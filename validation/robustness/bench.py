"""Where a fault is set up: a folder of its own, real commands, and what is expected of them."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from robustness.judge import command_seen, complaint

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
# Runs for minutes unless something stops it.
LONG = MODEL.replace("t_end=0.02", "t_end=2000.0")


class NotRightError(Exception):
    """What was seen and is not right."""


class NotPossibleError(Exception):
    """Why a fault cannot be set up on this machine."""


def expect(right: bool, otherwise: str) -> None:
    """Go on if that is right."""
    if not right:
        raise NotRightError(otherwise)


@dataclass(frozen=True)
class Ran:
    """What a command did."""

    code: int
    out: str
    err: str
    seconds: float

    @property
    def last(self) -> str:
        """The end of standard error in one line."""
        return " ".join(self.err.split())[-200:]


@dataclass
class Bench:
    """A folder with a model file, and an environment with a cache of the folder's own."""

    folder: Path
    env: dict[str, str] = field(default_factory=lambda: dict(os.environ))

    def __post_init__(self) -> None:
        self.env |= {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        self.write("model.py", MODEL)

    def write(self, name: str, text: str) -> Path:
        """A file in the folder."""
        path = self.folder / name
        path.write_text(text)
        return path

    def command(self, *arguments: str) -> list[str]:
        """A command line of beamdae."""
        return [sys.executable, "-m", "beamdae", *arguments]

    def start(self, command: list[str], **more: Any) -> subprocess.Popen[str]:
        """A command under way, in a process group of its own."""
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL}
        return subprocess.Popen(
            command,
            cwd=self.folder,
            env=self.env,
            text=True,
            errors="replace",
            start_new_session=True,
            **pipes | more,
        )

    def finish(self, process: subprocess.Popen[str], limit: float = 60.0) -> Ran:
        """What it did; one that does not end in time is killed with all it started."""
        begin = time.perf_counter()
        try:
            out, err = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            raise NotRightError(f"no end within {limit:g} s") from None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        return Ran(process.returncode, out or "", err or "", time.perf_counter() - begin)

    def run(self, *arguments: str, limit: float = 60.0, **more: Any) -> Ran:
        """A command of beamdae, to its end."""
        return self.finish(self.start(self.command(*arguments), **more), limit)

    def shell(self, line: str, limit: float = 60.0, **more: Any) -> Ran:
        """A line of the shell; BEAMDAE in it is the command."""
        words = " ".join(self.command()).replace("\\", "/")
        return self.finish(
            self.start(["bash", "-c", line.replace("BEAMDAE", words)], **more), limit
        )

    def simulated(self, *more: str, limit: float = 60.0, **options: Any) -> Ran:
        """The model's run, which has to succeed."""
        ran = self.run("run", "model.py", "--no-estimate", *more, limit=limit, **options)
        return told(ran, 0)

    @property
    def rows(self) -> str:
        """The table of the model's run."""
        path = self.folder / "results" / "arm.csv"
        expect(path.is_file(), "no table was written")
        return path.read_text()

    def left(self, pattern: str) -> list[str]:
        """Names of the files there are."""
        return sorted(path.name for path in self.folder.glob(pattern))


@cache
def _made(prepare: Callable[[Bench], None]) -> tempfile.TemporaryDirectory[str]:
    folder = tempfile.TemporaryDirectory(prefix="robustness-prepared-")
    prepare(Bench(Path(folder.name)))
    return folder


def prepared(bench: Bench, prepare: Callable[[Bench], None]) -> None:
    """What `prepare` makes in a folder, made once a process, in the folder of the bench."""
    shutil.copytree(_made(prepare).name, bench.folder, dirs_exist_ok=True)


def told(ran: Ran, *codes: int) -> Ran:
    """The command ended with one of these exit codes and told nothing but sentences."""
    expect(ran.code in codes, f"exit code {ran.code}, {ran.last or ran.out[-100:]!r}")
    # A fault may come when the tables have been printed.
    why = complaint(command_seen(ran.code, "", ran.err))
    expect(not why, f"{why}: {ran.last}")
    return ran


def no_traceback(ran: Ran) -> Ran:
    """Whatever the exit code is, no traceback is shown; one of Python's own start is its own."""
    everything = ran.out + ran.err
    if "beamdae" in everything:
        for text in ("Traceback (most recent", "Exception ignored", "Segmentation fault"):
            expect(text not in everything, f"{text}: {ran.last}")
    return ran


def unprivileged(bench: Bench, command: list[str]) -> list[str]:
    """The command such that permissions of files count for it, also for root."""
    if os.geteuid() != 0:
        return command
    if shutil.which("setpriv") is None:
        raise NotPossibleError("root, and no setpriv to give up what root may do")
    return ["setpriv", "--bounding-set=-all", "--inh-caps=-all", *command]


@contextmanager
def small_disk(folder: Path, kilobytes: int) -> Iterator[None]:
    """A file system of so many kilobytes mounted on the folder."""
    folder.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "none", str(folder)]
    try:
        subprocess.run(mount, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        raise NotPossibleError("no right to mount a small file system") from None
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=False)


def wait_for(condition: Callable[[], Any], limit: float = 30.0) -> None:
    """Until that is so."""
    end = time.perf_counter() + limit
    while not condition():
        expect(time.perf_counter() < end, "what was waited for did not come")
        time.sleep(0.02)
