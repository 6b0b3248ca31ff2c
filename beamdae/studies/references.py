"""What errors are measured against: two methods that agree, and how well they do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError
from beamdae.integrators import GeneralizedAlpha, Radau
from beamdae.studies.case import Case, DigestCache
from beamdae.studies.definition import Study
from beamdae.studies.deviations import compute_deviations, count_common_rows, select_error_columns
from beamdae.studies.execution.case_run import Outcome, Task
from beamdae.studies.run_values import extrapolate_events
from beamdae.studies.unique_names import number_duplicates

# Two methods of different kind; what they agree on is what both mean.
DEFAULT_REFERENCES = (Radau(rtol=1e-7), GeneralizedAlpha(step=1e-4, newton_tolerance=1e-9))
# Errors within this factor of the reference's uncertainty say more about it than about the case.
RESOLUTION_FACTOR = 10.0
# Two methods that differ by more than this share of a column's amplitude make no reference.
_MAX_UNCERTAINTY = 1e-2


@dataclass(frozen=True)
class Reference:
    """Rows to measure others against, and how well they are known.

    Attributes
    ----------
    methods
        The two methods, in words.
    table
        Observed columns by time; None where there is no reference.
    columns
        The columns errors are taken over.
    uncertainty
        Largest difference between the two methods, relative to the amplitude of each column.
    sentence
        What there is to say about it.
    events
        What happened, see `event_values`.
    """

    methods: tuple[str, str]
    table: pd.DataFrame | None
    columns: tuple[str, ...]
    uncertainty: float
    sentence: str
    events: Mapping[str, Any] = field(default_factory=dict)

    @property
    def resolution(self) -> float:
        """Smallest error that can be told from the reference's own."""
        return RESOLUTION_FACTOR * self.uncertainty


def group_cases(
    study: Study, of_cases: Mapping[int, Task], digests: DigestCache | None = None
) -> dict[str, list[Case]]:
    """Cases that can be measured against the same reference, by what they have in common.

    That is the mechanism; in a study of meshes all of it but the mesh, and the integrator.
    """
    found: dict[tuple[Any, ...], list[Case]] = {}
    for case in study.cases:
        method = "" if study.over is None else case.label
        key = (
            _drop_refined_parameter(study, case).mechanism_fingerprint(digests),
            of_cases[id(case)].t_end,
            method,
        )
        found.setdefault(key, []).append(case)
    labels = number_duplicates(_group_label(study, cases[0]) for cases in found.values())
    return dict(zip(labels, found.values(), strict=True))


def _drop_refined_parameter(study: Study, case: Case) -> Case:
    if study.over is None:
        return case
    return replace(case, parameters={k: v for k, v in case.parameters.items() if k != study.over})


def _group_label(study: Study, case: Case) -> str:
    common = _drop_refined_parameter(study, case).group
    return common if study.over is None else f"{common}, {case.label}"


def create_reference_tasks(
    study: Study, cases: Sequence[Case], digests: DigestCache | None = None
) -> list[list[Task]]:
    """The runs of the two methods of a group: one, or two to be extrapolated, each."""
    over = study.over
    if over is not None:
        # The finest mesh, and the next to it.
        meshes = {case.parameters[over]: case for case in cases}
        return [[study.task(meshes[n], digests=digests)] for n in sorted(meshes, reverse=True)[:2]]
    methods = []
    for integrator in study.references or DEFAULT_REFERENCES:
        steps = [integrator]
        name, value = integrator.accuracy
        if name == "step":
            steps.append(replace(integrator, step=0.5 * value))  # type: ignore[type-var]
        runs = [replace(cases[0], integrator=x) for x in steps]
        methods.append([study.task(case, reference=True, digests=digests) for case in runs])
    return methods


def build_reference(
    study: Study, methods: list[list[Task]], outcomes: Mapping[str, Outcome]
) -> Reference:
    """The reference of a group from the outcomes of its methods."""
    names = tuple(_label_method(tasks, study) for tasks in methods)
    if len(names) == 1:
        return _missing_reference((names[0], ""), "there is one mesh only, errors need a finer one")
    labels = (names[0], names[1])
    for tasks in methods:
        for task in tasks:
            outcome = outcomes[task.key]
            if not outcome.status.success:
                reason = outcome.status.sentence
                return _missing_reference(labels, f"no reference, {task.case.label}: {reason}")
    truth, witness = (_tabulate_method(tasks, outcomes) for tasks in methods)
    try:
        columns = select_error_columns(truth, study.columns)
        uncertainty = float(compute_deviations(witness, truth, columns).to_numpy().max())
    except BeamdaeError as problem:
        return _missing_reference(labels, str(problem))
    if not uncertainty <= _MAX_UNCERTAINTY:
        return _missing_reference(
            labels, f"no reference, {labels[0]} and {labels[1]} differ by {uncertainty:.2g}"
        )
    if study.over is not None and uncertainty == 0.0:
        return _missing_reference(
            labels, f"{study.over} changes nothing, the two finest meshes are the same"
        )
    sentence = (
        f"Reference: {labels[0]}; {labels[1]} differs from it by {uncertainty:.2g} of the amplitude"
    )
    events = _collect_method_events(methods[0], outcomes)
    return Reference(labels, truth, tuple(columns), uncertainty, sentence, events)


def _missing_reference(methods: tuple[str, str], sentence: str) -> Reference:
    return Reference(methods, None, (), np.nan, sentence)


REFERENCE_NOT_RUN = _missing_reference(("", ""), "its reference was not run")


def _label_method(tasks: list[Task], study: Study) -> str:
    if study.over is not None:
        return f"{study.over}={tasks[0].case.parameters[study.over]}"
    label = tasks[-1].case.label
    return label if len(tasks) == 1 else f"{label}, extrapolated"


def _tabulate_method(tasks: list[Task], outcomes: Mapping[str, Outcome]) -> pd.DataFrame:
    """Rows of one run, or of two with steps h and h/2 extrapolated (Richardson)."""
    found = [outcomes[task.key].table for task in tasks]
    tables = [table for table in found if table is not None]
    if len(tables) == 1:
        return tables[0]
    coarse, fine = (table.iloc[: count_common_rows(*tables)] for table in tables)
    return fine + (fine - coarse.to_numpy()) / (2.0 ** tasks[0].case.integrator.order - 1.0)


def _collect_method_events(tasks: list[Task], outcomes: Mapping[str, Outcome]) -> dict[str, Any]:
    """Events of the same."""
    found = [outcomes[task.key].values for task in tasks]
    return extrapolate_events(found[0], found[-1], tasks[0].case.integrator.order)
