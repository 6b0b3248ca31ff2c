"""Results of a sweep: the table of responses, runs by parameters, plots and the page."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, as_real, short_repr, suggest, unbox_scalar
from beamdae.model_parameters import convert_text
from beamdae.read_only import read_only_data
from beamdae.report.page.content import Content, slider
from beamdae.report.page.page_file import write_page
from beamdae.results.displays import HasCsv, Plot
from beamdae.results.outcome import Status
from beamdae.results.storage.files import require_file_path
from beamdae.results.time_series import TimeSeries
from beamdae.studies.case import format_parameter
from beamdae.studies.run_values import MEASURED_ERROR_COLUMN
from beamdae.studies.study_page import MAX_CURVES, create_study_page, extra_column_key
from beamdae.studies.study_run import StudyResults
from beamdae.studies.sweeps.response_plots import (
    choose_panels,
    choose_response,
    plot_curves,
    plot_maps,
)
from beamdae.studies.sweeps.responses import (
    Panel,
    choose_axis,
    group_rows,
    measure_columns,
    select_characteristic,
    select_headers,
    select_panels,
    tabulate_responses,
)
from beamdae.studies.sweeps.sweep import (
    REASON,
    STATUS,
    TRAJECTORY,
    WARNINGS,
    Sweep,
)

Array = np.ndarray

TABLE_FILE = "sweep.csv"
_PARAMETER_TOLERANCE = 1e-9  # relative, for numbers that identify a run
_MAX_NOTEBOOK_ROWS = 20
_MAX_NOTEBOOK_COLUMNS = 16


@read_only_data
@dataclass(frozen=True, repr=False)
class SweepRun(TimeSeries):
    """Observed columns of one run of a sweep, with the same access as in a `Solution`.

    Attributes
    ----------
    name
        Label with the values of the varied parameters; of all parameters if none varies.
    parameters
        Values of all swept parameters as displayed.
    status
        Status at the end of the run, with the reason.
    rows
        Observed columns, energies and drift by time.
    warnings
        A single string with all warnings of the run; empty if there are none.
    """

    name: str
    parameters: Mapping[str, Any]
    status: Status
    rows: pd.DataFrame
    warnings: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Same as `name`."""
        return self.name

    def all_columns(self) -> dict[str, Array]:
        """Return all columns as arrays, keyed by header."""
        columns = {str(c): self.rows[c].to_numpy(float) for c in self.rows}
        return {TIME: self.rows.index.to_numpy(float), **columns}

    def metadata(self) -> dict[str, Any]:
        """Return name, parameters, status and warnings of the run."""
        return {
            "name": self.name,
            "parameters": dict(self.parameters),
            "status": self.status.kind,
            "reason": self.status.sentence,
            "warnings": list(self.warnings),
        }

    def coordinate_columns(self) -> dict[str, Array]:
        """Return no columns, because sweeps do not store coordinates."""
        return {}

    def at_times(self, times: Array) -> SweepRun:
        """Return the run restricted to some of the output times [s]."""
        advice = "use the same output_step in the sweep and the other run"
        rows = self.rows.iloc[self._rows_at(times, f"the run {self.name}", advice)]
        return SweepRun(self.name, self.parameters, self.status, rows, self.warnings)

    def __repr__(self) -> str:
        status = f"{self.status.kind}, {self.status.sentence}"
        return f"<SweepRun of {self.name}: {status}; {len(self.rows)} rows>"


@read_only_data
@dataclass(frozen=True, repr=False)
class SweepResults(HasCsv):
    """Results of a sweep; notebooks display them as a table.

    `to_csv` writes `table` without empty columns of messages.

    Attributes
    ----------
    sweep
        The `Sweep` that was run.
    results
        Cost, quality and files of the runs, in the same form as for studies.
    table
        One row per case: parameters, status, outputs; "end", "max", "min" and "RMS" of observed
        columns over the run, such as "tip.y max [m]"; wall time, the reason if the run was not
        successful, its warnings and, if results are stored, the file of its rows.
    """

    sweep: Sweep
    results: StudyResults
    table: pd.DataFrame

    @property
    def interrupted(self) -> bool:
        """True if the sweep was interrupted. Run a sweep with a folder again to resume."""
        return self.results.interrupted

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on idle parameters, and on each of the first five kinds of warnings of runs."""
        return (*idle_parameter_warnings(self), *self.results.describe_warnings())

    @property
    def all_warnings(self) -> tuple[str, ...]:
        """The `warnings`, and a sentence about unsuccessful runs."""
        rows = self.table[self.table[STATUS] != "ok"]
        if not len(rows):
            return self.warnings
        tag = self.sweep.tag(self.sweep.cases[int(rows.index[0])])
        reason = str(rows[REASON].iloc[0]).removesuffix(".")
        problem = "cases failed" if self.sweep.is_measured else "runs did not reach the end time"
        return (
            *self.warnings,
            f"{self.sweep.name}: {len(rows)} of {len(self.table)} {problem}, for example {tag}: "
            f"{reason}; see the table for all.",
        )

    @cached_property
    def _runs_by_row(self) -> dict[int, SweepRun]:
        runs = {}
        cases = zip(self.sweep.cases, self.sweep.settings, strict=True)
        for row, (case, setting) in enumerate(cases):
            outcome = self.results.outcome(case)
            table = outcome.table
            if table is not None:
                warnings = str(outcome.values.get(WARNINGS, "")).splitlines()
                runs[row] = SweepRun(
                    self.sweep.tag(case),
                    setting,
                    outcome.status,
                    table,
                    tuple(warnings),
                )
        return runs

    @property
    def runs(self) -> list[SweepRun]:
        """Runs that have rows, in the order of the table, for example for `bd.plot`."""
        return list(self._runs_by_row.values())

    def run(self, **parameters: Any) -> SweepRun:
        """Return the run with these parameter values; give only those needed to identify the run.

        Parameters
        ----------
        **parameters
            Values by parameter name; for a value with a name, this name. Numbers may deviate from
            the values of the run by a relative difference of 1e-9; texts such as "8 mm" are
            converted.

        Raises
        ------
        BeamdaeError
            If a parameter is unknown, no run or several runs have these values, or the run has no
            rows.
        """
        row = self._find_row(parameters)
        if row not in self._runs_by_row:
            reason = str(self.table[REASON].iloc[row]).removesuffix(".")
            if self.sweep.is_measured:
                reason = reason or "the model was measured, not run"
            tag = self.sweep.tag(self.sweep.cases[row])
            raise BeamdaeError(f"{self.sweep.name}: the case {tag} has no rows: {reason}.")
        return self._runs_by_row[row]

    def _find_row(self, parameters: Mapping[str, Any]) -> int:
        name, swept, settings = self.sweep.name, self.sweep.parameters, self.sweep.settings
        for parameter in parameters:
            if parameter not in swept:
                raise BeamdaeError(
                    f"{name}: there is no swept parameter "
                    f"{short_repr(parameter)}{suggest(parameter, swept)}; choose from "
                    f"{', '.join(swept)}."
                )
        request = ", ".join(f"{x}={short_repr(value)}" for x, value in parameters.items())
        for x, value in parameters.items():
            if any(as_real(setting[x]) is not None for setting in settings):
                number = convert_text(name, x, value, self.sweep.units.get(x, ""))
                parameters = {**parameters, x: number}
        rows = [
            row
            for row, setting in enumerate(settings)
            if all(_is_same_value(setting[x], unbox_scalar(y)) for x, y in parameters.items())
        ]
        if not rows:
            raise BeamdaeError(f"{name}: no case has {request}; see `table` for all cases.")
        first = settings[rows[0]]
        ambiguous = [x for x in swept if any(settings[row][x] != first[x] for row in rows)]
        if ambiguous:
            raise BeamdaeError(
                f"{name}: {len(rows)} cases match {request or 'the selection'}; also give "
                f"{' and '.join(ambiguous)}."
            )
        return rows[0]

    def panels(self, *names: str) -> list[Panel]:
        """Return the panels of the named responses. Defaults to the characteristic responses."""
        headers = select_headers(self.results, self.sweep)
        selected = names or select_characteristic(self.results, self.sweep)
        return [panel for name in selected for panel in select_panels(self.sweep, headers, name)]

    @property
    def parameters(self) -> list[str]:
        """Names of the parameter columns in the table."""
        return [self.sweep.header(name) for name in self.sweep.parameters]

    @cached_property
    def response_columns(self) -> list[str]:
        """Names of the columns in the table that are plotted by default."""
        return [column for panel in self.panels() for column in panel.lines.values()]

    def plot(self, *names: str, x: str | None = None) -> Plot:
        """Plot responses over one parameter, with a curve per combination of other parameters.

        Parameters
        ----------
        *names
            Outputs, observed columns ("tip.y" plots all its measures) or single measures ("tip.y
            max"). Defaults to the outputs or, without outputs, to the columns selected with `of` or
            the characteristic columns, except measures that are the same in all runs; if several
            parameters vary, to the largest or smallest value of each column.
        x
            Parameter on the horizontal axis. Defaults to the numeric parameter with the most values
            or, without numeric parameters, to the parameter with the most values.

        Raises
        ------
        BeamdaeError
            If a response does not exist, no parameter varies, or `x` is not a varied parameter.
        """
        return plot_curves(self.sweep, self.table, self._plotted_panels(names), x)

    def map(self, *names: str, x: str | None = None) -> Plot:
        """Plot responses as color maps over the two varied parameters.

        Parameters
        ----------
        *names
            Responses; see `plot`.
        x
            Parameter on the horizontal axis; see `plot`.

        Raises
        ------
        BeamdaeError
            If a response does not exist, the number of varied parameters is not two, or `x` is not
            a varied parameter.
        """
        return plot_maps(self.sweep, self.table, self._plotted_panels(names), x)

    def _plotted_panels(self, names: tuple[str, ...]) -> list[Panel]:
        """Return the named panels or, without names, those whose responses vary."""
        panels = self.panels(*names)
        return panels if names else choose_panels(self.sweep, self.table, panels)

    @property
    def _written_table(self) -> pd.DataFrame:
        """Table without empty columns of messages, files and errors."""
        optional = {MEASURED_ERROR_COLUMN, REASON, TRAJECTORY, WARNINGS}
        values = {name: self.table[name] for name in self.table if name in optional}
        empty = [name for name, x in values.items() if (x.isna() | (x == "")).all()]
        return self.table.drop(columns=empty)

    def page(self, path: str | Path) -> Path:
        """Write an HTML page with motion, curves, map and table of the runs.

        The page contains the curves of at most 200 runs and the motion of at most 25, which span
        the parameters evenly; sliders show the motion of the nearest of these.

        Parameters
        ----------
        path
            Path of the file.

        Raises
        ------
        BeamdaeError
            If the file cannot be written.
        """
        return write_page(require_file_path("page", path), create_sweep_page(self))

    def __repr__(self) -> str:
        return f"<SweepResults of {self._summary}>"

    def _repr_html_(self) -> str:
        rows = self._written_table.to_html(
            max_rows=_MAX_NOTEBOOK_ROWS, max_cols=_MAX_NOTEBOOK_COLUMNS
        )
        return f"<b>{html.escape(self._summary)}</b>{rows}"

    @property
    def _summary(self) -> str:
        varied = ", ".join(self.sweep.varied) or "nothing"
        completion = self.results.describe_completion(self.sweep.cases)
        return f"{self.sweep.name} over {varied}: {completion}"


def create_sweep_results(results: StudyResults) -> SweepResults:
    """Return the results of a sweep from the results of its study."""
    assert isinstance(results.study, Sweep)
    return SweepResults(results.study, results, tabulate_responses(results, results.study))


def idle_parameter_warnings(swept: SweepResults) -> Iterator[str]:
    """Yield a message about each varied parameter along which all responses are equal."""
    sweep, table = swept.sweep, swept.table
    headers = select_headers(swept.results, sweep)
    measures = [column for header in headers for column in measure_columns(header).values()]
    responses = table[[*sweep.outputs, *measures]].apply(pd.to_numeric, errors="coerce")
    is_complete = ((table[STATUS] == "ok") & responses.notna().any(axis=1)).to_numpy()
    for name in sweep.varied:
        others = [x for x in sweep.varied if x != name]
        groups: dict[str, list[int]] = {}
        for row in np.flatnonzero(is_complete):
            key = repr([sweep.settings[row][x] for x in others])
            groups.setdefault(key, []).append(int(row))
        # Equal models have equal results to the last digit.
        compared = [rows for rows in groups.values() if len(rows) > 1]
        if compared and all(len(responses.iloc[rows].drop_duplicates()) == 1 for rows in compared):
            yield (
                f"{sweep.name}: all responses are equal for all values of {name}; the model may "
                "not use this parameter, or no observed column depends on it."
            )


def _is_same_value(displayed: Any, value: Any) -> bool:
    number, requested = as_real(displayed), as_real(value)
    if number is not None and requested is not None:
        return bool(np.isclose(number, requested, rtol=_PARAMETER_TOLERANCE, atol=0.0))
    plain = isinstance(value, (bool, str))
    return bool(displayed == (value if plain else format_parameter(value)))


def create_sweep_page(swept: SweepResults) -> Content:
    """Return the data of the HTML page of a sweep, for `write_page`.

    Responses are plotted over one parameter; each combination of the other parameters forms a
    family of runs.
    """
    columns = [*swept.parameters, *swept.response_columns]
    grid = swept.sweep.grid
    content = create_study_page(
        swept.results,
        swept.table[columns],
        grid.sample(MAX_CURVES),
        is_stored=TRAJECTORY in swept.table,
    )
    content["columns"][0] |= {"label": "case"}
    observed = select_headers(swept.results, swept.sweep)
    characteristic = select_characteristic(swept.results, swept.sweep)
    content["featured"] = [name for name in characteristic if name in observed]
    units = swept.sweep.units
    content["sliders"] = [
        slider(
            axis.name,
            [x if axis.is_numeric else str(x) for x in axis.values],
            units.get(axis.name, ""),
        )
        for axis in grid.axes
    ]
    content["sequential"] = all(axis.is_numeric for axis in grid.axes)
    cases = zip(content["cases"], swept.sweep.cases, grid.positions.tolist(), strict=True)
    for entry, case, position in cases:
        frames = swept.results.outcome(case).frames
        entry |= {"at": position, "frames": frames if frames and frames["glyphs"] else None}
    if not swept.sweep.varied:
        return content
    x = choose_axis(swept.sweep)
    for family, rows in group_rows(swept.sweep, x).items():
        for row in rows:
            entry, value = content["cases"][row], swept.sweep.settings[row][x]
            entry |= {"family": family or entry["family"], "series": family}
            entry["rank"] = value if isinstance(value, (int, float)) else row
    # The first response that varies: an output or, of an observed column, the larger extreme.
    numeric = {column["key"] for column in content["columns"] if column["kind"] == "number"}
    panels = choose_panels(swept.sweep, swept.table, swept.panels())
    responses = (choose_response(swept.table, panel).lines[""] for panel in panels)
    content["axes"] = {
        "x": extra_column_key(swept.sweep.header(x)),
        "y": next((key for key in map(extra_column_key, responses) if key in numeric), None),
    }
    return content
