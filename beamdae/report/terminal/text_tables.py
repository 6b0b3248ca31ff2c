"""Terminal tables and fact lists of solutions, studies, sweeps and models."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import format_count
from beamdae.model_parameters import format_with_unit, split_unit
from beamdae.report.terminal.responsive_table import Column, FactList, ResponsiveTable
from beamdae.report.text import make_printable

if TYPE_CHECKING:
    import pandas as pd

    from beamdae.accuracy.errors import Errors
    from beamdae.results.step_extremes import StepExtremes

    # A table by header.
    Columns = Mapping[str, Any] | pd.DataFrame

# Values below this fraction of the largest comparable value are shown as zero (rounding noise).
_ROUNDING = 1e-12
_MIN_RATE = 1e-3  # of decay or growth [1/s]; those of free motions are rounding errors
_SHOWN_HEADERS = {"total": "error", "rows": "error of rows"}
# Settings of runs that are shown in separate rows, or only in files.
_OTHER_SETTINGS = {"integrator", "amplitudes", "limited_by", "orders", "error_test_failures"}
# Ranks of the columns of a comparison, and their headers in the terminal.
_COMPARISON_COLUMNS = {
    "status": ("status", 2),
    "wall time [s]": ("wall [s]", 1),
    "wall time max [s]": ("min to max [s]", 4),
    "events": ("events", 10),
    "steps": ("steps", 3),
    "rejected steps": ("rejected", 7),
    "residual calls": ("residual calls", 8),
    "Jacobian calls": ("Jacobian calls", 6),
    "error [-]": ("error [-]", 0),
    "measured error [-]": ("measured error [-]", 6),
    "max position drift": ("position drift", 5),
    "max velocity drift": ("velocity drift", 9),
    "energy imbalance [-]": ("energy imbalance", 4),
}


def format_number(value: Any, digits: int = 3) -> str:
    """Format a number with the given significant digits, and a missing value as "-".

    Integers, booleans and strings are not rounded.
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


def fact_list(title: str, rows: Mapping[str, Any]) -> FactList:
    """Create a `FactList`, formatting values that are not strings."""
    return FactList(title, {name: format_number(x) for name, x in rows.items()})


def table_of(
    frame: pd.DataFrame,
    title: str = "",
    ranks: Mapping[str, int] | None = None,
    digits: Mapping[str, int] | None = None,
    source: str = "the CSV file",
) -> ResponsiveTable:
    """Return a table whose first column is the first one of a frame.

    Parameters
    ----------
    frame
        Numbers and texts; texts with spaces may be folded.
    title
        Header of the first column. Defaults to its name.
    ranks
        Columns of the largest rank are omitted first in narrow terminals. Defaults to 0 for never.
    digits
        Significant digits of numbers. Defaults to 5.
    source
        Source that contains the omitted columns.
    """
    first, *names = map(str, frame)
    digits = digits or {}
    rows = [
        tuple(format_number(x, digits.get(str(name), 5)) for name, x in row.items())
        for row in frame.to_dict("records")
    ]
    folded = [any(" " in row[k] for row in rows) for k in range(1, len(names) + 1)]
    columns = [Column(x, (ranks or {}).get(x, 0), y) for x, y in zip(names, folded, strict=True)]
    return ResponsiveTable(title or first, columns, rows, source)


def run_facts(summary: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, str]:
    """Return texts about status, cost and accuracy of a run, by topic.

    Parameters
    ----------
    summary
        Return value of `Solution.summary`.
    settings
        Settings of the integrator, `Solution.integrator`.
    """
    s = {name: format_number(value) for name, value in summary.items()}
    options = ", ".join(
        f"{name}={format_number(value)}"
        for name, value in settings.items()
        if value is not None and name not in _OTHER_SETTINGS
    )
    sizes = ", ".join(f"{k} {format_number(x)}" for k, x in settings.get("amplitudes", {}).items())
    limits = ", ".join(f"{k} {100.0 * x:.0f} %" for k, x in settings.get("limited_by", {}).items())
    facts = {
        "status": str(s["reason"]),
        "time reached": f"{format_number(summary['last_time'], 6)} s",
        "integrator": f"{settings.get('integrator', '')} {options}",
        "amplitudes": f"{sizes} (relative to the size of the part, or in rad)" if sizes else "",
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
    }
    return {topic: text for topic, text in facts.items() if text}


def range_table(
    observed: Columns,
    errors: Columns | None = None,
    steps: Mapping[str, StepExtremes] | None = None,
) -> ResponsiveTable:
    """Return a table of the minimum, maximum and last value of each observed column.

    Parameters
    ----------
    observed
        Observed columns.
    errors
        Additional columns with one row per observed column, in this order: amplitude (not shown),
        error, any further columns, verdict.
    steps
        Extremes at the steps of the run, which minimum and maximum include.
    """
    names = [] if errors is None else list(map(str, errors))[1:]
    columns = [Column("min", 2), Column("max", 3), Column("end", 1)]
    always_shown = (names[0], names[-1]) if names else ()
    columns += [Column(_SHOWN_HEADERS.get(x, x), 0 if x in always_shown else 4) for x in names]
    error_values = [] if errors is None else [np.asarray(errors[x]).tolist() for x in names]
    rows = [
        (
            name,
            *(format_number(x, 5) for x in extremes.values()),
            *(format_number(values[k], 2) for values in error_values),
        )
        for k, (name, extremes) in enumerate(column_extremes(observed, steps).items())
    ]
    return ResponsiveTable("observed", columns, rows, "--json")


def equilibrium_table(columns: Columns, errors: Errors | None) -> ResponsiveTable:
    """Return a table of the ranges of observed columns over a path, and of measured errors.

    Errors of the end belong to the columns; those of load factors and critical points follow.
    """
    table = {name: tuple(x.values()) for name, x in column_extremes(columns).items()}
    headers, texts = [Column("min", 2), Column("max", 3), Column("end", 1)], {}
    if errors is not None:
        headers += [Column("error"), Column("by elements", 4), Column("by strains", 5)]
        causes = np.stack([errors.total, errors.causes["mesh"], errors.causes["theory"]], axis=1)
        texts = dict(zip(errors.headers, causes.tolist(), strict=True))
        for name, value in zip(errors.headers, errors.values.tolist(), strict=True):
            table.setdefault(name, (math.nan, math.nan, value))
        table.pop("unstable directions [-]", None)
    rows = []
    for name, values in table.items():
        numbers = texts.get(name, [math.nan] * 3) if errors is not None else []
        cells = (format_number(x, 5) for x in values), (format_number(x, 2) for x in numbers)
        rows.append((name, *(cell for group in cells for cell in group)))
    return ResponsiveTable("observed", headers, rows, "--json")


def column_extremes(
    observed: Columns, steps: Mapping[str, StepExtremes] | None = None
) -> dict[str, dict[str, float]]:
    """Return minimum, maximum and last value of each column, with rounding noise set to zero.

    Minimum and maximum include the extremes at the steps, `steps`.
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
    """Return the comparison table of a study.

    Errors below the resolution of the reference are shown as upper bounds.
    """
    names = [name for name in _COMPARISON_COLUMNS if name in table]
    shown = table[["label", *names]].astype(object)
    if "below resolution" in table:
        for k in table.index[table["below resolution"].fillna(False)]:
            shown.loc[k, "error [-]"] = f"< {format_number(table.loc[k, 'error bound [-]'])}"
    if "wall time max [s]" in table:
        spans = table[["wall time min [s]", "wall time max [s]"]].to_numpy().tolist()
        shown["wall time max [s]"] = [_format_range(*x) for x in spans]
    ranks = dict(_COMPARISON_COLUMNS.values())
    headers = {name: _COMPARISON_COLUMNS[name][0] for name in names}
    digits = dict.fromkeys(headers.values(), 3)
    return table_of(shown.rename(columns=headers), "integrator", ranks, digits, "cases.csv")


def _format_range(least: Any, most: Any) -> str:
    low, high = format_number(least), format_number(most)
    return "-" if low == "-" else f"{low} to {high}"


def summary_table(summary: pd.DataFrame) -> ResponsiveTable:
    """Return the summary table of a study; values are followed by their units and any ranges."""
    ranges = (
        f" ({_format_range(*x)})".replace(" (-)", "") for x in summary[["min", "max"]].to_numpy()
    )
    values = summary["value"].map(format_number) + " " + summary["unit"] + list(ranges)
    texts = summary.assign(value=values.str.strip()).astype(str)
    ranks = {"what": 1, "at": 3, "value": 0}
    names = [name for name in ranks if name in texts and (texts[name] != "").any()]
    return table_of(texts[["answer", *names]], ranks=ranks, source="summary.csv")


def format_headers(units: Mapping[str, str]) -> dict[str, str]:
    """Return the names that have a unit with it, such as "speed [rad/s]", by name.

    Names that end with their unit, such as "offset of tip.y [m]", are unchanged.
    """
    return {
        name: f"{name.removesuffix(f' [{unit}]')} [{unit}]"
        for name, unit in units.items()
        if unit not in ("", "-")
    }


def sweep_table(
    table: pd.DataFrame,
    parameters: Sequence[str],
    outputs: Sequence[str],
    units: Mapping[str, str] | None = None,
) -> ResponsiveTable:
    """Return a table of the parameters, status and outputs of each run of a sweep.

    `units` contains the units of the parameters, by name. Outputs below 1e-12 of the largest one of
    the same unit are zero. Of several outputs, those that are zero in all runs are omitted and
    counted.
    """
    import pandas as pd

    sizes = pd.DataFrame({x: pd.to_numeric(table[x], "coerce").abs() for x in outputs})
    # Values without a unit are compared with those of the same column, which other measures share.
    kinds = {}
    for name in outputs:
        column, unit = split_unit(name)
        kinds[name] = unit if unit not in ("", "-") else column.rpartition(" ")[0] or column
    largest = sizes.max().groupby(kinds.__getitem__).max().to_dict()
    largest["rad"] = max(largest.get("rad", 0.0), 1.0)
    limits = {name: _ROUNDING * largest[kind] for name, kind in kinds.items()}
    never_shown: list[str] = []
    if shown := [x for x in outputs if (sizes[x] > limits[x]).any()]:
        if n_zeros := len(outputs) - len(shown):
            never_shown = [f"{format_count(n_zeros, 'column')} of zeros"]
        outputs = shown
    varied = [name for name in parameters if table[name].astype(str).nunique() > 1]
    names = [*varied, *(x for x in parameters if x not in varied), "status", *outputs]
    rounded = table[names].copy()
    for name in outputs:
        if len(limits) and pd.api.types.is_float_dtype(table[name]):
            rounded[name] = table[name].where(~(table[name].abs() <= limits[name]), 0.0)
    last = len(outputs) + 2
    ranks = {name: 2 + k for k, name in enumerate(outputs)}
    ranks |= {name: last for name in parameters if name not in varied}
    ranks["status"] = last if (table["status"] == "ok").all() else 1
    headers = format_headers(units or {})
    return table_of(
        rounded.rename(columns=headers),
        ranks={headers.get(name, name): rank for name, rank in ranks.items()},
        source="sweep.csv",
    ).omitting(never_shown)


def failure_sentences(table: pd.DataFrame) -> list[str]:
    """Return one sentence per unsuccessful run of a study."""
    failed_runs = table[table["status"] != "ok"]
    labels = failed_runs["group"] + ", " + failed_runs["label"]
    reasons = zip(labels, failed_runs["reason"], strict=True)
    return [make_printable(f"{label}: {reason}") for label, reason in reasons]


def buckling_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return a table of load factors and moving coordinates, given `Buckling.table()`."""
    shown = table[["mode", "load factor [-]", "moves most"]]
    return table_of(shown, ranks={"moves most": 1}, digits={"load factor [-]": 6})


def amplitudes_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return a table of observed columns, given `PeriodicMotion.amplitudes()`."""
    shown = table.drop(columns="unit").rename_axis("observed").reset_index()
    return table_of(shown, ranks={"least": 1, "largest": 1}, source="--json")


def peaks_table(parameter: str, label: str, peaks: pd.DataFrame) -> ResponsiveTable:
    """Return a table of the peaks of response curves, given `FrequencyResponse.peak_table()`."""
    shown = peaks.rename(columns={parameter: label})
    return table_of(shown, "peak of", digits={label: 6}, source="--json")


def bode_table(peaks: pd.DataFrame) -> ResponsiveTable:
    """Return a table of the peaks of transfer functions, given `Bode.peak_table()`."""
    _, frequency, _, _, phase = map(str, peaks)
    return table_of(peaks, "peak of", ranks={phase: 1}, digits={frequency: 6, phase: 4})


def estimates_table(table: pd.DataFrame, units: Mapping[str, str] | None = None) -> ResponsiveTable:
    """Return a table of estimates and their 95 % intervals, given `Fit.table()` and units."""
    named = table.rename(index=format_headers(units or {})).rename_axis("name").reset_index()
    _, _, deviation, lower, upper = map(str, named)
    return table_of(named, "estimate of", ranks={lower: 1, upper: 1}, digits={deviation: 2})


def searches_table(
    table: pd.DataFrame, units: Mapping[str, str], goal: str = "chi-square", cost: str = "runs"
) -> ResponsiveTable:
    """Return a table of the searches of a fit or an optimization.

    Parameters
    ----------
    table
        `Fit.starts` or `Optimization.starts`.
    units
        Units of the parameters by name.
    goal, cost
        Column with the minimized value, and header of the number of evaluations.
    """
    headers = format_headers(units) | {"evaluations": cost, "reason": "end"}
    first = [f"first {name}" for name in units if f"first {name}" in table]
    last = [name for name in units if name in table]
    shown = table[[goal, *last, *first, "evaluations", "reason"]].rename(columns=headers)
    shown.insert(0, "search", [str(k) for k in range(1, len(table) + 1)])
    ranks = {headers.get(name, name): k for k, name in enumerate(last)}
    ranks |= dict.fromkeys(first, len(last)) | {cost: 2 * len(units), "end": 1}
    return table_of(shown, ranks=ranks, source="the file of the searches")


def modes_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return a table of frequencies, damping and moving parts, given `Modes.table()`."""
    masses = [name for name in map(str, table) if name.startswith("effective mass")]
    ranks = {"damping ratio [-]": 2, "growth rate [1/s]": 3, "kind": 1, "moves": 1}
    ranks |= {name: 4 + k for k, name in enumerate(masses)}
    digits = dict.fromkeys(map(str, table), 3) | {"frequency [Hz]": 6}
    names = ["mode", "frequency [Hz]", "damping ratio [-]", "growth rate [1/s]", *masses]
    return table_of(table[[*names, "kind", "moves"]], ranks=ranks, digits=digits)


def campbell_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return a table of frequencies over the rotational speed, given `Campbell.table()`.

    Modes that decay or grow without oscillation have a word in place of the frequency.
    """
    frequencies = [name for name in map(str, table) if name.endswith("[Hz]")]
    shown = table[["speed [rad/s]", *frequencies]].astype(object)
    for name in frequencies:
        rate = table[name.replace("mode", "growth rate").replace("[Hz]", "[1/s]")]
        still = (table[name] == 0.0) & (rate.abs() > _MIN_RATE)
        shown.loc[still, name] = np.where(rate[still] < 0.0, "decay", "growth")
    ranks = {name: k for k, name in enumerate(frequencies)}
    return table_of(_insert_rpm(shown), ranks=ranks, digits=_SPEED_DIGITS)


_SPEED_DIGITS = {"speed [rad/s]": 6, "speed [rpm]": 6}


def _insert_rpm(table: pd.DataFrame) -> pd.DataFrame:
    table = table.copy()
    table.insert(1, "speed [rpm]", table["speed [rad/s]"] * 30.0 / math.pi)
    return table


def resonances_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return a table of resonance speeds, given `Campbell.resonances()`."""
    names = ["speed [rad/s]", "frequency [Hz]", "mode", "multiple"]
    shown = table[names].astype({"mode": int, "multiple": int})
    return table_of(_insert_rpm(shown), "resonance [rad/s]", digits=_SPEED_DIGITS)


def parts_table(kinds: Mapping[str, str]) -> ResponsiveTable:
    """Return a table of the parts of a mechanism and their classes."""
    return ResponsiveTable("part", [Column("kind", sentences=True)], kinds.items())


def models_table(models: Iterable[Mapping[str, Any]]) -> ResponsiveTable:
    """Return a table of the models found in files, with their parameters."""
    columns = [
        Column("t_end [s]", 3),
        Column("file", 1, sentences=True),
        Column("parameters", 2, sentences=True),
        Column("about", 4, sentences=True),
    ]
    rows = []
    for model in models:
        parameters = ", ".join(
            f"{name}={format_with_unit(value, model['units'].get(name, ''))}"
            for name, value in model["parameters"].items()
        )
        file, t_end = Path(model["file"]).name, model["t_end"]
        rows.append((model["name"], format_number(t_end), file, parameters, model["about"]))
    return ResponsiveTable("model", columns, rows, "--json")


def parameters_table(model: Mapping[str, Any]) -> ResponsiveTable:
    """Return a table of the parameters of a model, with their units and descriptions."""
    columns = [Column("default"), Column("unit", 1), Column("description", 2, sentences=True)]
    texts = (model["units"], model["descriptions"])
    rows = [
        (name, format_with_unit(value, ""), *(by_name.get(name, "") for by_name in texts))
        for name, value in model["parameters"].items()
    ]
    return ResponsiveTable(str(model["name"]), columns, rows, "--json")


def studies_table(studies: Iterable[Mapping[str, Any]]) -> ResponsiveTable:
    """Return a table of the studies found in files."""
    rows = [(x["name"], Path(x["file"]).name) for x in studies]
    return ResponsiveTable("study", [Column("file", sentences=True)], rows, "--json")


def problems_table(problems: Iterable[Mapping[str, Any]]) -> ResponsiveTable:
    """Return a table of the files that cannot be listed, with their errors."""
    rows = [(Path(x["file"]).name, x["problem"]) for x in problems]
    return ResponsiveTable("file", [Column("cannot be listed", sentences=True)], rows)
