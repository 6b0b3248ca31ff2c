"""Worker processes that run one job at a time, so that other tools can be timed in between.

A worker reads one job per line, as a JSON object of keyword arguments, and answers each job with
one line of JSON.
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
EXUDYN_MISSING = (
    "{python}: exudyn cannot be imported, so its runs are skipped; run pip install exudyn."
)


class Worker:
    """Process that runs a script of this folder."""

    def __init__(self, python: str, script: str, environment: Mapping[str, str] | None = None):
        self._process = subprocess.Popen(
            [python, str(HERE / script)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **(environment or {})},
        )

    def __call__(self, **run: Any) -> dict[str, Any]:
        """Return the answer of the script to a job."""
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


def has_exudyn(python: str) -> bool:
    """Return True if Exudyn is installed in this interpreter; otherwise, print a message."""
    command = [python, "-c", "import exudyn"]
    try:
        subprocess.run(command, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        print(EXUDYN_MISSING.format(python=python), file=sys.stderr)
        return False
    return True


def start_exudyn(python: str, script: str = "exudyn_peer.py") -> Worker | None:
    """Start Exudyn in this interpreter; return None, with a message, if it is not installed."""
    return Worker(python, script) if has_exudyn(python) else None


def start_checkout(folder: Path) -> Worker:
    """Start this interpreter with the beamdae and the models of a checkout."""
    paths = os.pathsep.join((str(folder), str(folder / "models")))
    return Worker(sys.executable, "checkout_worker.py", {"PYTHONPATH": paths})
