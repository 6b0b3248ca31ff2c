"""Processes that run one thing after the other when told to, so that others can be timed between.

They read a run a line, the keyword arguments of their function as JSON, and answer in one line.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

HERE = Path(__file__).parent
NO_PEER = "Exudyn cannot be imported by {python} (pip install exudyn): runs beside it are skipped."


class Worker:
    """A script beside this one in a process of its own."""

    def __init__(self, python: str, script: str, environment: Mapping[str, str] | None = None):
        self._process = subprocess.Popen(
            [python, str(HERE / script)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **(environment or {})},
        )

    def __call__(self, **run: Any) -> dict[str, Any]:
        """What the script answers."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(run), file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError(f"the process of {self._process.args} ended at {run}")
        return json.loads(answer)

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        problem: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.communicate()


def exudyn(python: str) -> Worker | None:
    """Exudyn in the interpreter named, or None and a sentence where it is not installed."""
    command = [python, "-c", "import exudyn"]
    try:
        subprocess.run(command, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        print(NO_PEER.format(python=python), file=sys.stderr)
        return None
    return Worker(python, "exudyn_peer.py")


def checkout(folder: Path) -> Worker:
    """The beamdae of a checkout, with its models, in this interpreter."""
    paths = os.pathsep.join((str(folder), str(folder / "models")))
    return Worker(sys.executable, "checkout_worker.py", {"PYTHONPATH": paths})
