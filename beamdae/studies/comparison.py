"""Comparison of a few cases in the current process, without writing files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from beamdae.errors import (
    BeamdaeError,
    require_choice,
    require_iterable,
    require_positive,
    require_progress,
    short_repr,
)
from beamdae.interrupts import (
    PARTIAL_RESULTS,
    Interrupted,
    PartialResult,
    acknowledge,
    interruptible,
)
from beamdae.results.columns import require_column_names
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution
from beamdae.studies.case import Case
from beamdae.studies.case_table import assemble_case_table, tabulate_case
from beamdae.studies.references import RELATIVE_TIME_TOLERANCE, Reference, select_error_columns
from beamdae.studies.run_values import collect_rows, collect_run_values
from beamdae.studies.tasks import NOT_RUN, Outcome, describe_exception

CaseProgress = Callable[[str, float], None]


@interruptible
def compare(
    cases: Iterable[Case],
    reference: Case | Solution | None = None,
    columns: Sequence[str] = (),
    t_end: float | None = None,
    output_step: float | None = None,
    progress: CaseProgress | None = None,
    *,
    partial: PartialResult = "raise",
) -> pd.DataFrame:
    """Run cases sequentially and tabulate their cost and quality, including failed runs.

    For more than a few cases, define a study (`bd.study`) and run it with `beamdae compare`: a
    study runs in parallel, can be resumed, and computes each reference with two methods.

    Parameters
    ----------
    cases
        Cases to run.
    reference
        Solution that errors are measured against, or a case that is run to obtain this solution.
        Without a reference, no errors are computed.
    columns
        Observed columns used for the errors. Defaults to all columns in m or rad that vary or, if
        no column has these units, to all columns that vary.
    t_end, output_step
        End time and time between rows of all cases [s], as in `simulate`.
    progress
        Function that is called repeatedly with the label of the running case or reference and the
        simulated time [s].
    partial
        "return" to return the table instead of raising `Interrupted` if a case is interrupted; this
        case and all later cases have the status "interrupted".

    Returns
    -------
    DataFrame
        One row per case. With a reference, "error [-]" is the largest difference over `columns` and
        all times that both runs have reached, relative to half the range of the column in the
        reference. Further columns contain the final, maximum and root mean square error of each
        column in `columns`, in its unit.

    Raises
    ------
    BeamdaeError
        If the reference fails, a column is unknown or constant, or an argument is invalid.
    Interrupted
        If Ctrl-C ends the call; `Interrupted.partial` is the table so far, or None if there
        is none.

    Warns
    -----
    BeamdaeWarning
        If a run is not completed or has warnings; see `simulate`.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=0.1)
    ... def swing(mass=2.0):
    ...     mech = bd.Mechanism(gravity=(0.0, -9.81))
    ...     bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    ...     mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    ...     return mech
    >>> cases = [bd.Case(swing, p, bd.Ida(rtol=1e-4)) for p in bd.grid(mass=[1.0, 2.0])]
    >>> list(bd.compare(cases)["mass"])
    [1.0, 2.0]
    """
    allowed = "a list of at least one Case"
    if isinstance(cases, Case):
        cases = [cases]
    cases = require_iterable("compare", "cases", cases, allowed)
    if not cases or not all(isinstance(case, Case) for case in cases):
        raise BeamdaeError(f"compare: cases must be {allowed}, got {short_repr(cases)}.")
    if reference is not None and not isinstance(reference, (Case, Solution)):
        raise BeamdaeError(
            f"compare: reference must be a Case or a Solution, got {short_repr(reference)}."
        )
    require_choice("compare", "partial", partial, PARTIAL_RESULTS)
    columns = require_column_names("compare", columns)
    for name, value in (("t_end", t_end), ("output_step", output_step)):
        if value is not None:
            require_positive("compare", name, value)
    require_progress("compare", progress, 2)
    if isinstance(reference, Case):
        reference = _solve_reference(reference, t_end, output_step, progress)
    rows, interrupted = [], False
    for case in cases:
        outcome = NOT_RUN
        if not interrupted:
            outcome = _run_case(case, t_end, output_step, progress)
            interrupted = outcome.status.kind == "interrupted"
        sampled = None
        if reference is not None:
            sampled = _sample_reference(reference, outcome, columns)
        rows.append(tabulate_case(case, case.group, outcome, sampled))
    table = assemble_case_table(rows)
    if interrupted and partial == "raise":
        raise Interrupted("interrupted", table, "compare")
    return table


def _run_case(
    case: Case, t_end: float | None, output_step: float | None, progress: CaseProgress | None
) -> Outcome:
    try:
        solution = case.solve(
            t_end, output_step, _label_progress(progress, case.label), partial="return"
        )
    except KeyboardInterrupt:
        acknowledge()
        return Outcome(Status("interrupted", "interrupted before the start"))
    except BaseException as problem:  # SystemExit included.
        if hasattr(problem, "partial"):
            # Raised by `progress`, not by the model.
            raise
        is_described = isinstance(problem, BeamdaeError)
        return Outcome.failed(str(problem) if is_described else describe_exception(problem))
    return Outcome(solution.status, collect_run_values(solution), collect_rows(solution))


def _sample_reference(solution: Solution, outcome: Outcome, columns: Sequence[str]) -> Reference:
    """Sample the reference at the times of an outcome, and at later times of the reference."""
    error_columns = tuple(select_error_columns(solution.observed, columns))
    if outcome.rows is not None:
        times = outcome.rows.numbers[:, 0]
        later = solution.t[solution.t > times[-1] * (1.0 + RELATIVE_TIME_TOLERANCE)]
        common = times[times <= solution.trajectory.end * (1.0 + RELATIVE_TIME_TOLERANCE)]
        solution = replace(solution, t=np.concatenate([common, later]))
    method = str(solution.integrator.get("integrator", ""))
    return Reference(
        (method, ""), collect_rows(solution).table(), error_columns, np.nan, "as given"
    )


def _solve_reference(
    case: Case, t_end: float | None, output_step: float | None, progress: CaseProgress | None
) -> Solution:
    label = case.integrator.label
    try:
        solution = case.solve(t_end, output_step, _label_progress(progress, f"reference {label}"))
    except (BeamdaeError, KeyboardInterrupt):
        raise
    except BaseException as problem:  # SystemExit included.
        if hasattr(problem, "partial"):
            # Raised by `progress`, not by the model.
            raise
        raise BeamdaeError(
            f"{case.model.name}: the reference run with {label} failed: "
            f"{describe_exception(problem)}."
        ) from problem
    if not solution.status.success:
        raise BeamdaeError(
            f"{case.model.name}: the reference run with {label} failed: {solution.status.sentence}."
        )
    return solution


def _label_progress(progress: CaseProgress | None, label: str) -> Callable[[float], None] | None:
    return None if progress is None else partial(progress, label)
