"""The table of a sweep: a row a case, its parameters and what is told of its run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError, short_repr, suggest
from beamdae.report.pictures.figures import characteristic_columns
from beamdae.results.columns import Header, observed_columns, select_columns
from beamdae.studies.deviations import select_observed_columns
from beamdae.studies.execution.case_run import Outcome
from beamdae.studies.execution.study_run import StudyResults
from beamdae.studies.run_values import format_output_column
from beamdae.studies.sweeps.sweep import TAKEN, Sweep

Array = np.ndarray

STATUS, REASON, COST, TRAJECTORY, WARNINGS = TAKEN


def _mean(t: Array, x: Array) -> float:
    """Mean over time, by trapezoids."""
    if len(t) < 2:
        return float(x[0])
    return float(np.sum(0.5 * (x[1:] + x[:-1]) * np.diff(t)) / (t[-1] - t[0]))


# What is told of an observed column.
MEASURES: Mapping[str, Callable[[Array, Array], float]] = {
    "end": lambda t, x: float(x[-1]),
    "max": lambda t, x: float(x.max()),
    "min": lambda t, x: float(x.min()),
    "RMS": lambda t, x: float(np.sqrt(_mean(t, x**2))),
}


def measured(header: str) -> dict[str, str]:
    """The columns of the table that tell of an observed column, by measure."""
    return {x: f"{_bare(header)} {x}{header.removeprefix(_bare(header))}" for x in MEASURES}


def parameter_column(sweep: Sweep, name: str) -> str:
    """The column of a parameter."""
    return f"parameter {name}" if name in TAKEN else name


def observed(results: StudyResults, sweep: Sweep) -> list[str]:
    """The observed columns a sweep tells of, of all its runs.

    Raises
    ------
    BeamdaeError
        If it asks for one that none of its runs has.
    """
    tables = [results.outcome(case).table for case in sweep.cases]
    every = dict.fromkeys(c for x in tables if x is not None for c in observed_columns(x))
    if not sweep.columns or not every:
        return list(every)
    return select_observed_columns(sweep.name, sweep.columns, list(every))


def sweep_table(results: StudyResults, sweep: Sweep) -> pd.DataFrame:
    """One row a case: parameters, status, outputs, measures of observed columns, reason, warnings.

    What is told of a run is there where it reached its end.
    """
    headers = observed(results, sweep)
    rows = []
    for case, told in zip(sweep.cases, sweep.settings, strict=True):
        outcome = results.outcome(case)
        status, values = outcome.status, outcome.values
        outputs = {x: _there(values.get(format_output_column(x))) for x in sweep.outputs}
        row = {
            **{parameter_column(sweep, name): value for name, value in told.items()},
            STATUS: status.kind,
            **_measures(outcome, headers),
            **outputs,
            COST: values.get(COST, np.nan),
            REASON: "" if status.success else status.sentence,
            WARNINGS: values.get(WARNINGS, ""),
            TRAJECTORY: f"trajectories/{outcome.file}" if outcome.file else "",
        }
        rows.append(row)
    table = pd.DataFrame(rows)
    first = [*(parameter_column(sweep, x) for x in sweep.parameters), STATUS, *sweep.outputs]
    return table[[*first, *(c for c in table if c not in first)]]


def _there(value: Any) -> Any:
    return np.nan if value is None else value


def _measures(outcome: Outcome, headers: list[str]) -> dict[str, float]:
    table = outcome.table if outcome.status.success else None
    found: dict[str, float] = {}
    for header in headers:
        columns = measured(header)
        if table is None or header not in table:
            found |= dict.fromkeys(columns.values(), np.nan)
            continue
        t, x = table.index.to_numpy(float), table[header].to_numpy(float)
        found |= {column: MEASURES[name](t, x) for name, column in columns.items()}
    return found


def characteristic(results: StudyResults, sweep: Sweep) -> list[str]:
    """The names that tell most: outputs, or else columns that are asked for, or a few of them."""
    if sweep.outputs:
        return list(sweep.outputs)
    headers = observed(results, sweep)
    if sweep.columns or not headers:
        return headers
    outcomes = [results.outcome(case) for case in sweep.cases]
    tables = [x.table for x in outcomes if x.table is not None and x.status.success]
    return characteristic_columns(tables[0][observed_columns(tables[0])]) if tables else []


@dataclass(frozen=True)
class Panel:
    """What is drawn together.

    Attributes
    ----------
    title, unit
        What it is.
    lines
        Columns of the table by measure; "" where there is but one.
    """

    title: str
    unit: str
    lines: Mapping[str, str]

    def apart(self) -> list[Panel]:
        """Each line by itself."""
        return [
            Panel(f"{self.title} {what}".strip(), self.unit, {"": c})
            for what, c in self.lines.items()
        ]


def panels_of(sweep: Sweep, headers: list[str], name: Any) -> list[Panel]:
    """What a name stands for: an output, observed columns with their measures, or one of these.

    Raises
    ------
    BeamdaeError
        If there is none of the name.
    """
    outputs = {(x if bare else _bare(x)): x for bare in (False, True) for x in sweep.outputs}
    if isinstance(name, str) and name in outputs:
        return [_single(outputs[name])]
    every = [column for header in headers for column in measured(header).values()]
    for known in (headers, every):
        try:
            found = select_columns(known, name)
        except BeamdaeError:
            continue
        if known is every:
            return [_single(column) for column in found]
        return [Panel(_bare(x), _unit(x), measured(x)) for x in found]
    names = [*sweep.outputs, *map(_bare, headers)]
    raise BeamdaeError(
        f"{sweep.name}: it tells of nothing called {short_repr(name)}{suggest(name, names)}, but of "
        f"{', '.join(names) or 'nothing'}."
    )


def _single(column: str) -> Panel:
    return Panel(_bare(column), _unit(column), {"": column})


def _bare(header: str) -> str:
    return header.rpartition(" [")[0] if header.endswith("]") else header


def _unit(header: str) -> str:
    return Header.of(header).unit if header.endswith("]") else ""
