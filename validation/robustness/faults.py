"""All faults, and what is seen of each."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass

from robustness import (
    faults_cache,
    faults_dying,
    faults_output,
    faults_runs,
    faults_stale,
    faults_studies,
)
from robustness.bench import Bench, NotPossibleError, NotRightError
from robustness.workers import Scratch

THEMES = {
    "cache": faults_cache,
    "dying": faults_dying,
    "output": faults_output,
    "runs": faults_runs,
    "stale": faults_stale,
    "studies": faults_studies,
}
# A fault may take so long [s].
LIMIT = 600.0


@dataclass(frozen=True)
class Line:
    """What became of a fault."""

    fault: str
    right: str
    ended: str
    complaint: str = ""
    wall: float = 0.0


def all_faults(slow: bool = True) -> dict[str, Callable[[Bench], None]]:
    """Every fault by theme and name; the docstring of each says what is right."""
    return {
        f"{theme}: {fault.__name__.replace('_', ' ')}": fault
        for theme, module in THEMES.items()
        for fault in (*module.FAULTS, *(module.SLOW if slow else ()))
    }


def see_fault(name: str) -> Line:
    """Set a fault up and tell whether what comes of it is right."""
    # Where this was started in the background interrupts are ignored, also by what it starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    fault, begin = all_faults()[name], time.perf_counter()
    ended, complaint = "right", ""
    with Scratch() as scratch:
        try:
            fault(Bench(scratch.folder))
        except NotPossibleError as reason:
            ended = f"skipped: {reason}"
        except NotRightError as problem:
            ended, complaint = "not right", str(problem)
        except Exception as problem:  # Something else is missing than was looked for.
            ended, complaint = "not right", f"{type(problem).__name__}: {problem}"
    right = " ".join((fault.__doc__ or "").split())
    return Line(name, right, ended, complaint, round(time.perf_counter() - begin, 1))
