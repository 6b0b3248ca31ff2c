"""Searches of a fit from several starts, run in parallel and stored as cases of a study."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from beamdae.analysis.fit.problem import FitProblem
from beamdae.analysis.fit.search import search
from beamdae.analysis.fit.variables import Scaling
from beamdae.errors import BeamdaeError, as_real, require_progress
from beamdae.integrators import Integrator
from beamdae.interrupts import Interrupted, attach_partial
from beamdae.read_only import read_only_data
from beamdae.results.solution import Solution
from beamdae.studies.case import FINGERPRINT_LENGTH, Case, DigestCache
from beamdae.studies.definition import Study
from beamdae.studies.execution.executors import SerialPool, TaskExecutor, create_executor
from beamdae.studies.execution.study_progress import StudyProgress
from beamdae.studies.execution.study_run import StudyResults, run_study
from beamdae.studies.run_values import format_output_column
from beamdae.studies.store.fingerprints import FingerprintError, digest
from beamdae.studies.sweeps.sweep import require_folder
from beamdae.studies.tasks import Limits, Task

Array = np.ndarray

_OUTPUT = "search"
# Length of the run of each case, relative to the time span of the data. Its result is not used: the
# study runs a case before it evaluates its outputs, and the output of these cases is a search.
_RELATIVE_RUN = 1e-3


@dataclass(frozen=True, eq=False)
class StartSearch:
    """Output function of a case that runs a search from the variables `first`."""

    problem: FitProblem
    scaling: Scaling
    max_evaluations: int
    first: Array

    def __call__(self, solution: Solution) -> str:
        """Return the end of the search as JSON."""
        result = search(self.problem, self.scaling, self.first, self.max_evaluations)
        return json.dumps(
            {
                "values": result.evaluation.values.tolist(),
                "chi_square": result.chi_square,
                "status": result.status.kind,
                "reason": result.status.sentence,
                "evaluations": result.evaluations,
            }
        )


@read_only_data
@dataclass(frozen=True)
class StartStudy(Study):
    """Searches of one problem, each from the parameters of a case.

    Attributes
    ----------
    searches
        Search of each case.
    """

    references: tuple[Integrator, ...] | None = ()
    searches: tuple[StartSearch, ...] = ()

    def task(self, case: Case, reference: bool = False, digests: DigestCache | None = None) -> Task:
        """Return the task of a case, with its search as output; see `Study.task`."""
        task = super().task(case, reference, digests)
        own = self.searches[next(k for k, x in enumerate(self.cases) if x is case)]
        key = digest([task.key, self._problem_digest, own.first.tolist()])
        return replace(task, key=key[:FINGERPRINT_LENGTH], outputs={_OUTPUT: own})

    @cached_property
    def _problem_digest(self) -> str:
        first = self.searches[0]
        try:
            return digest([first.problem, first.scaling, first.max_evaluations])
        except FingerprintError as problem:
            raise BeamdaeError(
                f"fit: several starts need arguments that another process can reproduce, but "
                f"{problem.location} has the type {problem.kind}; create it inside the model."
            ) from None


def run_starts(
    problem: FitProblem,
    scaling: Scaling,
    max_evaluations: int,
    points: Array,
    folder: Any,
    jobs: Any,
    progress: Any,
) -> tuple[Array, pd.DataFrame, bool]:
    """Return the variables at the end of the best of several searches, and a table of all.

    The first search begins with the first values of the problem, others with `points` (j, K).
    The third value is True if Ctrl-C ended the searches. See `fit` for the arguments.

    Raises
    ------
    BeamdaeError
        If all searches fail, the folder cannot be written, or a value of a parameter cannot be
        reproduced in other processes.
    Interrupted
        If Ctrl-C ends the searches before one of them is finished.
    """
    require_progress("fit", progress)
    path = None if folder is None else require_folder("fit", folder)
    serial = as_real(jobs) == 1.0
    executor = SerialPool() if serial else create_executor("fit", "", jobs, None)
    starts = [problem.first_values, *points]
    settings = [dict(zip(problem.names, point.tolist(), strict=False)) for point in starts]
    defaults = problem.model.parameters
    changed = {
        name: value
        for name, value in problem.parameters.items()
        if name not in problem.names and value is not defaults[name]
    }
    study = StartStudy(
        f"{problem.model.name}_fit",
        tuple(Case(problem.model, changed | x, problem.integrator) for x in settings),
        t_end=_RELATIVE_RUN * problem.last_time,
        limits=Limits(),
        searches=tuple(
            StartSearch(problem, scaling, max_evaluations, scaling.variables(x)) for x in starts
        ),
    )
    results = _run(study, path, executor, progress)
    table = _tabulate(problem, results, settings)
    finished = table[table["chi-square"].notna()]
    if results.interrupted and not len(finished):
        hint = "; call fit with the same folder to resume" if path is not None else ""
        raise Interrupted(f"interrupted{hint}", None, "fit")
    if not len(finished):
        raise BeamdaeError(
            f"fit: all {len(starts)} searches failed, the first one because "
            f"{table['reason'].iloc[0]}"
        )
    best = int(np.argmin(finished["chi-square"].to_numpy(float)))
    values = finished[list(problem.variables)].to_numpy(float)[best]
    return scaling.variables(values), table, results.interrupted


def _run(
    study: StartStudy,
    folder: Path | None,
    executor: TaskExecutor,
    progress: Callable[[StudyProgress], None] | None,
) -> StudyResults:
    try:
        if folder is not None:
            return run_study(study, folder, executor, progress)
        with TemporaryDirectory(prefix="beamdae-") as scratch:
            return run_study(study, Path(scratch), executor, progress)
    except Exception as problem:
        if hasattr(problem, "partial"):
            # Raised by `progress`. Finished searches are no fit yet.
            attach_partial(problem, None)
        raise


def _tabulate(
    problem: FitProblem, results: StudyResults, settings: list[dict[str, Any]]
) -> pd.DataFrame:
    """Return a row per start: first values, status, sum of squares and last values."""
    rows = []
    for case, first in zip(results.study.cases, settings, strict=True):
        outcome = results.outcome(case)
        row: dict[str, Any] = {f"first {name}": value for name, value in first.items()}
        row |= {"status": outcome.status.kind, "reason": outcome.status.sentence}
        text = outcome.values.get(format_output_column(_OUTPUT))
        if outcome.status.success and text is not None:
            end = json.loads(text)
            row |= {
                "status": end["status"],
                "reason": end["reason"],
                "chi-square": end["chi_square"],
                "evaluations": end["evaluations"],
            }
            row |= dict(zip(problem.variables, end["values"], strict=True))
        rows.append(row)
    columns = [*rows[0], "chi-square", "evaluations", *problem.variables]
    return pd.DataFrame(rows, columns=list(dict.fromkeys(columns)))
