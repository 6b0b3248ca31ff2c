"""Catalog of all faults, and the trial of a single fault."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from robustness.faults import machine
from robustness.faults.bench import Bench, UnsupportedMachineError, WrongBehaviorError
from robustness.isolation import ScratchFolder
from robustness.trial_class import TrialClass, draw_sample

FAULT_TIME_LIMIT = 600.0  # s
QUICK_FAULT_COUNT = 6


@dataclass(frozen=True)
class FaultRow:
    """Row of the table of faults: the expected behavior, and the complaint if it was violated."""

    fault: str
    right: str
    ended: str
    complaint: str = ""
    wall: float = 0.0


def collect_faults(slow: bool = True) -> dict[str, Callable[[Bench], None]]:
    """Return every fault by name; its docstring states the right behavior."""
    faults = (*machine.FAULTS, *(machine.SLOW if slow else ()))
    return {fault.__name__.replace("_", " "): fault for fault in faults}


def try_fault(name: str) -> FaultRow:
    """Set up the fault and return its row: right, not right, or skipped on this machine."""
    # A process started in the background ignores interrupts, and so would the commands it starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    fault, begin = collect_faults()[name], time.perf_counter()
    ended, complaint = "right", ""
    with ScratchFolder() as scratch:
        try:
            fault(Bench(scratch.folder))
        except UnsupportedMachineError as reason:
            ended = f"skipped: {reason}"
        except WrongBehaviorError as error:
            ended, complaint = "not right", str(error)
        except Exception as error:  # An expected file is missing, for example.
            ended, complaint = "not right", f"{type(error).__name__}: {error}"
    right = " ".join((fault.__doc__ or "").split())
    return FaultRow(name, right, ended, complaint, round(time.perf_counter() - begin, 1))


def _draw_faults(names: Sequence[str], size: int, seed: int) -> list[str]:
    """Return a sample without the slow faults."""
    return draw_sample([name for name in names if name in collect_faults(slow=False)], size, seed)


TRIALS = TrialClass(
    "faults",
    collect=lambda: list(collect_faults()),
    attempt=try_fault,
    time_limit=FAULT_TIME_LIMIT,
    quick_size=QUICK_FAULT_COUNT,
    draw=_draw_faults,
)
