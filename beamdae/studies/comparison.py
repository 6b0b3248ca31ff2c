"""Compare a few cases here and now: no files, no other processes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError, require_iterable, require_positive, short_repr
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution
from beamdae.studies.case import Case
from beamdae.studies.case_table import assemble_case_table, tabulate_case
from beamdae.studies.deviations import require_column_names, select_error_columns
from beamdae.studies.execution.case_run import NOT_RUN, Outcome, describe_exception
from beamdae.studies.references import Reference
from beamdae.studies.run_values import collect_event_values, collect_run_values, tabulate_trajectory

CaseProgress = Callable[[str, float], None]


def compare(
    cases: Iterable[Case],
    reference: Case | Solution | None = None,
    columns: Sequence[str] = (),
    t_end: float | None = None,
    output_step: float | None = None,
    progress: CaseProgress | None = None,
) -> pd.DataFrame:
    """Run cases one after the other and tabulate cost and quality, a failed run is a row as well.

    For more than a few cases write a study (`bd.study`) and run it with `beamdae compare`: in
    parallel, resumable, and with references that two methods agree on.

    Parameters
    ----------
    cases
        What to run.
    reference
        What errors are measured against: a case to run, or a solution.
    columns
        Observed columns the error is taken over; default: all positions and angles that move.
    t_end, output_step
        As in `simulate`, for all cases.
    progress
        Called now and then with the label of a case and the time it has reached.

    Returns
    -------
    DataFrame
        "error [-]" is the largest difference to the reference over the run (as far as it got) and
        the columns, relative to half the range of each; further columns tell it by column, at the
        end and as root mean square.

    Raises
    ------
    BeamdaeError
        If the reference fails, a column is unknown, or what is given is of another kind.

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
    listed = [cases] if isinstance(cases, Case) else cases
    cases = require_iterable("compare", "cases", listed, "a list of at least one Case")
    if not cases or not all(isinstance(case, Case) for case in cases):
        raise BeamdaeError(f"compare: give a list of at least one Case, got {short_repr(cases)}.")
    if reference is not None and not isinstance(reference, (Case, Solution)):
        raise BeamdaeError(
            f"compare: reference must be a Case or a Solution, got {short_repr(reference)}."
        )
    columns = require_column_names("compare", columns)
    for name, value in (("t_end", t_end), ("output_step", output_step)):
        if value is not None:
            require_positive("compare", name, value)
    if progress is not None and not callable(progress):
        raise BeamdaeError(f"compare: progress must be a function, got {short_repr(progress)}.")
    if isinstance(reference, Case):
        reference = _solve_reference(reference, t_end, output_step, progress)
    rows, interrupted = [], False
    for case in cases:
        outcome = NOT_RUN
        if not interrupted:
            outcome = _run_case(case, t_end, output_step, progress)
            interrupted = outcome.status.kind == "interrupted"
        truth = None
        if reference is not None:
            end = case.model.t_end if t_end is None else t_end
            truth = _sample_reference(reference, outcome, columns, end)
        rows.append(tabulate_case(case, case.group, outcome, truth))
    return assemble_case_table(rows)


def _run_case(
    case: Case, t_end: float | None, output_step: float | None, progress: CaseProgress | None
) -> Outcome:
    try:
        solution = case.solve(t_end, output_step, _label_progress(progress, case.label))
    except KeyboardInterrupt:
        return Outcome(Status("interrupted", "interrupted before its start"))
    except BeamdaeError as problem:
        return Outcome.failed(str(problem))
    except BaseException as problem:  # Whatever a model does, sys.exit included, ends its row.
        return Outcome.failed(describe_exception(problem))
    return Outcome(solution.status, collect_run_values(solution), tabulate_trajectory(solution))


def _sample_reference(
    solution: Solution, outcome: Outcome, columns: Sequence[str], end: float
) -> Reference:
    """The reference at the times of an outcome, and at its own where the outcome ends early."""
    chosen = tuple(select_error_columns(solution.observed, columns))
    table = outcome.table
    if table is not None:
        times = table.index.to_numpy()
        later = solution.t[solution.t > times[-1] * (1.0 + 1e-12)]
        common = times[times <= solution.trajectory.end * (1.0 + 1e-12)]
        solution = replace(solution, t=np.concatenate([common, later]))
    # Of a shorter one it is not known what would happen later.
    events = collect_event_values(solution, end) if solution.model["t_end"] >= end else {}
    method = str(solution.integrator.get("integrator", ""))
    return Reference(
        (method, ""), tabulate_trajectory(solution), chosen, np.nan, "as given", events
    )


def _solve_reference(
    case: Case, t_end: float | None, output_step: float | None, progress: CaseProgress | None
) -> Solution:
    label = case.integrator.label
    try:
        solution = case.solve(t_end, output_step, _label_progress(progress, f"reference {label}"))
    except (BeamdaeError, KeyboardInterrupt):
        raise
    except BaseException as problem:  # Whatever a model does, sys.exit included.
        raise BeamdaeError(
            f"{case.model.name}: the reference failed, {label}: {describe_exception(problem)}."
        ) from problem
    if not solution.status.success:
        raise BeamdaeError(
            f"{case.model.name}: the reference failed, {label}: {solution.status.sentence}."
        )
    return solution


def _label_progress(progress: CaseProgress | None, label: str) -> Callable[[float], None] | None:
    return None if progress is None else partial(progress, label)
