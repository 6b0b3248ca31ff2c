"""Run of one case in the current process, within its time limit, and the recorded values."""

from __future__ import annotations

import json
import os
import pickle
import time as clock
import warnings
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, BeamdaeWarning, KernelWarning, working_folder
from beamdae.report.page.content import encode
from beamdae.report.scene.run_scene import export_run_frames
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution
from beamdae.results.storage.files import is_in_deleted_folder
from beamdae.simulation import as_equations, simulate, unchecked
from beamdae.studies.file_reads import (
    FileReads,
    are_unchanged,
    digest_reads,
    record_file_reads,
)
from beamdae.studies.run_values import (
    MEASURING_TIME_COLUMN,
    WALL_TIME_COLUMN,
    collect_rows,
    collect_run_values,
    evaluate_outputs,
    measure_rows,
    measured_errors,
    summarize_wall_times,
)
from beamdae.studies.store import format_trajectory
from beamdae.studies.tasks import MEASURED, Outcome, Task, describe_exception


def run_task(serialized: bytes) -> Outcome:
    """Run a serialized task; exceptions other than KeyboardInterrupt become failed outcomes.

    The outcome lists the files that were read. The working directory is restored afterwards if it
    still exists.
    """
    folder = working_folder()
    is_deleted = is_in_deleted_folder(Path())
    try:
        with record_file_reads() as reads:
            home = folder
            try:
                task = pickle.loads(serialized)
                home = task.case.model.home
                outcome = _measure_case(task) if task.is_measured else _run_case(task, reads)
            except KeyboardInterrupt:
                raise
            except BeamdaeError as problem:
                outcome = Outcome.failed(str(problem))
            except MemoryError:
                outcome = Outcome.failed("out of memory: the run exceeds the memory of the machine")
            except BaseException as problem:  # An exception of a model ends only its case.
                outcome = Outcome.failed(describe_exception(problem))
        # The reads of modules are included when the block ends.
        outcome = replace(outcome, read=digest_reads(reads, home))
    finally:
        if not is_deleted:
            with suppress(OSError):
                os.chdir(folder)
    return outcome


def _measure_case(task: Task) -> Outcome:
    """Evaluate functions of the model of a task, without a run."""
    begin = clock.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", BeamdaeWarning)
        values = evaluate_outputs(task.outputs, task.case.configured())
    values[WALL_TIME_COLUMN] = clock.perf_counter() - begin
    if sentences := _list_messages(caught, BeamdaeWarning):
        values["warnings"] = "\n".join(sentences)
    return Outcome(MEASURED, values, kernel_warnings=_list_messages(caught, KernelWarning))


def _run_case(task: Task, reads: FileReads) -> Outcome:
    begin = clock.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        # Not printed, because the case table contains the warnings of the run.
        warnings.simplefilter("ignore", BeamdaeWarning)
        equations, files = _build_equations(task)
        reads |= files
        costs, limit = [], task.time_limit

        def find_exceeded_limit(t: float) -> str | None:
            is_exceeded = limit is not None and clock.perf_counter() - run_begin > limit
            return f"reached the time limit of {limit:g} s" if is_exceeded else None

        for _ in range(task.repetitions):
            run_begin = clock.perf_counter()
            solution = simulate(
                equations,
                task.case.integrator,
                task.t_end,
                task.output_step,
                find_exceeded_limit,
                partial="return",
            )
            costs.append(solution.statistics)
            if not solution.status.success:
                break
        with nullcontext() if task.is_checked else unchecked():
            values = collect_run_values(solution)
        values |= summarize_wall_times([x.wall_time for x in costs])
        status = solution.status
        if status.success:
            try:
                values |= evaluate_outputs(task.outputs, solution)
            except BeamdaeError as problem:
                status = Status("failed", str(problem))
        rows = collect_rows(solution)
        text = format_trajectory(rows.headers, rows.numbers)
        measures = measure_rows(rows.headers, rows.numbers, solution.step_extremes)
        frames = _export_frames(solution, task.frames) if task.frames else None
    simulation_time = sum(x.wall_time + x.setup_time for x in costs)
    values[MEASURING_TIME_COLUMN] = clock.perf_counter() - begin - simulation_time
    return Outcome(
        status,
        values,
        rows,
        measures,
        frames,
        errors=measured_errors(solution),
        text=text,
        kernel_warnings=_list_messages(caught, KernelWarning),
    )


def _export_frames(solution: Solution, count: int) -> dict[str, Any]:
    """Return the animation of a run; without frames if nothing can be drawn."""
    frames = export_run_frames(solution, count) or {"glyphs": []}
    # As stored, so that stored and new outcomes are equal.
    return dict(json.loads(encode(frames)))


# Equations, and the files that were read to build them, by the fingerprint of the mechanism. One
# entry suffices: neighboring cases of a study differ only in their integrator.
_last_equations: dict[str, tuple[EquationsOfMotion, FileReads]] = {}


def _build_equations(task: Task) -> tuple[EquationsOfMotion, FileReads]:
    """Return the equations of a task, and the files that were read to build them.

    They are those of the previous task in this process if it had the same mechanism, and the files
    read to build it have not changed.
    """
    case = task.case
    key = task.mechanism_fingerprint or case.mechanism_fingerprint()
    if key not in _last_equations or not are_unchanged(_last_equations[key][1]):
        _last_equations.clear()
        with record_file_reads() as reads:
            mechanism = case.model(**case.parameters)
            equations = as_equations("study", mechanism, case.start, sampled=True)
        _last_equations[key] = equations, reads
    return _last_equations[key]


def _list_messages(caught: list[warnings.WarningMessage], kind: type[Warning]) -> tuple[str, ...]:
    """Return the different warnings of a kind."""
    return tuple(dict.fromkeys(str(x.message) for x in caught if issubclass(x.category, kind)))
