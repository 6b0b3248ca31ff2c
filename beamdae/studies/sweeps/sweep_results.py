"""What became of a sweep: its table, its runs by parameters, its pictures and its page."""

from __future__ import annotations

import html
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from beamdae.equations.measures import TIME
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    as_real,
    format_exception,
    is_valid_path,
    short_repr,
    suggest,
    unbox_scalar,
)
from beamdae.results.outcome import Status
from beamdae.results.storage.files import escape_table, require_file_path, write_text
from beamdae.results.time_series import TimeSeries
from beamdae.studies.case import format_parameter
from beamdae.studies.execution import study_run
from beamdae.studies.execution.executors import SerialPool, create_executor
from beamdae.studies.execution.study_progress import StudyProgress
from beamdae.studies.study_page import create_study_page, extra_column_key
from beamdae.studies.sweeps.response_plots import choose_axis, group_rows
from beamdae.studies.sweeps.responses import (
    REASON,
    STATUS,
    TRAJECTORY,
    WARNINGS,
    Panel,
    parameter_column,
    select_characteristic,
    select_headers,
    select_panels,
    tabulate_responses,
)
from beamdae.studies.sweeps.sweep import Sweep

Array = np.ndarray


@dataclass(frozen=True, repr=False)
class SweepRun(TimeSeries):
    """A run of a sweep: what it observed over time, looked at as a `Solution` is.

    Attributes
    ----------
    name
        The parameters that vary, with their values.
    parameters
        What is told of all parameters.
    status
        How it ended.
    warnings
        Sentences on what is not to be trusted as it stands.
    """

    name: str
    parameters: Mapping[str, Any]
    status: Status
    rows: pd.DataFrame
    warnings: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The parameters that vary, with their values."""
        return self.name

    def all_columns(self) -> dict[str, Array]:
        """The columns of `table` by header, as arrays."""
        columns = {str(c): self.rows[c].to_numpy(float) for c in self.rows}
        return {TIME: self.rows.index.to_numpy(float), **columns}

    def coordinates(self) -> pd.DataFrame:
        """No coordinates are kept."""
        return pd.DataFrame(index=range(len(self.rows)))

    def at_times(self, times: Array) -> SweepRun:
        """The same at some of its own times [s]."""
        advice = "its sweep and the other run must have the same output_step"
        rows = self.rows.iloc[self._rows_at(times, f"the run {self.name}", advice)]
        return SweepRun(self.name, self.parameters, self.status, rows, self.warnings)

    def __repr__(self) -> str:
        ended = f"{self.status.kind}, {self.status.sentence}"
        return f"<SweptRun of {self.name}: {ended}; {len(self.rows)} rows>"


if TYPE_CHECKING:
    from beamdae.results.displays import Plot

TABLE_FILE = "sweep.csv"


@dataclass(frozen=True, repr=False)
class SweepResults:
    """What became of a sweep; a notebook shows its table.

    Attributes
    ----------
    sweep
        What was run.
    results
        Costs, quality and files of its runs, as those of studies.
    table
        One row a case: parameters, status, outputs; "end", "max", "min" and "RMS" of observed
        columns over the run, such as "tip.y max [m]"; wall time, the reason where it did not reach
        its end, what it warns of, and the file of its rows.
    """

    sweep: Sweep
    results: study_run.StudyResults
    table: pd.DataFrame

    @property
    def interrupted(self) -> bool:
        """Whether there was an interrupt; a sweep with a folder goes on when it is run again."""
        return self.results.interrupted

    @cached_property
    def _by_row(self) -> dict[int, SweepRun]:
        found = {}
        for k, (case, said) in enumerate(zip(self.sweep.cases, self.sweep.settings, strict=True)):
            outcome = self.results.outcome(case)
            if outcome.table is not None:
                doubts = tuple(filter(None, [outcome.values.get(WARNINGS, "")]))
                tag, status = self.sweep.tag(case), outcome.status
                found[k] = SweepRun(tag, said, status, outcome.table, doubts)
        return found

    @property
    def runs(self) -> list[SweepRun]:
        """The runs that have rows, in the order of the table, such as for `bd.plot`."""
        return list(self._by_row.values())

    def run(self, **parameters: Any) -> SweepRun:
        """The run of such parameters; those that tell it from no other may be left out.

        Raises
        ------
        BeamdaeError
            If there is none with these values, or several, or it has no rows.
        """
        row = self._row(parameters)
        if row not in self._by_row:
            reason = str(self.table[REASON].iloc[row]).removesuffix(".")
            tag = self.sweep.tag(self.sweep.cases[row])
            raise BeamdaeError(f"{self.sweep.name}: the case {tag} has no rows, {reason}.")
        return self._by_row[row]

    def _row(self, parameters: Mapping[str, Any]) -> int:
        name, known, settings = self.sweep.name, self.sweep.parameters, self.sweep.settings
        for one in parameters:
            if one not in known:
                raise BeamdaeError(
                    f"{name}: no parameter {short_repr(one)}{suggest(one, known)} is swept, but "
                    f"{', '.join(known)}."
                )
        asked = ", ".join(f"{one}={short_repr(value)}" for one, value in parameters.items())
        rows = [k for k, said in enumerate(settings) if _matches(said, parameters)]
        if not rows:
            raise BeamdaeError(f"{name}: no case has {asked}, `table` has all there are.")
        left = [x for x in known if any(settings[k][x] != settings[rows[0]][x] for k in rows)]
        if left:
            raise BeamdaeError(
                f"{name}: {len(rows)} cases have {asked or 'any values'}, give "
                f"{' and '.join(left)} as well."
            )
        return rows[0]

    def panels(self, *names: str) -> list[Panel]:
        """What pictures show of names; default what tells most."""
        headers = select_headers(self.results, self.sweep)
        chosen = names or select_characteristic(self.results, self.sweep)
        return [panel for name in chosen for panel in select_panels(self.sweep, headers, name)]

    @property
    def parameters(self) -> list[str]:
        """Columns of the parameters."""
        return [parameter_column(self.sweep, name) for name in self.sweep.parameters]

    @cached_property
    def told(self) -> list[str]:
        """Columns of what tells most of the runs."""
        return [column for panel in self.panels() for column in panel.lines.values()]

    def plot(self, *names: str, x: str | None = None) -> Plot:
        """Draw what is told of the runs over a parameter, a curve for each choice of the others.

        Parameters
        ----------
        names
            Of outputs, of observed columns ("tip.y", all that is told of it), or of one measure
            ("tip.y max"); default the outputs, or the columns that tell most.
        x
            The parameter on the axis; default the one with most values that are numbers.

        Raises
        ------
        BeamdaeError
            If there is none of a name, or nothing varies.
        """
        from beamdae.studies.sweeps.response_plots import plot_curves

        return plot_curves(self, self.panels(*names), x)

    def map(self, *names: str, x: str | None = None, y: str | None = None) -> Plot:
        """Draw what is told of the runs in color over two parameters; see `plot`.

        Raises
        ------
        BeamdaeError
            If there is none of a name, or other than two parameters vary.
        """
        from beamdae.studies.sweeps.response_plots import plot_maps

        return plot_maps(self, self.panels(*names), x, y)

    def to_csv(self, path: str | Path) -> Path:
        """Write the table as CSV; headers and texts no spreadsheet takes for formulas.

        Raises
        ------
        BeamdaeError
            If it cannot be written.
        """
        text = escape_table(self.table).to_csv(index=False, lineterminator="\n")
        return write_text(require_file_path("to_csv", path), text)

    def page(self, path: str | Path) -> Path:
        """Write a page for any browser: the table, and the runs over each other.

        Raises
        ------
        BeamdaeError
            If it cannot be written.
        """
        from beamdae.report.page.page_file import write_page

        return write_page(require_file_path("page", path), create_sweep_page(self))

    def __repr__(self) -> str:
        return f"<SweepResults of {self._summary}>"

    def _repr_html_(self) -> str:
        table = self.table.drop(columns=[c for c in self.table if self._empty(str(c))])
        return f"<b>{html.escape(self._summary)}</b>{table.to_html(max_rows=20, max_cols=16)}"

    def _empty(self, column: str) -> bool:
        return column in (REASON, TRAJECTORY, WARNINGS) and not self.table[column].any()

    @property
    def _summary(self) -> str:
        done = int((self.table[STATUS] == "ok").sum())
        over = ", ".join(self.sweep.varied) or "nothing"
        return f"{self.sweep.name} over {over}: {len(self.table)} cases, {done} reached their end"


def _matches(said: Mapping[str, Any], parameters: Mapping[str, Any]) -> bool:
    return all(
        _is_same_value(said[name], unbox_scalar(value)) for name, value in parameters.items()
    )


def _is_same_value(said: Any, value: Any) -> bool:
    size, wanted = as_real(said), as_real(value)
    if size is not None and wanted is not None:
        return bool(np.isclose(size, wanted, rtol=1e-9, atol=0.0))
    return bool(said == (value if isinstance(value, (bool, str)) else format_parameter(value)))


def _guard_progress(part: str, progress: Any) -> Callable[[StudyProgress], None] | None:
    """The function of a user's own, whose mistakes are told as such."""
    if progress is None:
        return None
    if not callable(progress):
        raise BeamdaeError(f"{part}: progress must be a function, got {short_repr(progress)}.")

    def hear(standing: StudyProgress) -> None:
        try:
            progress(standing)
        except Exception as problem:
            raise BeamdaeError(
                f"{part}: progress failed, {format_exception(problem)}."
            ) from problem

    return hear


def run_sweep(
    sweep: Sweep,
    folder: str | Path | None,
    jobs: int | None,
    scheduler: str | None,
    progress: Callable[[StudyProgress], None] | None,
) -> SweepResults:
    """Run a sweep from Python, see `bd.sweep`."""
    alone = scheduler is None and as_real(jobs) == 1.0
    executor = SerialPool() if alone else create_executor(sweep.name, "jobs", jobs, scheduler)
    hear = _guard_progress(sweep.name, progress)
    if folder is None:
        # Kept in memory alone, once it has run.
        with TemporaryDirectory(prefix="beamdae-") as scratch:
            found = study_run.run_study(sweep, Path(scratch), executor, hear)
    else:
        found = study_run.run_study(sweep, _require_folder(sweep.name, folder), executor, hear)
    swept = create_sweep_results(found)
    if folder is None:
        swept = replace(swept, table=swept.table.drop(columns=TRAJECTORY))
    else:
        swept.to_csv(found.folder / TABLE_FILE)
    for sentence in list_warnings(swept):
        warnings.warn(sentence, BeamdaeWarning, stacklevel=4)
    return swept


def _require_folder(part: str, given: Any) -> Path:
    if (
        not isinstance(given, (str, Path))
        or not is_valid_path(str(given))
        or not str(given).strip()
    ):
        raise BeamdaeError(
            f"{part}: folder must be the path of a folder of results, got {short_repr(given)}."
        )
    return Path(given)


def create_sweep_results(found: study_run.StudyResults) -> SweepResults:
    """Return the results of a sweep from those of its study run."""
    assert isinstance(found.study, Sweep)
    return SweepResults(found.study, found, tabulate_responses(found, found.study))


def list_warnings(swept: SweepResults) -> Iterator[str]:
    """On the runs that did not reach their end, and on those that are to be read with warnings."""
    failed, doubted = swept.table[STATUS] != "ok", swept.table[WARNINGS] != ""
    for which, why, said in (
        (failed, REASON, "did not reach their end"),
        (doubted & ~failed, WARNINGS, "have warnings"),
    ):
        rows = swept.table[which]
        if len(rows):
            first = swept.sweep.tag(swept.sweep.cases[int(rows.index[0])])
            yield (
                f"{swept.sweep.name}: {len(rows)} of {len(swept.table)} runs {said}, the first of "
                f"them {first}: {str(rows[why].iloc[0]).removesuffix('.')}; the table has all."
            )


def create_sweep_page(swept: SweepResults) -> dict[str, Any]:
    """The page of a sweep; see `beamdae.report.page.page_file.write_page`.

    What is told of its runs is drawn over a parameter; each choice of the others is a family.
    """
    made = create_study_page(swept.results, swept.table[[*swept.parameters, *swept.told]])
    made["columns"][0] |= {"label": "case"}
    if not swept.sweep.varied:
        return made
    x = choose_axis(swept, None)
    for family, rows in group_rows(swept, x).items():
        for row in rows:
            case, at = made["cases"][row], swept.sweep.settings[row][x]
            case |= {"family": family or case["family"], "series": family}
            case["rank"] = at if isinstance(at, (int, float)) else row
    numbers = {column["key"] for column in made["columns"] if column["kind"] == "number"}
    told = [key for key in map(extra_column_key, swept.told) if key in numbers]
    made["axes"] = {
        "x": extra_column_key(parameter_column(swept.sweep, x)),
        "y": next(iter(told), None),
    }
    return made
