"""Content of HTML pages as plain data and arrays, which `page_file.write_page` writes.

A page with one case and without columns is the page of a run: it has no case table. The order of
every page is motion, curves, results, error budget, solver. All entries but `id`, `group` of a case
and those of columns are optional. A page contains

- `title`, `subtitle`, `notes`, and `made`, versions by package name.
- `noun`: name of the cases, such as "modes".
- `groups` of cases that are compared with each other: `id`, `label`, `frames` (an animation, see
  `scene.run_scene.export_frames`) and `reference` (None, or `accepted`, `sentence` and
  `uncertainty`, the smallest error that it resolves).
- `columns` of the case table: `key`, `label`, `unit` and `kind` ("text", "number", "status", or
  "error" and "cost" for these entries of the cases). Those of the `section` "solver" are hidden at
  first.
- `cases`, the runs, designs, modes or points: `id`, `group`, `label`, `family` (determines color,
  marker and legend), `series` (cases of the same series are connected by a line, in the order of
  their `rank`), `status` ("ok" or a sentence), `values` by key of the column, `error`, `cost` [s],
  `below` (the error is below the resolution of the reference), `limited`, `dashed` (lines to the
  case are dashed), `at` (index of its value for each slider), `frames`, `curves` (see
  `select_curves`: arrays `t` and, by panel and name, `observed`, `energy`, `error`,
  `drift`, or `magnitude` and `phase` over frequencies), `points` (measured data, drawn as points)
  and `file` (with its rows).
- `axes`: keys of the columns `x` and `y` of the scatter plot; None for no scatter plot. `overlays`
  have `lines` and `marks` for a pair of axes, each with `label`, `x` and `y`. `views` are the
  ranges that charts show first, by key of the chart and axis; the button "Reset" shows all. If
  `leads` is true, the scatter plot is the main result, shown first beside the motion.
- `families` that have the first colors, also if some do not occur; `sequential` if families follow
  a parameter, so that their colors form a sequence.
- `sliders` of swept parameters: `label`, `unit` and `values`. They select the motion of the nearest
  case with `frames`.
- `time`: `name` and `unit` of the quantity in the place of the time, `log` for a logarithmic axis.
- `portrait`: columns `x` and `y` of a chart of one over the other, and `marks`: `t` and `label`.
- `featured`: observed columns that are listed first; by default those that characterize the motion.
- `tables` of facts: `title`, `head`, `rows` and `section` ("results", "motion", "errors" or
  "solver").
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations.measures import DRIFT_COLUMNS, LEDGER_COLUMNS, TIME
from beamdae.report.tables import table_of
from beamdae.report.text import format_json
from beamdae.results.columns import Header, observed_columns
from beamdae.results.storage.files import versions

if TYPE_CHECKING:
    import pandas as pd

    from beamdae.report.descriptions import Description

Content = dict[str, Any]
Array = np.ndarray

_MAX_PAGE_VALUES = 400_000  # in all curves; about 2.1 MB
_MIN_ROWS_PER_CURVE = 200
_MAX_ROWS_PER_CURVE = 2000
_GRAVITY, _GRAVITY_LABEL = "gravity", "gravity from start"
GROUP = "all"  # id of the only group of cases
_NUMBERS = "iuf"  # kinds of NumPy's types of numbers


def compute_row_limit(curves: int) -> int:
    """Return the maximum number of rows per curve for a page with the given number of curves."""
    rows = _MAX_PAGE_VALUES // max(curves, 1)
    return int(np.clip(rows, _MIN_ROWS_PER_CURVE, _MAX_ROWS_PER_CURVE))


def sample_evenly(count: int, limit: int) -> set[int]:
    """Return at most `limit` of the numbers below `count`, the first and the last included."""
    return set(np.linspace(0, count - 1, min(count, limit)).round().astype(int).tolist())


def select_curves(
    columns: Mapping[str, Any], max_rows: int, error: Array | None = None
) -> dict[str, Any] | None:
    """Return the curves of a run for the cases of a page.

    Parameters
    ----------
    columns
        Time, observed columns, energies and drift by header, one value per row.
    max_rows
        Longer tables are thinned evenly to this number of rows.
    error
        Error [-] at each row; NaN where the error is unknown.

    Returns
    -------
    dict or None
        Curves by panel, see the module. None if the table has fewer than two rows.
    """
    t = np.asarray(columns[TIME], float)
    if len(t) < 2:
        return None
    rows = np.linspace(0, len(t) - 1, min(len(t), max_rows)).round().astype(int)

    def select(names: Iterable[str]) -> dict[str, Array]:
        return {n: np.asarray(columns[n], float)[rows] for n in names if n in columns}

    energies = {
        Header.of(c).suffix.replace("_", " "): x
        for c, x in select(LEDGER_COLUMNS).items()
        if np.ptp(x) > 0.0
    }
    if _GRAVITY in energies:
        # The potential of all masses, relative to y = 0, often far exceeds its changes.
        potential = energies.pop(_GRAVITY)
        energies[_GRAVITY_LABEL] = potential - potential[0]
    if "imbalance" in energies:
        energies["imbalance"] = np.abs(energies.pop("imbalance"))
    drift = dict(
        zip(("position drift", "velocity drift"), select(DRIFT_COLUMNS).values(), strict=False)
    )
    return {
        "t": t[rows],
        "observed": select(observed_columns(columns)),
        "energy": energies,
        "drift": {name: x for name, x in drift.items() if x.any()},
        "error": {} if error is None else {"error": np.asarray(error, float)[rows]},
    }


def encode(data: Any) -> str:
    """Return plain values and arrays as JSON text for the scripts of pages.

    Arrays are stored as 32-bit numbers in an object without a name. Numbers that are not finite
    are missing.
    """
    return format_json(data, _encode_array, separators=(",", ":"))


def _encode_array(values: Any) -> Any:
    if not isinstance(values, np.ndarray):
        return values.item()
    with np.errstate(over="ignore"):
        numbers = values.astype("<f4").ravel()
    return {"": base64.b64encode(numbers.tobytes()).decode()}


def describe_page(
    title: str,
    subtitle: str,
    warnings: Sequence[str],
    tables: Sequence[Content] = (),
    **entries: Any,
) -> Content:
    """Return a page with one group, without tables that have no rows."""
    return {
        "title": title,
        "subtitle": subtitle,
        "made": versions(),
        "notes": list(warnings),
        "groups": [{"id": GROUP}],
        "tables": [table for table in tables if table["rows"]],
        **entries,
    }


def describe_columns(
    label: str, table: pd.DataFrame, units: Mapping[str, str] | None = None
) -> list[Content]:
    """Return the columns of the cases, whose label has the header `label`."""
    columns: list[Content] = [{"key": "label", "label": label, "unit": "", "kind": "text"}]
    for name in map(str, table):
        unit = (units or {}).get(name, Header.of(name).unit)
        kind = "number" if table[name].dtype.kind in _NUMBERS else "text"
        header = name.removesuffix(f" [{unit}]")
        columns.append({"key": name, "label": header, "unit": unit, "kind": kind})
    return columns


def create_cases(
    table: pd.DataFrame, labels: Sequence[str], *entries: Mapping[str, Any], **common: Any
) -> list[Content]:
    """Return a case for each row of a table, with further entries of each or common to all."""
    rows = table.replace({np.nan: None}).to_dict("records")
    further: Sequence[Mapping[str, Any]] = entries or [{}] * len(rows)
    return [
        {"id": str(k), "group": GROUP, "label": label, "rank": k, "values": row, **common, **entry}
        for k, (label, row, entry) in enumerate(zip(labels, rows, further, strict=True))
    ]


def fact_table(title: str, facts: Mapping[str, Any], section: str = "results") -> Content:
    """Return a table of facts by topic, without those that have no text."""
    texts = {
        topic: ", ".join(map(str, x)) if isinstance(x, (list, tuple)) else x
        for topic, x in facts.items()
    }
    rows = [[topic, str(text)] for topic, text in texts.items() if text not in ("", None)]
    return {"title": title, "rows": rows, "section": section}


def export_table(title: str, rows: Any) -> Content:
    """Return a data frame, or rows by header, as a table of the page."""
    if not len(rows):
        return {"title": title, "head": [], "rows": [], "section": "results"}
    head, *texts = table_of(rows).texts
    return {"title": title, "head": head, "rows": texts, "section": "results"}


def export_tables(description: Description) -> list[Content]:
    """Return the tables of a description as tables of the page."""
    return [export_table(title, table) for title, table in description.tables.items()]


def slider(label: str, values: Sequence[Any], unit: str = "") -> dict[str, Any]:
    """Return a slider of a page."""
    return {"label": label, "unit": unit, "values": list(values)}
