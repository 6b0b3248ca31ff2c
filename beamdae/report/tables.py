"""Tables of results as texts, and their layout in terminals of any width."""

from __future__ import annotations

import html
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.cells import cell_len, set_cell_size
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

from beamdae.errors import format_count
from beamdae.model_parameters import split_unit
from beamdae.report.text import make_printable

if TYPE_CHECKING:
    import pandas as pd

    from beamdae.accuracy.errors import Errors
    from beamdae.results.solution import Solution
    from beamdae.results.step_extremes import StepExtremes

    Columns = Mapping[str, Any] | pd.DataFrame

# All widths are in terminal cells. Columns are omitted before the first column becomes narrower
# than the larger of this and half the terminal width; after that, it shrinks to its minimum.
_FIRST_COLUMN_WIDTH = 28
_MIN_FIRST_COLUMN_WIDTH = 6
_MIN_SENTENCE_WIDTH = 20  # columns of sentences are not folded to less than this
_MIN_BROKEN_HEADER = 8  # headers with fewer characters have one line
_COLUMN_GAP = 2  # between two columns
_ROW_MARGIN = 2  # at both ends of a row together
_MAX_TOPIC_SHARE = 0.5  # maximum width of the topics, relative to the terminal width
_SPACE = re.compile(r" (?!\d+ \[|[^\[]*\])")  # neither inside a unit nor before a number with one
_UNIT_SPACE = re.compile(r" (?=\[|[^\[]*\])")  # before a unit or inside one
# Values below this fraction of the largest comparable value are shown as zero (rounding noise).
_ROUNDING = 1e-12
_CELL_STYLE = 'style="text-align: left; padding: 1px 12px 1px 0; vertical-align: top; {}"'
_NAME_STYLE = _CELL_STYLE.format("white-space: nowrap")
_VALUE_STYLE = _CELL_STYLE.format("")
ERROR_DIGITS = 2
ERROR_HEADER = "error [-]"
_CAUSES = {
    "time": "by steps",
    "friction": "by friction speed",
    "mesh": "by elements",
    "theory": "by strains",
}
# Settings of runs that are shown in separate rows, or only in files.
_OTHER_SETTINGS = {"integrator", "amplitudes", "limited_by", "orders", "error_test_failures"}
# Columns of the case table of a study that the terminal and pages show, the most important ones
# first: label, unit and kind by header, of results and of the solver.
RESULT_COLUMNS = {
    "label": ("integrator", "", "text"),
    "error [-]": ("error", "-", "error"),
    "wall time [s]": ("wall time", "s", "cost"),
    "status": ("status", "", "status"),
    "wall time min [s]": ("wall min", "s", "number"),
    "wall time max [s]": ("wall max", "s", "number"),
    "events": ("events", "", "text"),
}
SOLVER_COLUMNS = {
    "steps": ("steps", "", "number"),
    "energy imbalance [-]": ("energy imbalance", "-", "number"),
    "max position drift": ("position drift", "", "number"),
    "rejected steps": ("rejected", "", "number"),
    "Jacobian calls": ("Jacobians", "", "number"),
    "residual calls": ("residuals", "", "number"),
    "max velocity drift": ("velocity drift", "", "number"),
    "reached [s]": ("reached", "s", "number"),
}


def shorten_to_cells(text: str, most: int) -> str:
    """Return the printable text, with its middle replaced by "…" if wider than `most` cells."""
    text = make_printable(text)
    if cell_len(text) <= most:
        return text
    head = set_cell_size(text, most // 2).rstrip()
    tail = set_cell_size(text[::-1], max(most - 1 - cell_len(head), 0)).rstrip()[::-1]
    return f"{head}…{tail}"


def _wrap_words(text: str, width: int) -> str:
    """Return the printable text with line breaks neither inside a unit nor before one."""
    joined = _UNIT_SPACE.sub("\N{NO-BREAK SPACE}", make_printable(text))
    lines = textwrap.wrap(joined, max(width, 1), break_on_hyphens=False)
    return "\n".join(lines).replace("\N{NO-BREAK SPACE}", " ")


def _break_header(header: str) -> str:
    """Return the header on the two lines that are narrowest."""
    breaks = [x.start() for x in _SPACE.finditer(header)]
    if len(header) < _MIN_BROKEN_HEADER or not breaks:
        return header
    k = min(breaks, key=lambda k: max(k, len(header) - k))
    return f"{header[:k]}\n{header[k + 1 :]}"


@dataclass(frozen=True)
class ResponsiveTable:
    """Table of texts whose layout adapts to the terminal width.

    The first column is always shown. Of the others, which contain numbers or sentences, those that
    do not fit are omitted from the right, and a line below the table names them.

    Attributes
    ----------
    headers, rows
        Texts of the headers and of the cells.
    source
        What shows omitted columns, such as a file.
    """

    headers: Sequence[str]
    rows: Sequence[Sequence[str]]
    source: str = ""

    @property
    def texts(self) -> list[list[str]]:
        """Table as lists of texts: the headers, followed by the rows."""
        return [list(map(make_printable, row)) for row in (self.headers, *self.rows)]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table and, if columns are omitted, a line with their names."""
        columns = list(zip(*self.texts, strict=True))
        folded = [k > 0 and any(" " in x for x in cells[1:]) for k, cells in enumerate(columns)]
        headers = [
            x if folds else _break_header(x) for (x, *_), folds in zip(columns, folded, strict=True)
        ]
        widths = [
            max(map(cell_len, [*header.split("\n"), *cells]))
            for header, (_, *cells) in zip(headers, columns, strict=True)
        ]
        widths[0] = max(widths[0], cell_len(columns[0][0]))
        least = [
            _COLUMN_GAP + (min(width, _MIN_SENTENCE_WIDTH) if folds else width)
            for width, folds in zip(widths, folded, strict=True)
        ]
        available = options.max_width - _ROW_MARGIN
        preferred = min(widths[0], max(_FIRST_COLUMN_WIDTH, options.max_width // 2))
        ends = accumulate(least[1:], initial=preferred)
        count = max(sum(end <= available for end in ends), min(2, len(columns)))
        first_width = max(_MIN_FIRST_COLUMN_WIDTH, min(widths[0], available - sum(least[1:count])))
        used = first_width + sum(_COLUMN_GAP + width for width in widths[1:count])
        is_wrapped = any(folded[:count]) and used > available
        padding = (0, 1, 0, 0)
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=padding, show_lines=is_wrapped)
        name = Text(shorten_to_cells(columns[0][0], first_width))
        table.add_column(name, no_wrap=True, width=first_width)
        for header, width, folds in list(zip(headers, widths, folded, strict=True))[1:count]:
            if folds:
                table.add_column(Text(header), overflow="fold")
            else:
                table.add_column(Text(header), justify="right", no_wrap=True, min_width=width)
        for label, *cells in zip(*(cells[1:] for cells in columns[:count]), strict=True):
            table.add_row(Text(shorten_to_cells(label, first_width)), *map(Text, cells))
        yield table
        if omitted := ", ".join(cells[0] for cells in columns[count:]):
            remedy = " or ".join(filter(None, ("a wider terminal", self.source)))
            yield Text(f"not shown: {omitted}; {remedy} shows them", style="dim")


@dataclass(frozen=True)
class FactList:
    """Two-column list of topics and texts whose layout adapts to the terminal width."""

    facts: Mapping[str, str]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        most = int(_MAX_TOPIC_SHARE * options.max_width)
        topics = [_wrap_words(topic, most) for topic in self.facts]
        used = max(map(cell_len, "\n".join(topics).split("\n"))) + _COLUMN_GAP
        table = Table(box=None, show_header=False, pad_edge=False)
        table.add_column(style="dim", no_wrap=True)
        table.add_column(overflow="fold")
        for topic, text in zip(topics, self.facts.values(), strict=True):
            table.add_row(Text(topic), Text(_wrap_words(text, options.max_width - used)))
        if self.facts:
            yield table


def format_number(value: Any, digits: int = 3) -> str:
    """Format a number with the given significant digits, and a missing value as "-".

    Strings, booleans and integers are not rounded.
    """
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, (bool, str)):
        return str(value)
    if isinstance(value, (int, np.integer)):
        return f"{value:d}"
    try:
        # The sum with 0 removes the sign of -0.
        return f"{float(value) + 0.0:.{digits}g}"
    except TypeError:  # Raised by missing values of pandas.
        return "-"


def table_of(
    rows: pd.DataFrame | Sequence[Mapping[str, Any]],
    source: str = "the CSV file",
    digits: int = 5,
) -> ResponsiveTable:
    """Return a table of a data frame, or of one or more rows by header.

    Columns that do not fit into the terminal are omitted from the right; `source` names what shows
    them.
    """
    records: Any = rows if isinstance(rows, Sequence) else rows.to_dict("records")
    headers = list(records[0]) if isinstance(rows, Sequence) else list(map(str, rows))
    answers = {True: "yes", False: "no"}
    texts = [
        [answers[x] if isinstance(x, bool) else format_number(x, digits) for x in row.values()]
        for row in records
    ]
    return ResponsiveTable(headers, texts, source)


def run_facts(solution: Solution) -> dict[str, str]:
    """Return texts about status, cost, accuracy and events of a run, by topic."""
    from beamdae.results.outcome import describe_events

    summary, settings, equations = solution.summary(), solution.integrator, solution.equations
    s = {name: format_number(value) for name, value in summary.items()}
    options = ", ".join(
        f"{name}={format_number(value)}"
        for name, value in settings.items()
        if value is not None and name not in _OTHER_SETTINGS
    )
    limits = ", ".join(f"{k} {100.0 * x:.0f} %" for k, x in settings.get("limited_by", {}).items())
    facts = {
        "status": str(s["reason"]),
        "time reached": f"{format_number(summary['last_time'], 6)} s",
        "integrator": f"{settings.get('integrator', '')} {options}",
        "steps": f"{s['steps']}, {s['rejected_steps']} rejected, {s['newton_failures']} Newton "
        "failures",
        "limited by": f"{limits} of the steps" if limits else "",
        "calls": f"{s['residual_calls']} residual, {s['jacobian_calls']} Jacobian, "
        f"{s['factorizations']} factorizations",
        "wall time": f"{s['wall_time']} s, and {s['setup_time']} s of set-up "
        "(equations, compilation)",
        "drift": f"{s['max_position_drift']} in positions, {s['max_velocity_drift']} in velocities",
        "residual": f"{s['max_residual']} of the largest force",
        "energy imbalance": f"{s['energy_imbalance']} of the energy exchanged",
        "events": describe_events(equations, solution.trajectory, solution.event_records)
        if equations.events
        else "",
    }
    return {topic: text for topic, text in facts.items() if text}


def summarize_as_html(solution: Solution) -> str:
    """Return the summary of a run as a self-contained HTML fragment."""
    name = solution.model.get("name", "")
    method = str(solution.integrator.get("integrator", ""))
    title = " by ".join(filter(None, (name, method))) or "run"
    facts = run_facts(solution)
    facts["observed"] = ", ".join(o.name for o in solution.equations.observables) or "nothing"
    facts |= {f"warning {k + 1}": sentence for k, sentence in enumerate(solution.warnings)}
    return f"<div><b>{html.escape(title)}</b>{format_html_table(facts)}</div>"


def format_html_table(facts: Mapping[str, str]) -> str:
    """Return an HTML table with a column of names and a column of values."""
    rows = "".join(
        f"<tr><td {_NAME_STYLE}>{html.escape(name)}</td>"
        f"<td {_VALUE_STYLE}>{html.escape(value)}</td></tr>"
        for name, value in facts.items()
    )
    return f"<table>{rows}</table>"


def range_rows(
    observed: Columns,
    errors: Errors | None = None,
    steps: Mapping[str, StepExtremes] | None = None,
) -> list[dict[str, Any]]:
    """Return a row per observed column: its last value, error, minimum, maximum, causes of errors.

    Causes without any error have no column.

    Parameters
    ----------
    observed
        Columns by header, without the time.
    errors
        Errors of the columns and of further values, which have a row as well.
    steps
        Extremes over all steps by header, for the minima and maxima.
    """
    extremes = column_extremes(observed, steps)
    values = () if errors is None else zip(errors.headers, errors.values.tolist(), strict=True)
    rows = extremes | {name: {"end": x} for name, x in values if name not in extremes}
    return [
        {
            "observed": name,
            "end": x["end"],
            **_errors_of(errors, name, {"total": ERROR_HEADER}),
            "min": x.get("min"),
            "max": x.get("max"),
            **_errors_of(errors, name, _CAUSES),
        }
        for name, x in rows.items()
    ]


def _errors_of(errors: Errors | None, name: str, headers: Mapping[str, str]) -> dict[str, str]:
    """Return the errors of a column by their headers in tables, "-" for one that has none."""
    if errors is None:
        return {}
    row = errors.headers.index(name) if name in errors.headers else None
    return {
        header: "-" if row is None else format_number(float(columns[row]), ERROR_DIGITS)
        for cause, header in headers.items()
        if (columns := errors.columns().get(cause)) is not None
        and (np.nan_to_num(columns).any() or (cause == "total" and not np.isnan(columns).all()))
    }


def column_extremes(
    observed: Columns, steps: Mapping[str, StepExtremes] | None = None
) -> dict[str, dict[str, float]]:
    """Return minimum, maximum and last value of each column, with rounding noise set to zero.

    Values are compared with the largest one of the same unit, or of the same column without a unit.
    """
    # Imports CasADi, which tables of models and examples do not need.
    from beamdae.results.columns import Header, largest_by

    extremes = {}
    for name in map(str, observed):
        values = np.asarray(observed[name], float)
        numbers = values[~np.isnan(values)]
        low, high = (f(numbers) if numbers.size else math.nan for f in (np.min, np.max))
        extremes[name] = {"min": float(low), "max": float(high), "end": float(values[-1])}
    kinds = {name: Header.of(name).kind for name in extremes}
    sizes = (max(abs(x["min"]), abs(x["max"])) for x in extremes.values())
    largest = largest_by(kinds.values(), (x if math.isfinite(x) else 0.0 for x in sizes))
    for name, entry in extremes.items():
        if steps and name in steps:
            entry["min"] = min(entry["min"], steps[name].min)
            entry["max"] = max(entry["max"], steps[name].max)
        limit = _ROUNDING * largest[kinds[name]]
        extremes[name] = {k: 0.0 if abs(x) < limit else x for k, x in entry.items()}
    return extremes


def comparison_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return the comparison table of a study; errors below the resolution are bounds."""
    columns = {name: x for name, x in (RESULT_COLUMNS | SOLVER_COLUMNS).items() if name in table}
    shown = table[list(columns)].astype(object)
    if "below resolution" in table:
        for k in table.index[table["below resolution"].fillna(False)]:
            shown.loc[k, "error [-]"] = f"< {format_number(table.loc[k, 'error bound [-]'])}"
    headers = {name: f"{x} [{unit}]" if unit else x for name, (x, unit, _) in columns.items()}
    return table_of(shown.rename(columns=headers), "cases.csv", digits=3)


def format_headers(units: Mapping[str, str]) -> dict[str, str]:
    """Return the names that have a unit with it, such as "speed [rad/s]", by name."""
    return {
        name: f"{name.removesuffix(f' [{unit}]')} [{unit}]"
        for name, unit in units.items()
        if unit not in ("", "-")
    }


def sweep_table(
    table: pd.DataFrame, parameters: Sequence[str], responses: Sequence[Sequence[str]]
) -> ResponsiveTable:
    """Return a table of the parameters, status and responses of each run of a sweep.

    Responses are columns, or several ones for the measures of an observed column. The measures that
    vary most are the first ones, and responses that are zero and constant parameters are the last
    ones. Rounding noise is shown as zero.
    """
    import pandas as pd

    groups = {name: k for k, columns in enumerate(responses) for name in columns}
    outputs = list(groups)
    numbers = pd.DataFrame({x: pd.to_numeric(table[x], "coerce") for x in outputs})
    sizes = numbers.abs()
    # Values without a unit are compared with those of the same response.
    units_of = {name: split_unit(name)[1] for name in outputs}
    kinds = {x: unit if unit not in ("", "-") else groups[x] for x, unit in units_of.items()}
    largest = sizes.max().groupby(kinds.__getitem__).max().to_dict()
    largest["rad"] = max(largest.get("rad", 0.0), 1.0)
    rounded = table.copy()
    for name in outputs:
        if pd.api.types.is_float_dtype(table[name]):
            is_noise = sizes[name] <= _ROUNDING * largest[kinds[name]]
            rounded[name] = table[name].where(~is_noise, 0.0)
    varied = [name for name in parameters if table[name].astype(str).nunique() > 1]
    nonzero = {groups[x] for x in outputs if rounded[x].astype(bool).any()}
    ranges = (numbers.max() - numbers.min()).groupby(groups.__getitem__)
    ranks = ranges.rank("first", ascending=False, na_option="bottom")
    ordered = sorted(outputs, key=lambda x: (groups[x] not in nonzero, ranks[x]))
    names = dict.fromkeys([*(varied or parameters), "status", *ordered, *parameters])
    return table_of(rounded[list(names)], "sweep.csv")


def failure_sentences(table: pd.DataFrame) -> list[str]:
    """Return one sentence per reason of the unsuccessful runs of a study, with its first run."""
    sentences = []
    for reason, rows in table[table["status"] != "ok"].groupby("reason", sort=False):
        others = f" and {format_count(len(rows) - 1, 'other')}" if len(rows) > 1 else ""
        label = f"{rows['group'].iloc[0]}, {rows['label'].iloc[0]}{others}"
        sentences.append(make_printable(f"{label}: {reason}"))
    return sentences
