"""Table of responses: one row per run of a sweep, with measures of its observed columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from beamdae.errors import (
    BeamdaeError,
    plain_text,
    short_repr,
    suggest,
)
from beamdae.model_parameters import format_with_unit
from beamdae.report.pictures.figures import characteristic_columns
from beamdae.results.columns import (
    Header,
    observed_columns,
    remove_unit,
    select_columns,
    select_observed_columns,
)
from beamdae.studies.run_values import (
    MEASURED_ERROR_COLUMN,
    MEASURES,
    WALL_TIME_COLUMN,
    format_output_column,
)
from beamdae.studies.study_run import StudyResults
from beamdae.studies.sweeps.sweep import (
    REASON,
    STATUS,
    TRAJECTORY,
    WARNINGS,
    Sweep,
)

Array = np.ndarray


def measure_columns(header: str) -> dict[str, str]:
    """Return the columns of the table for an observed column, keyed by measure."""
    quantity = remove_unit(header)
    return {x: f"{quantity} {x}{header.removeprefix(quantity)}" for x in MEASURES}


def select_headers(results: StudyResults, study: Sweep) -> list[str]:
    """Return the observed columns to tabulate, collected from all runs.

    If no run has observed columns, the list is empty.

    Raises
    ------
    BeamdaeError
        If runs have observed columns, but the study selects a column that no run has.
    """
    measures = [results.outcome(case).measures for case in study.cases]
    headers = dict.fromkeys(header for by_column in measures for header in by_column)
    if not study.columns or not headers:
        return list(headers)
    return select_observed_columns(study.name, study.columns, list(headers))


def tabulate_responses(results: StudyResults, study: Sweep) -> pd.DataFrame:
    """Return one row per case: parameters, status, outputs, measures, wall time and messages.

    Measures are NaN for unsuccessful runs and for columns that a run does not observe.
    """
    headers = select_headers(results, study)
    measures = [column for header in headers for column in measure_columns(header).values()]
    rows = []
    for case, setting in zip(study.cases, study.settings, strict=True):
        outcome = results.outcome(case)
        status, values = outcome.status, outcome.values
        errors = [outcome.errors[x] for x in headers if x in outcome.errors]
        of_run = outcome.measures if status.success else {}
        missing = [np.nan] * len(MEASURES)
        numbers = [x for header in headers for x in of_run.get(header, missing)]
        outputs = {x: values.get(format_output_column(x)) for x in study.outputs}
        row = {
            **{study.header(name): value for name, value in setting.items()},
            STATUS: status.kind,
            **dict(zip(measures, numbers, strict=True)),
            **{name: np.nan if x is None else x for name, x in outputs.items()},
            **({} if study.is_measured else {MEASURED_ERROR_COLUMN: max(errors, default=np.nan)}),
            WALL_TIME_COLUMN: values.get(WALL_TIME_COLUMN, np.nan),
            REASON: "" if status.success else status.sentence,
            WARNINGS: values.get(WARNINGS, ""),
            TRAJECTORY: f"trajectories/{outcome.file}" if outcome.file else "",
        }
        rows.append(row)
    table = pd.DataFrame(rows)
    first = [*map(study.header, study.parameters), STATUS, *study.outputs]
    return table[[*first, *(c for c in table if c not in first)]]


def select_characteristic(results: StudyResults, study: Sweep) -> list[str]:
    """Return the responses shown by default.

    These are the outputs of the study or, without outputs, the selected columns or, without a
    selection, the characteristic columns of the first successful run. If no run is successful, the
    list is empty.
    """
    if study.outputs:
        return list(study.outputs)
    headers = select_headers(results, study)
    if study.columns or not headers:
        return headers
    for outcome in map(results.outcome, study.cases):
        if outcome.status.success and outcome.rows is not None:
            table = outcome.rows.table()
            return characteristic_columns(table[observed_columns(table)])
    return []


class Panel(NamedTuple):
    """Responses that share the axes of a plot.

    Attributes
    ----------
    title, unit
        Name and unit of the quantity on the vertical axis; the unit is "" if there is none.
    lines
        Columns of the table, keyed by measure; a single column has the key "".
    """

    title: str
    unit: str
    lines: Mapping[str, str]

    @property
    def label(self) -> str:
        """Label of the vertical axis."""
        return f"[{self.unit}]" if self.unit else ""

    def split(self) -> list[Panel]:
        """Return one panel per line."""
        return [
            Panel(f"{self.title} {measure}".strip(), self.unit, {"": column})
            for measure, column in self.lines.items()
        ]


def select_panels(study: Sweep, headers: list[str], name: Any) -> list[Panel]:
    """Return the panels of the output, the observed columns or the measure called `name`.

    Raises
    ------
    BeamdaeError
        If no response has this name.
    """
    outputs = {(remove_unit(x) if bare else x): x for bare in (False, True) for x in study.outputs}
    name = plain_text(name)
    if isinstance(name, str) and name in outputs:
        return [_create_panel(outputs[name])]
    all_measures = [column for header in headers for column in measure_columns(header).values()]
    for candidates in (headers, all_measures):
        try:
            columns = select_columns(candidates, name)
        except BeamdaeError:
            continue
        if candidates is all_measures:
            return [_create_panel(column) for column in columns]
        return [Panel(remove_unit(x), _parse_unit(x), measure_columns(x)) for x in columns]
    names = [*study.outputs, *map(remove_unit, headers)]
    raise BeamdaeError(
        f"{study.name}: there is no response {short_repr(name)}{suggest(name, names)}; "
        f"available responses: {', '.join(names) or 'none'}."
    )


def _create_panel(column: str) -> Panel:
    return Panel(remove_unit(column), _parse_unit(column), {"": column})


def _parse_unit(header: str) -> str:
    return Header.of(header).unit


def choose_axis(study: Sweep, name: Any = None) -> str:
    """Return the parameter of the horizontal axis.

    Defaults to the numeric parameter with the most distinct values or, without numeric parameters,
    to the parameter with the most distinct values.

    Raises
    ------
    BeamdaeError
        If no parameter varies, or `name` is not a varied parameter.
    """
    varied = study.varied
    if not varied:
        raise BeamdaeError(
            f"{study.name}: no parameter varies; give at least one parameter several "
            "values to plot."
        )
    name = plain_text(name)
    if name is not None:
        if not isinstance(name, str) or name not in varied:
            raise BeamdaeError(
                f"{study.name}: there is no varied parameter "
                f"{short_repr(name)}{suggest(name, varied)}; choose from "
                f"{', '.join(varied)}."
            )
        return name

    return max(varied, key=lambda x: (study.axes[x].is_numeric, len(study.axes[x].values)))


def group_rows(study: Sweep, x: str) -> dict[str, Array]:
    """Return table row indices, grouped by the values of all varied parameters except `x`.

    The names of groups have units: "thickness = 0.003 m".
    """
    others = [name for name in study.varied if name != x]
    groups: dict[str, list[int]] = {}
    for row, setting in enumerate(study.settings):
        values = {x: format_with_unit(setting[x], study.units.get(x, "")) for x in others}
        label = ", ".join(f"{x} = {value}" for x, value in values.items())
        groups.setdefault(label, []).append(row)
    return {label: np.array(rows) for label, rows in groups.items()}
