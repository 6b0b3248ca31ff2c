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
from beamdae.results.outcome import accuracy_of

if TYPE_CHECKING:
    import pandas as pd

    from beamdae.accuracy.errors import Errors
    from beamdae.results.solution import Solution
    from beamdae.results.step_extremes import StepExtremes

    # A table by header.
    Columns = Mapping[str, Any] | pd.DataFrame

# Values below this fraction of the largest comparable value are shown as zero (rounding noise).
_ROUNDING = 1e-12
_MIN_RATE = 1e-3  # of decay or growth [1/s]; those of free motions are rounding errors
_SHOWN_HEADERS = {"total": "error", "rows": "error\nof rows"}

_SETTINGS_IN_FILES = ("orders", "error_test_failures")  # shown only in files
_SETTINGS_WITH_ROWS = ("integrator", "amplitudes", "limited_by")  # shown in separate rows

# From this number of adaptive steps between samples of a controller on, reports compare it with a
# number of fixed steps.
_MANY_STEPS_PER_SAMPLE, _FIXED_STEPS_PER_SAMPLE = 20, 10

# Columns of a comparison in the terminal.
_COMPARISON_COLUMNS = {
    "status": Column("status", 2),
    "wall time [s]": Column("wall\n[s]", 1),
    "wall time max [s]": Column("min to max\n[s]", 4),
    "events": Column("events", 10, sentences=True),
    "steps": Column("steps", 3),
    "rejected steps": Column("rejected", 7),
    "residual calls": Column("residual\ncalls", 8),
    "Jacobian calls": Column("Jacobian\ncalls", 6),
    "error [-]": Column("error\n[-]"),
    "measured error [-]": Column("measured\nerror [-]", 6),
    "max position drift": Column("position\ndrift", 5),
    "max velocity drift": Column("velocity\ndrift", 9),
    "energy imbalance [-]": Column("energy\nimbalance", 4),
}
_SUMMARY_COLUMNS = {
    "what": Column("what", 1, sentences=True),
    "at": Column("at", 3, sentences=True),
    "value": Column("value"),
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
    texts = {name: x if isinstance(x, str) else format_number(x) for name, x in rows.items()}
    return FactList(title, texts)


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
    left_out = {*_SETTINGS_WITH_ROWS, *_SETTINGS_IN_FILES}
    options = ", ".join(
        f"{name}={format_number(value)}"
        for name, value in settings.items()
        if value is not None and name not in left_out
    )
    facts = {
        "status": str(s["reason"]),
        "time reached": f"{format_number(summary['last_time'], 6)} s",
        "integrator": f"{settings.get('integrator', '')} {options}",
    }
    if amplitudes := settings.get("amplitudes", {}):
        sizes = ", ".join(f"{name} {format_number(value)}" for name, value in amplitudes.items())
        facts["amplitudes"] = f"{sizes} (relative to the size of the part, or in rad)"
    facts["steps"] = (
        f"{s['steps']}, {s['rejected_steps']} rejected, {s['newton_failures']} Newton failures"
    )
    if shares := settings.get("limited_by", {}):
        limits = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares.items())
        facts["limited by"] = f"{limits} of the steps"
    return facts | {
        "calls": f"{s['residual_calls']} residual, {s['jacobian_calls']} Jacobian, "
        f"{s['factorizations']} factorizations",
        "wall time": f"{s['wall_time']} s, and {s['setup_time']} s of set-up "
        "(equations, compilation)",
        "drift": f"{s['max_position_drift']} in positions, {s['max_velocity_drift']} in velocities",
        "residual": f"{s['max_residual']} of the largest force",
        "energy imbalance": f"{s['energy_imbalance']} of the energy exchanged",
    }


def further_facts(solution: Solution) -> dict[str, str]:
    """Return texts about a required accuracy and many steps between samples, by topic."""
    reached = accuracy_of(solution)
    facts = {} if reached is None else {"accuracy": reached.sentence}
    controllers = [x.controller for x in solution.equations.controllers]
    if not controllers or solution.integrator.get("rtol") is None:
        return facts
    fastest = min(controllers, key=lambda x: x.every)
    count = (solution.trajectory.end - solution.trajectory.start) / fastest.every
    ratio = solution.statistics.steps / max(count, 1.0)
    if ratio < _MANY_STEPS_PER_SAMPLE:
        return facts
    step = format_number(fastest.every / _FIXED_STEPS_PER_SAMPLE)
    return facts | {
        "steps per sample": f"{ratio:.0f} of {fastest.name}; GeneralizedAlpha(step={step}) takes "
        f"{_FIXED_STEPS_PER_SAMPLE}, without an error test"
    }


def errors_table(errors: Errors) -> ResponsiveTable:
    """Return a table of the values of a result, of its companion, and the errors by cause."""
    columns = [Column("value", 1), Column("refined", 2), Column("error\n[-]")]
    columns += [Column("by\nelements", 3), Column("by\nstrains", 4)]
    causes = (errors.causes[x] for x in ("mesh", "theory"))
    values = (errors.values, errors.companions, errors.total, *causes)
    rows = [
        (header, *(format_number(x, 4 if k < 2 else 2) for k, x in enumerate(row)))
        for header, row in zip(errors.headers, np.stack(values, axis=1).tolist(), strict=True)
    ]
    return ResponsiveTable("errors", columns, rows, "the JSON file")


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
    columns += [
        Column(
            _SHOWN_HEADERS.get(x, x),
            0 if x in always_shown else 4,
        )
        for x in names
    ]
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
    extremes = column_extremes(columns)
    table = {name: tuple(x.values()) for name, x in extremes.items()}
    headers, texts = [Column("min", 2), Column("max", 3), Column("end", 1)], {}
    if errors is not None:
        headers += [Column("error"), Column("by\nelements", 4), Column("by\nstrains", 5)]
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

    columns = {name: np.asarray(observed[name]) for name in map(str, observed)}
    ranges = {name: _smallest_and_largest(values) for name, values in columns.items()}
    kinds = {name: Header.of(name).kind for name in columns}
    sizes = (max(map(abs, x)) for x in ranges.values())
    sizes_of_kinds = largest_by(kinds.values(), (x if math.isfinite(x) else 0.0 for x in sizes))
    extremes = {}
    for name, values in columns.items():
        (smallest, largest), limit = ranges[name], _ROUNDING * sizes_of_kinds[kinds[name]]
        if steps and name in steps:
            smallest, largest = min(smallest, steps[name].min), max(largest, steps[name].max)
        numbers = {"min": smallest, "max": largest, "end": float(values[-1])}
        extremes[name] = {k: 0.0 if abs(x) < limit else x for k, x in numbers.items()}
    return extremes


def _smallest_and_largest(values: np.ndarray) -> tuple[float, float]:
    """Return minimum and maximum of the values, ignoring nan; nan if all values are nan."""
    numbers = values[~np.isnan(values)]
    return (float(numbers.min()), float(numbers.max())) if numbers.size else (math.nan, math.nan)


def comparison_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return the comparison table of a study.

    Errors below the resolution of the reference are shown as upper bounds.
    """
    names = [name for name in _COMPARISON_COLUMNS if name in table]
    rows = []
    for _, row in table.iterrows():
        cells = {name: format_number(row[name]) for name in names}
        if row.get("below resolution", False):
            cells["error [-]"] = f"< {format_number(row['error bound [-]'])}"
        if "wall time max [s]" in cells:
            cells["wall time max [s]"] = _format_range(
                row["wall time min [s]"], row["wall time max [s]"]
            )
        rows.append((str(row["label"]), *cells.values()))
    columns = [_COMPARISON_COLUMNS[name] for name in names]
    return ResponsiveTable("integrator", columns, rows, "cases.csv")


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
    names = [name for name in _SUMMARY_COLUMNS if name in texts and (texts[name] != "").any()]
    rows = [tuple(row) for row in texts[["answer", *names]].to_numpy()]
    return ResponsiveTable(
        "answer", [_SUMMARY_COLUMNS[name] for name in names], rows, "summary.csv"
    )


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

    magnitudes = pd.DataFrame({x: pd.to_numeric(table[x], "coerce").abs() for x in outputs})
    # Values without a unit are compared with those of the same column, which other measures share.
    kinds = {}
    for name in outputs:
        column, unit = split_unit(name)
        kinds[name] = unit if unit not in ("", "-") else column.rpartition(" ")[0] or column
    largest = {"rad": 1.0}
    for name, kind in kinds.items():
        largest[kind] = max(largest.get(kind, 0.0), float(magnitudes[name].max(skipna=True)))
    limits = {name: _ROUNDING * largest[kind] for name, kind in kinds.items()}
    never_shown: list[str] = []
    if shown := [x for x in outputs if (magnitudes[x] > limits[x]).any()]:
        if n_zeros := len(outputs) - len(shown):
            never_shown = [f"{format_count(n_zeros, 'column')} of zeros"]
        outputs = shown
    last = len(outputs) + 2
    varied = [name for name in parameters if table[name].astype(str).nunique() > 1]
    first, *others = [*varied, *(name for name in parameters if name not in varied)]
    headers = format_headers(units or {})
    columns = [
        Column(headers.get(x, x).replace(" [", "\n["), 0 if x in varied else last) for x in others
    ]
    columns.append(Column("status", last if (table["status"] == "ok").all() else 1))
    columns += [Column(name.replace(" [", "\n["), 2 + k) for k, name in enumerate(outputs)]
    names = [first, *others, "status", *outputs]

    def format_cell(name: str, value: Any) -> str:
        is_noise = isinstance(value, float) and abs(value) <= limits.get(name, 0.0)
        return format_number(0.0 if is_noise else value, 5)

    rows = [tuple(format_cell(name, row[name]) for name in names) for _, row in table.iterrows()]
    return ResponsiveTable(headers.get(first, first), columns, rows, "sweep.csv", never_shown)


def failure_sentences(table: pd.DataFrame) -> list[str]:
    """Return one sentence per unsuccessful run of a study."""
    failed_runs = table[table["status"] != "ok"]
    labels = failed_runs["group"] + ", " + failed_runs["label"]
    reasons = zip(labels, failed_runs["reason"], strict=True)
    return [make_printable(f"{label}: {reason}") for label, reason in reasons]


def _create_table(
    title: str,
    table: pd.DataFrame,
    first: str,
    columns: Mapping[str, tuple[Column, int]],
    source: str = "the CSV file",
) -> ResponsiveTable:
    """Return the column `first` of a table and others, given with their numbers of digits."""
    rows = [
        (
            str(row[first]),
            *(format_number(row[name], digits) for name, (_, digits) in columns.items()),
        )
        for row in table.to_dict("records")
    ]
    return ResponsiveTable(title, [column for column, _ in columns.values()], rows, source)


def buckling_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return a table of load factors and moving coordinates, given `Buckling.table()`."""
    columns = {
        "load factor [-]": (Column("load factor\n[-]"), 6),
        "moves most": (Column("moves most", 1, sentences=True), 0),
    }
    return _create_table("mode", table, "mode", columns)


def amplitudes_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return a table of observed columns, given `PeriodicMotion.amplitudes()`."""
    ranks = {"mean": 0, "half range": 0, "least": 1, "largest": 1}
    columns = {name: (Column(name, rank), 5) for name, rank in ranks.items()}
    indexed = table.rename_axis("observed").reset_index()
    return _create_table("observed", indexed, "observed", columns, "--json")


def peaks_table(parameter: str, label: str, peaks: pd.DataFrame) -> ResponsiveTable:
    """Return a table of the peaks of response curves, given `FrequencyResponse.peak_table()`."""
    columns = {
        parameter: (Column(label), 6),
        "half range": (Column("half\nrange"), 5),
        "largest magnitude": (Column("largest\nmagnitude"), 5),
    }
    return _create_table("peak of", peaks, "observed", columns, "--json")


def bode_table(peaks: pd.DataFrame) -> ResponsiveTable:
    """Return a table of the peaks of transfer functions, given `Bode.peak_table()`."""
    first, frequency, size, unit, phase = map(str, peaks)
    columns = {
        frequency: (Column("frequency\n[Hz]"), 6),
        size: (Column("magnitude"), 5),
        unit: (Column("unit"), 0),
        phase: (Column("phase\n[deg]", 1), 4),
    }
    return _create_table("peak of", peaks, first, columns)


def estimates_table(table: pd.DataFrame, units: Mapping[str, str] | None = None) -> ResponsiveTable:
    """Return a table of estimates and their 95 % intervals, given `Fit.table()` and units."""
    heads = ("value", "standard\ndeviation", "lower\n95 %", "upper\n95 %")
    columns = {
        str(name): (Column(head, k // 2), 2 if k == 1 else 5)
        for k, (name, head) in enumerate(zip(table, heads, strict=True))
    }
    named = table.rename(index=format_headers(units or {})).rename_axis("name").reset_index()
    return _create_table("estimate of", named, "name", columns)


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
    headers = format_headers(units)
    first = [name for name in units if f"first {name}" in table]
    last = [name for name in units if name in table]
    columns = [
        Column(goal),
        *(Column(headers.get(name, name), k) for k, name in enumerate(last)),
        *(Column(f"first\n{headers.get(name, name)}", len(last)) for name in first),
        Column(cost, 2 * len(units)),
        Column("end", 1, sentences=True),
    ]
    names = [goal, *last, *(f"first {name}" for name in first), "evaluations"]
    rows = [
        (str(k), *(format_number(row[name], 5) for name in names), str(row["reason"]))
        for k, (_, row) in enumerate(table.iterrows(), 1)
    ]
    return ResponsiveTable("search", columns, rows, "the file of the searches")


def modes_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return a table of frequencies, damping and moving parts, given `Modes.table()`."""
    masses = [name for name in map(str, table) if name.startswith("effective mass")]
    columns = {
        "frequency [Hz]": (Column("frequency\n[Hz]"), 6),
        "damping ratio [-]": (Column("damping\nratio [-]", 2), 3),
        "growth rate [1/s]": (Column("growth rate\n[1/s]", 3), 3),
        **{
            name: (Column(f"effective\nmass {axis} [kg]", rank), 3)
            for name, axis, rank in zip(masses, "xy", (4, 5), strict=True)
        },
        "kind": (Column("kind", 1, sentences=True), 0),
        "moves": (Column("moves", 1, sentences=True), 0),
    }
    return _create_table("mode", table, "mode", columns)


def campbell_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return a table of frequencies over the rotational speed, given `Campbell.table()`.

    Modes that decay or grow without oscillation have a word in place of the frequency.
    """
    frequencies = [name for name in map(str, table) if name.endswith("[Hz]")]
    columns = [
        Column("speed\n[rpm]"),
        *(Column(name.replace(" [", "\n["), k) for k, name in enumerate(frequencies)),
    ]

    def format_mode(row: Any, name: str) -> str:
        rate = row[name.replace("mode", "growth rate").replace("[Hz]", "[1/s]")]
        if row[name] == 0.0 and abs(rate) > _MIN_RATE:
            return "decay" if rate < 0.0 else "growth"
        return format_number(row[name], 5)

    rows = [
        (*_format_speed(row), *(format_mode(row, name) for name in frequencies))
        for _, row in table.iterrows()
    ]
    return ResponsiveTable("speed [rad/s]", columns, rows, "the CSV file")


def resonances_table(table: pd.DataFrame) -> ResponsiveTable:
    """Return a table of resonance speeds, given `Campbell.resonances()`."""
    rows = [
        (
            *_format_speed(row),
            format_number(row["frequency [Hz]"], 5),
            *(f"{row[name]:.0f}" for name in ("mode", "multiple")),
        )
        for _, row in table.iterrows()
    ]
    columns = [Column(x) for x in ("speed\n[rpm]", "frequency\n[Hz]", "mode", "multiple")]
    return ResponsiveTable("resonance [rad/s]", columns, rows, "the CSV file")


def _format_speed(row: Any) -> tuple[str, str]:
    """Return the rotation speed in rad/s and in rpm."""
    speed = row["speed [rad/s]"]
    return format_number(speed, 6), format_number(speed * 30.0 / math.pi, 6)


def parts_table(kinds: Mapping[str, str]) -> ResponsiveTable:
    """Return a table of the parts of a mechanism and their classes."""
    return ResponsiveTable("part", [Column("kind", sentences=True)], kinds.items())


def models_table(models: Iterable[Mapping[str, Any]]) -> ResponsiveTable:
    """Return a table of the models found in files, with their parameters."""
    columns = [
        Column("t_end\n[s]", 3),
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
