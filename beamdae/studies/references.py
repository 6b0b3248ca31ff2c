"""References of a study, and deviations of runs from them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError
from beamdae.integrators import GeneralizedAlpha, Radau
from beamdae.read_only import read_only_data
from beamdae.results.columns import Header, observed_columns, remove_unit, select_observed_columns
from beamdae.studies.case import Case, DigestCache
from beamdae.studies.definition import Study
from beamdae.studies.tasks import Outcome, Task

# Two different methods are unlikely to have the same error.
DEFAULT_REFERENCES = (Radau(rtol=1e-7), GeneralizedAlpha(step=1e-4, newton_tolerance=1e-9))
RESOLUTION_FACTOR = 10.0  # smallest error that a reference can resolve, relative to its uncertainty
_MAX_UNCERTAINTY = 1e-2  # largest accepted difference between the methods, relative to amplitudes

RELATIVE_TIME_TOLERANCE = 1e-12  # output times within it are considered equal
# Ratio of ranges in the same unit; points that joints hold fixed move by less.
_MIN_RELATIVE_MOTION = 1e-6
_POSITION_UNITS = ("m", "rad")


@read_only_data
@dataclass(frozen=True)
class Reference:
    """Trajectory that errors are measured against, and its uncertainty.

    Attributes
    ----------
    methods
        Labels of the two methods or meshes; "" for each one that is missing.
    table
        Observed columns, energies and drift by time; None if there is no reference.
    columns
        Columns used for the errors; empty if there is no reference.
    uncertainty
        Largest difference between the two methods in `columns`, relative to the amplitude of each
        column [-]; NaN if it is unknown.
    sentence
        Description of the reference, or the reason why it is missing.
    """

    methods: tuple[str, str]
    table: pd.DataFrame | None
    columns: tuple[str, ...]
    uncertainty: float
    sentence: str

    @property
    def resolution(self) -> float:
        """Smallest error [-] that the reference can resolve; NaN if this is unknown.

        It is ten times the largest difference between the two methods.
        """
        return RESOLUTION_FACTOR * self.uncertainty


def number_duplicates(names: Iterable[str]) -> list[str]:
    """Return the names; a number is appended to repeated names, as in "name (2)"."""
    unique: dict[str, None] = {}
    for name in names:
        numbered = (f"{name} ({k})" for k in itertools.count(2))
        unique[next(x for x in itertools.chain([name], numbered) if x not in unique)] = None
    return list(unique)


def group_cases(
    study: Study, task_by_case: Mapping[int, Task], digests: DigestCache | None = None
) -> dict[str, list[Case]]:
    """Group the cases that share a reference, and return them by group label.

    The cases of a group have the same mechanism and end time. In a mesh study, they have the same
    integrator, and their mechanisms differ only in the refined parameter. `task_by_case` maps the
    `id` of a case to its task.
    """
    groups: dict[tuple[Any, ...], list[Case]] = {}
    labels: list[str] = []
    for case in study.cases:
        common, method = case, ""
        if study.over is not None:
            others = {k: v for k, v in case.parameters.items() if k != study.over}
            common, method = replace(case, parameters=others), f", {case.label}"
        key = (common.mechanism_fingerprint(digests), task_by_case[id(case)].t_end, method)
        if key not in groups:
            labels.append(common.group + method)
        groups.setdefault(key, []).append(case)
    return dict(zip(number_duplicates(labels), groups.values(), strict=True))


def create_reference_tasks(
    study: Study, cases: Sequence[Case], digests: DigestCache | None = None
) -> list[list[Task]]:
    """Return the tasks of the two reference methods of a group.

    A method has one task, or two tasks for Richardson extrapolation. In a mesh study, the methods
    are the two finest meshes, or the only mesh.
    """
    if study.over is not None:
        meshes = {case.parameters[study.over]: case for case in cases}
        return [[study.task(meshes[n], digests=digests)] for n in sorted(meshes, reverse=True)[:2]]
    methods = []
    for integrator in study.references or DEFAULT_REFERENCES:
        integrators = [integrator]
        name, value = integrator.accuracy
        if name == "step":
            integrators.append(replace(integrator, step=0.5 * value))  # type: ignore[type-var]
        runs = [replace(cases[0], integrator=x) for x in integrators]
        methods.append([study.task(case, reference=True, digests=digests) for case in runs])
    return methods


def build_reference(
    study: Study, methods: list[list[Task]], outcomes: Mapping[str, Outcome]
) -> Reference:
    """Return the reference of a group from the outcomes of its methods, by key of the task.

    Columns in which the methods differ by more than 1 % of the amplitude are omitted, and named in
    the `sentence`. If the reference is missing, for example because a run failed or no column is
    left, its `table` is None and its `sentence` gives the reason.
    """
    if len(methods) == 1:
        return _missing_reference(
            (_label_method(study, methods[0]), ""),
            "no reference, there is only one mesh; add a finer mesh",
        )
    labels = (_label_method(study, methods[0]), _label_method(study, methods[1]))
    for tasks in methods:
        for task in tasks:
            outcome = outcomes[task.key]
            if not outcome.status.success:
                reason = outcome.status.sentence
                return _missing_reference(labels, f"no reference, {task.case.label}: {reason}")
    table, second_table = (_tabulate_method(tasks, outcomes) for tasks in methods)
    try:
        columns = select_error_columns(table, study.columns)
        differences = compute_deviations(second_table, table, columns).max().to_numpy()
    except BeamdaeError as problem:
        return _missing_reference(labels, str(problem))
    # A column may differ because it nearly vanishes by symmetry; the others still have errors.
    agrees = differences <= _MAX_UNCERTAINTY
    disputed = ", ".join(
        f"{columns[k]} by {differences[k]:.2g}" for k in np.argsort(-differences) if not agrees[k]
    )
    if not agrees.any():
        return _missing_reference(
            labels,
            f"no reference, {labels[0]} and {labels[1]} differ by more than "
            f"{_MAX_UNCERTAINTY:g} of the amplitude in all columns ({disputed})",
        )
    columns = list(itertools.compress(columns, agrees))
    uncertainty = float(differences[agrees].max())
    if study.over is not None and uncertainty == 0.0:
        return _missing_reference(
            labels, f"no reference, {study.over} has no effect on the two finest meshes"
        )
    worst = remove_unit(columns[int(np.argmax(differences[agrees]))])
    sentence = (
        f"reference {labels[0]}; {labels[1]} differs by {uncertainty:.2g} of the amplitude of "
        f"{worst}, so errors below {RESOLUTION_FACTOR:g} times this are upper bounds (<)"
    )
    if disputed:
        sentence += f"; no errors of columns that differ by more ({disputed})"
    return Reference(labels, table, tuple(columns), uncertainty, sentence)


def _missing_reference(methods: tuple[str, str], sentence: str) -> Reference:
    return Reference(methods, None, (), np.nan, sentence)


REFERENCE_NOT_RUN = _missing_reference(("", ""), "no reference, the reference was not run")


def _label_method(study: Study, tasks: list[Task]) -> str:
    label = study.tag(tasks[-1].case)
    return label if len(tasks) == 1 else f"{label}, extrapolated"


def _tabulate_method(tasks: list[Task], outcomes: Mapping[str, Outcome]) -> pd.DataFrame:
    """Return the table of one run, or the Richardson extrapolation of steps h and h/2."""
    outcome_tables = [outcomes[task.key].table for task in tasks]
    tables = [table for table in outcome_tables if table is not None]
    if len(tables) == 1:
        return tables[0]
    coarse, fine = (table.iloc[: count_common_rows(*tables)] for table in tables)
    return fine + (fine - coarse.to_numpy()) / (2.0 ** tasks[0].case.integrator.order - 1.0)


def select_error_columns(reference: pd.DataFrame, columns: Sequence[str] = ()) -> list[str]:
    """Return the observed columns used for the errors.

    Defaults to the columns in m and rad (or all columns, if no column has these units) whose range
    exceeds 1e-6 of the largest range in the same unit.

    Raises
    ------
    BeamdaeError
        If a requested column does not exist or is constant, or none of the default columns varies.
    """
    present = observed_columns(reference)
    candidates = (
        select_observed_columns("compare", columns, present)
        or [c for c in present if Header.of(c).unit in _POSITION_UNITS]
        or present
    )
    if not candidates:
        raise BeamdaeError(
            "compare: the model observes nothing to compare; add observed columns to the model."
        )
    ranges = pd.Series(np.ptp(reference[candidates].to_numpy(), axis=0), candidates)
    largest = ranges.groupby(lambda name: Header.of(name).unit).transform("max")
    least = 0.0 if columns else _MIN_RELATIVE_MOTION
    moving = [str(c) for c in ranges.index[ranges > least * largest]]
    constant = [c for c in candidates if c not in moving]
    if not moving or (columns and constant):
        raise BeamdaeError(
            "compare: errors are relative to the range of a column, but the reference is "
            f"constant in {', '.join(constant)}; observe or select columns that vary."
        )
    return moving


def compute_amplitudes(reference: pd.DataFrame, columns: Sequence[str]) -> np.ndarray:
    """Return half the range of each column, (columns,)."""
    return 0.5 * np.ptp(reference[list(columns)].to_numpy(), axis=0)


def count_common_rows(table: pd.DataFrame, other: pd.DataFrame) -> int:
    """Return the number of leading rows with the same times in both tables."""
    rows = min(len(table), len(other))
    times, other_times = (x.index.to_numpy()[:rows] for x in (table, other))
    differs = np.abs(times - other_times) > RELATIVE_TIME_TOLERANCE * np.abs(other_times)
    return int(np.argmax(differs)) if differs.any() else rows


def compute_deviations(
    table: pd.DataFrame, reference: pd.DataFrame, columns: Sequence[str]
) -> pd.DataFrame:
    """Return |x - x_ref| / (half the range of x_ref) at the times common to both tables.

    Both tables start with the same output times. If an event or a failure ends one of the runs, the
    times differ from a certain row on; this row and all later rows are omitted.

    Raises
    ------
    BeamdaeError
        If a column is not observed in `table`.
    """
    missing = [name for name in columns if name not in table]
    if missing:
        raise BeamdaeError(
            f"compare: a case does not observe the column {missing[0]} of the reference; "
            "observe this column in every case."
        )
    rows = count_common_rows(table, reference)
    values = table[list(columns)].to_numpy()[:rows]
    reference_values = reference[list(columns)].to_numpy()[:rows]
    error = np.abs(values - reference_values) / compute_amplitudes(reference, columns)
    return pd.DataFrame(error, columns=list(columns), index=table.index[:rows])
