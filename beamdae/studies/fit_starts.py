"""Searches of a fit from several starts, run in parallel and stored as cases of a study."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from beamdae.analysis.fit.problem import FitProblem, Scaling
from beamdae.analysis.fit.search import search
from beamdae.errors import BeamdaeError, as_real, require_progress
from beamdae.interrupts import Interrupted, attach_partial
from beamdae.model_functions import Model
from beamdae.studies.case import Case
from beamdae.studies.executors import SerialPool, create_executor
from beamdae.studies.fingerprints import FingerprintError, digest
from beamdae.studies.run_values import format_output_column
from beamdae.studies.study_run import run_study
from beamdae.studies.sweeps.sweep import Sweep, require_folder

Array = np.ndarray

_OUTPUT = "end of the search"  # has spaces, unlike names of parameters


@dataclass(frozen=True, eq=False)
class StartSearch:
    """Measure of a model that runs a search from its parameters.

    `timing` are the first shifts and clocks (s,) by the first values of the parameters, if there
    are any.
    """

    problem: FitProblem
    scaling: Scaling
    max_evaluations: int
    timing: dict[tuple[float, ...], Array]

    def __call__(self, model: Model) -> str:
        """Return the end of the search, columns of the table of all searches, as JSON."""
        values = tuple(model.parameters[name] for name in self.problem.names)
        timing = self.timing[values] if self.timing else ()
        first = self.scaling.variables(np.array([*values, *timing]))
        result = search(self.problem, self.scaling, first, self.max_evaluations)
        last = result.evaluation.values.tolist()
        return json.dumps(
            {
                "status": result.status.kind,
                "reason": result.status.sentence,
                "chi-square": result.chi_square,
                "evaluations": result.evaluations,
                **dict(zip(self.problem.variables, last, strict=True)),
            }
        )


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
    count = len(problem.names)
    timing = {tuple(x[:count].tolist()): x[count:] for x in starts if len(x) > count}
    try:
        digest([problem, scaling, max_evaluations])
    except FingerprintError as failure:
        raise BeamdaeError(
            "fit: several starts need arguments that another process can reproduce, but "
            f"{failure.location} has the type {failure.kind}; create it inside the model."
        ) from None
    study = Sweep(
        f"{problem.model.name}_fit",
        tuple(Case(problem.model, changed | x, problem.integrator) for x in settings),
        time_limit=None,
        outputs={_OUTPUT: StartSearch(problem, scaling, max_evaluations, timing)},
        is_measured=True,
        settings=tuple(settings),
    )
    try:
        results = run_study(study, path, executor, progress)
    except Exception as failure:
        if hasattr(failure, "partial"):
            # Raised by `progress`. Finished searches are no fit yet.
            attach_partial(failure, None)
        raise
    rows = []
    for case, point in zip(study.cases, settings, strict=True):
        outcome = results.outcome(case)
        row: dict[str, Any] = {f"first {name}": value for name, value in point.items()}
        row |= {"status": outcome.status.kind, "reason": outcome.status.sentence}
        text = outcome.values.get(format_output_column(_OUTPUT))
        if outcome.status.success and text is not None:
            row |= json.loads(text)
        rows.append(row)
    columns = [*rows[0], "chi-square", "evaluations", *problem.variables]
    table = pd.DataFrame(rows, columns=list(dict.fromkeys(columns)))
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
