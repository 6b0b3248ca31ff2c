"""One case in one process: run it within its limits and bring back what a table needs."""

from __future__ import annotations

import os
import time as clock
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cloudpickle
import pandas as pd

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    KernelWarning,
    format_exception,
    require_positive,
    set_fields,
    short_repr,
)
from beamdae.memory import limit_memory, peak_memory, reset_peak_memory
from beamdae.report.scene.frame_export import export_run_frames
from beamdae.results.outcome import REACHED_END, Status
from beamdae.results.solution import Solution
from beamdae.simulation import as_equations, simulate
from beamdae.studies.case import Case
from beamdae.studies.execution.packing import PackedParts, is_plain, pack, pack_task_around
from beamdae.studies.run_values import (
    collect_run_values,
    evaluate_outputs,
    summarize_wall_times,
    tabulate_trajectory,
)
from beamdae.studies.store.file_reads import (
    FileReads,
    are_unchanged,
    digest_reads,
    record_file_reads,
)
from beamdae.studies.store.trajectory_csv import format_trajectory


@dataclass(frozen=True)
class Limits:
    """What a case may take; None: as much as it likes.

    Attributes
    ----------
    time
        Wall time of the integration [s].
    memory
        Memory of its process [GB].
    patience
        Wall time without the simulated time advancing by a hundred-thousandth of the run [s].
    """

    time: float | None = None
    memory: float | None = None
    patience: float | None = None

    def __post_init__(self) -> None:
        for name in ("time", "memory", "patience"):
            if getattr(self, name) is not None:
                set_fields(self, **{name: require_positive("Limits", name, getattr(self, name))})


@dataclass(frozen=True)
class Task:
    """A case to be done, and the name it is kept by.

    Attributes
    ----------
    key
        `Case.fingerprint`.
    mechanism_fingerprint
        `Case.mechanism_fingerprint`, if that is known.
    name
        For files, of this task alone in its study.
    outputs
        Functions of its solution that are told of, by name.
    """

    key: str
    case: Case
    t_end: float
    output_step: float
    limits: Limits = Limits()
    repetitions: int = 1
    animated: bool = False
    mechanism_fingerprint: str = ""
    name: str = ""
    outputs: Mapping[str, Callable[[Solution], Any]] = field(default_factory=dict)

    def packed(self, known: PackedParts) -> bytes:
        """The task for another process, the source of its model included; models once."""
        case = self.case
        # What else a user defines may refer to what the model does, and has to go along with it.
        own = type(case.integrator).__module__.startswith("beamdae.")
        values = (*case.parameters.values(), *vars(case.integrator).values())
        apart = own and not self.outputs and all(map(is_plain, values))
        return pack_task_around(self, case.model, known) if apart else pack(self)


@dataclass(frozen=True)
class Outcome:
    """What became of a case.

    Attributes
    ----------
    status
        How it ended.
    values
        Cost and quality by column of the case table.
    rows
        Its table, or what reads it from where it is kept.
    frames
        Shapes of the bodies over time, for an animation; None if none was asked for.
    read
        Hashes of files that were read, by name; see `beamdae.studies.store.file_reads`.
    file
        Name of the file its table is kept in, if it is.
    text
        Its table as that file has it, until it is kept: made where the case was run.
    """

    status: Status = REACHED_END
    values: dict[str, Any] = field(default_factory=dict)
    rows: pd.DataFrame | Callable[[], pd.DataFrame] | None = field(default=None, repr=False)
    frames: dict[str, Any] | None = None
    read: dict[str, str | None] = field(default_factory=dict)
    file: str = ""
    text: bytes = field(default=b"", repr=False)

    @property
    def table(self) -> pd.DataFrame | None:
        """Observed columns, energies and drift by time; None if there was no consistent start."""
        return self.rows() if callable(self.rows) else self.rows

    @classmethod
    def failed(cls, sentence: str) -> Outcome:
        """One without anything to show."""
        return cls(Status("failed", sentence))


NOT_RUN = Outcome(Status("interrupted", "not run, the study was interrupted"))


def run_task(packed: bytes) -> Outcome:
    """Do a packed task; a mistake in the model is a sentence, not an exception.

    The outcome has the files that were read, and where the process is stays as it was.
    """
    folder = os.getcwd()
    try:
        with record_file_reads() as reads:
            outcome = _run_guarded(packed, reads)
    finally:
        with suppress(OSError):
            os.chdir(folder)
    return outcome


def _run_guarded(packed: bytes, reads: FileReads) -> Outcome:
    home = Path.cwd()
    try:
        task = cloudpickle.loads(packed)
        home = task.case.model.home
        outcome = _run_case(task, reads)
    except KeyboardInterrupt:
        raise
    except BeamdaeError as problem:
        outcome = Outcome.failed(str(problem))
    except MemoryError:
        outcome = Outcome.failed("it needs more memory than there is, or than it may take")
    except BaseException as problem:  # Whatever a model raises is the end of its case alone.
        outcome = Outcome.failed(describe_exception(problem))
    return replace(outcome, read=digest_reads(reads, home))


def describe_exception(problem: BaseException, whose: str = "the model") -> str:
    """What an exception of a user's function says, in words."""
    if isinstance(problem, SystemExit):
        return (
            f"{whose} called sys.exit({'' if problem.code is None else short_repr(problem.code)})"
        )
    return format_exception(problem)


def _run_case(task: Task, reads: FileReads) -> Outcome:
    begin = clock.perf_counter()
    reset_peak_memory()
    with limit_memory(task.limits.memory), warnings.catch_warnings(record=True) as seen:
        # They are a column of the table.
        warnings.simplefilter("ignore", BeamdaeWarning)
        # Neighboring cases differ in the integrator alone: their equations are built once.
        built = _build_equations(task)
        reads |= built.reads
        integrator = task.case.integrator
        solutions = []
        for _ in range(task.repetitions):
            watch = _LimitMonitor(task.limits, task.t_end)
            solutions.append(
                simulate(built.equations, integrator, task.t_end, task.output_step, watch)
            )
            if not solutions[-1].status.success:
                break
        solution = solutions[-1]
        times = [s.statistics.wall_time for s in solutions]
        found = collect_run_values(solution) | summarize_wall_times(times)
        status = solution.status
        if status.success:
            try:
                found |= evaluate_outputs(task.outputs, solution)
            except BeamdaeError as problem:
                status = Status("failed", str(problem))
        table = tabulate_trajectory(solution)
        text = format_trajectory(table)
        frames = export_run_frames(solution) if task.animated else None
    spent = sum(times) + sum(s.statistics.setup_time for s in solutions)
    found["measuring time [s]"] = clock.perf_counter() - begin - spent
    found["peak memory [GB]"] = peak_memory()
    kernels = [str(x.message) for x in seen if issubclass(x.category, KernelWarning)]
    found["warnings"] = " ".join([found["warnings"], *kernels]).strip()
    return Outcome(status, found, table, frames, text=text)


@dataclass(frozen=True)
class _EquationsKey:
    """What equations of motion are built from, known by its hash."""

    key: str
    case: Case = field(compare=False)


@dataclass(frozen=True)
class _BuiltEquations:
    """Equations of motion, and the files that were read to build them."""

    equations: EquationsOfMotion
    reads: FileReads


def _build_equations(task: Task) -> _BuiltEquations:
    recipe = _EquationsKey(
        task.mechanism_fingerprint or task.case.mechanism_fingerprint(), task.case
    )
    built = _equations(recipe)
    if not are_unchanged(built.reads):
        _equations.cache_clear()
        built = _equations(recipe)
    return built


@lru_cache(maxsize=1)
def _equations(recipe: _EquationsKey) -> _BuiltEquations:
    with record_file_reads() as reads:
        equations = as_equations("study", recipe.case.model(**recipe.case.parameters))
    return _BuiltEquations(equations, reads)


class _LimitMonitor:
    """Ends a run that takes more time or memory, or makes less progress, than it may."""

    def __init__(self, limits: Limits, t_end: float) -> None:
        self._limits = limits
        self._least = 1e-5 * t_end
        self._reached = 0.0
        self._begin = self._since = clock.perf_counter()

    def __call__(self, t: float) -> str | None:
        """The reason to stop at time t, if there is one."""
        now = clock.perf_counter()
        if t - self._reached >= self._least:
            self._reached, self._since = t, now
        limit, patience, memory = self._limits.time, self._limits.patience, self._limits.memory
        if limit is not None and now - self._begin > limit:
            return f"time limit of {limit:g} s"
        if patience is not None and now - self._since > patience:
            return f"no progress for {patience:g} s"
        if memory is not None and peak_memory() > memory:
            return f"memory limit of {memory:g} GB"
        return None
