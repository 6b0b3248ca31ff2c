"""Tables for the terminal, from the tables of solutions and studies."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.report.terminal.responsive_table import Column, FactList, ResponsiveTable
from beamdae.report.text import make_printable
from beamdae.results.columns import Header
from beamdae.results.diagnostics.strain_validity import BeamRange

if TYPE_CHECKING:
    import pandas as pd

    # By header.
    Columns = Mapping[str, Any] | pd.DataFrame

# Values this small beside the largest in their unit are what rounding leaves of zero.
_ROUNDING = 1e-12

# Letters of a line of a header.
_HEADER = 12

# Settings of a run that only files tell, and those that have rows of their own.
_IN_FILES = ("orders", "error_test_failures")
_TOLD_APART = ("integrator", "amplitudes", "limited_by", *_IN_FILES)

# What the terminal shows of a column of a comparison; the least of it goes first.
_COMPARED = {
    "status": Column("status", 2),
    "wall time [s]": Column("wall\n[s]", 1),
    "wall time max [s]": Column("min to max\n[s]", 4),
    "events": Column("events", 10, sentences=True),
    "steps": Column("steps", 3),
    "rejected steps": Column("rejected", 7),
    "residual calls": Column("residual\ncalls", 8),
    "Jacobian calls": Column("Jacobian\ncalls", 6),
    "error [-]": Column("error\n[-]"),
    "max position drift": Column("position\ndrift", 5),
    "max velocity drift": Column("velocity\ndrift", 9),
    "energy imbalance [-]": Column("energy\nimbalance", 4),
}
_SUMMARIZED = {
    "what": Column("what", 1, sentences=True),
    "at": Column("at", 3, sentences=True),
    "value": Column("value"),
    "as fast": Column("as fast", 4, sentences=True),
}


def format_number(value: Any, digits: int = 3) -> str:
    """A number in few characters; a dash for one that is not there."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, (bool, str)):
        return str(value)
    if isinstance(value, (int, np.integer)):
        return f"{value:d}"
    try:
        return f"{float(value):.{digits}g}"
    except TypeError:  # That of pandas for what is not there.
        return "-"


def fact_list(title: str, rows: Mapping[str, Any]) -> FactList:
    """Two columns: what, and how much."""
    said = {name: x if isinstance(x, str) else format_number(x) for name, x in rows.items()}
    return FactList(title, said)


def run_facts(summary: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, str]:
    """What a run did and how well, from `Solution.summary()` and `Solution.integrator`."""
    s = {name: format_number(value) for name, value in summary.items()}
    shown = {k: v for k, v in settings.items() if v is not None and k not in _TOLD_APART}
    amplitudes = settings.get("amplitudes", {})
    moves = ", ".join(f"{name} {format_number(value)}" for name, value in amplitudes.items())
    scaled = {"amplitudes": f"{moves} (size of the part, or rad)"} if amplitudes else {}
    shares = settings.get("limited_by", {})
    limits = ", ".join(f"{name} {share:.0%}" for name, share in shares.items())
    return {
        "status": str(s["reason"]),
        "time reached": f"{format_number(summary['last_time'], 6)} s",
        "integrator": f"{settings.get('integrator', '')} "
        + ", ".join(f"{name}={format_number(value)}" for name, value in shown.items()),
        **scaled,
        "steps": f"{s['steps']}, {s['rejected_steps']} rejected, "
        f"{s['newton_failures']} Newton failures",
        **({"limited by": f"{limits} of the steps"} if limits else {}),
        "calls": f"{s['residual_calls']} residual, {s['jacobian_calls']} Jacobian, "
        f"{s['factorizations']} factorizations",
        "wall time": f"{s['wall_time']} s, and {s['setup_time']} s to build",
        "drift": f"{s['max_position_drift']} in positions, {s['max_velocity_drift']} in velocities",
        "residual": f"{s['max_residual']} of the largest force",
        "energy imbalance": f"{s['energy_imbalance']} of the energy turned over",
    }


def validity_table(beams: Iterable[BeamRange]) -> ResponsiveTable:
    """How far each beam went from its floating frame, and what its strains make of it."""
    columns = [
        Column("deflection\nof length", 2),
        Column("rotation\n[rad]", 3),
        Column("strain\n[-]", 1),
        Column("error\n[-]"),
    ]
    rows = [
        (x.name, *(format_number(v, 2) for v in (x.deflection, x.rotation, x.strain, x.error)))
        for x in beams
    ]
    return ResponsiveTable("beam", columns, rows, "the JSON file")


def range_table(observed: Columns, errors: Columns | None = None) -> ResponsiveTable:
    """Smallest, largest and last value of each observed column, and what is told of its error.

    `errors` has a row for each column, in their order: first its amplitude, then what is shown.
    """
    told = [] if errors is None else list(map(str, errors))[1:]
    columns = [Column("min", 2), Column("max", 3), Column("end", 1)]
    # The first of what is told is the error, the last the verdict.
    kept = (told[0], told[-1]) if told else ()
    columns += [Column(textwrap.fill(x, _HEADER), 0 if x in kept else 4) for x in told]
    values_told = [] if errors is None else [np.asarray(errors[x]).tolist() for x in told]
    rows = [
        (
            name,
            *(format_number(x, 5) for x in values.values()),
            *(format_number(known[k], 2) for known in values_told),
        )
        for k, (name, values) in enumerate(column_extremes(observed).items())
    ]
    return ResponsiveTable("observed", columns, rows, "--json")


def column_extremes(observed: Columns) -> dict[str, dict[str, float]]:
    """Smallest, largest and last value of each column; what rounding leaves of zero is zero."""
    rounding = _rounding(observed)
    found = {}
    for name in map(str, observed):
        values, least = np.asarray(observed[name]), rounding[Header.of(name).kind]
        smallest, largest = _extremes(values)
        known = {"min": smallest, "max": largest, "end": float(values[-1])}
        found[name] = {k: 0.0 if abs(x) < least else x for k, x in known.items()}
    return found


def _extremes(values: np.ndarray) -> tuple[float, float]:
    """The smallest and the largest that is a number, if there is one."""
    known = values[~np.isnan(values)]
    return (float(known.min()), float(known.max())) if known.size else (math.nan, math.nan)


def _rounding(observed: Columns) -> dict[str, float]:
    """By kind of a column: what is rounding beside the largest value of that kind."""
    largest: dict[str, float] = {}
    for name in map(str, observed):
        kind, size = Header.of(name).kind, max(map(abs, _extremes(np.asarray(observed[name]))))
        largest[kind] = max(largest.get(kind, 0.0), size if math.isfinite(size) else 0.0)
    return {kind: _ROUNDING * size for kind, size in largest.items()}


def comparison_table(table: pd.DataFrame) -> ResponsiveTable:
    """The table of a study, with a mark on errors that the reference cannot resolve."""
    shown = [name for name in _COMPARED if name in table]
    rows = []
    for _, row in table.iterrows():
        cells = {name: format_number(row[name]) for name in shown}
        if row.get("below resolution", False):
            cells["error [-]"] = f"< {format_number(10.0 * row['reference uncertainty [-]'])}"
        if "wall time max [s]" in cells:
            cells["wall time max [s]"] = _ends(row["wall time min [s]"], row["wall time max [s]"])
        rows.append((str(row["label"]), *cells.values()))
    return ResponsiveTable("integrator", [_COMPARED[name] for name in shown], rows, "cases.csv")


def _ends(least: Any, most: Any) -> str:
    """The ends of repeated timings."""
    return (
        "-" if format_number(least) == "-" else f"{format_number(least)} to {format_number(most)}"
    )


def summary_table(summary: pd.DataFrame) -> ResponsiveTable:
    """What the rows of a group come to."""
    ends = (f" ({_ends(*x)})".replace(" (-)", "") for x in summary[["min", "max"]].to_numpy())
    values = summary["value"].map(format_number) + " " + summary["unit"] + list(ends)
    told = summary.assign(value=values.str.strip()).astype(str)
    shown = [name for name in _SUMMARIZED if name in told and (told[name] != "").any()]
    rows = [tuple(row) for row in told[["answer", *shown]].to_numpy()]
    return ResponsiveTable("answer", [_SUMMARIZED[name] for name in shown], rows, "summary.csv")


def sweep_table(
    table: pd.DataFrame, parameters: Sequence[str], told: Sequence[str]
) -> ResponsiveTable:
    """The table of a sweep: parameters, how each run ended, what is told of it."""
    last = len(told) + 2
    varied = [name for name in parameters if table[name].astype(str).nunique() > 1]
    first, *others = [*varied, *(name for name in parameters if name not in varied)]
    columns = [Column(name, 0 if name in varied else last) for name in others]
    columns.append(Column("status", last if (table["status"] == "ok").all() else 1))
    columns += [Column(name.replace(" [", "\n["), 2 + k) for k, name in enumerate(told)]
    names = [first, *others, "status", *told]
    rows = [tuple(format_number(row[name], 5) for name in names) for _, row in table.iterrows()]
    return ResponsiveTable(first, columns, rows, "sweep.csv")


def failure_sentences(table: pd.DataFrame) -> list[str]:
    """A sentence for each row of a study that did not reach its end."""
    failed = table[table["status"] != "ok"]
    where = failed["group"] + ", " + failed["label"]
    return [make_printable(f"{i}: {s}") for i, s in zip(where, failed["reason"], strict=True)]


def modes_table(table: pd.DataFrame) -> ResponsiveTable:
    """Frequencies of modes, and what moves in them, from `Modes.table()`."""
    columns = [
        Column("frequency\n[Hz]"),
        Column("damping\nratio [-]", 2),
        Column("growth rate\n[1/s]", 3),
        Column("effective\nmass x [kg]", 4),
        Column("effective\nmass y [kg]", 5),
        Column("kind", 1, sentences=True),
        Column("moves", 1, sentences=True),
    ]
    values = ["frequency [Hz]", "damping ratio [-]", "growth rate [1/s]"]
    values += [name for name in map(str, table) if name.startswith("effective mass")]
    rows = [
        (
            str(row["mode"]),
            format_number(row[values[0]], 6),
            *(format_number(row[name]) for name in values[1:]),
            str(row["kind"]),
            str(row["moves"]),
        )
        for _, row in table.iterrows()
    ]
    return ResponsiveTable("mode", columns, rows, "the CSV file")


def campbell_table(table: pd.DataFrame) -> ResponsiveTable:
    """Frequencies of modes by speed, from `Campbell.table()`."""
    frequencies = [name for name in map(str, table) if name.endswith("[Hz]")]
    columns = [Column(name.replace(" [", "\n["), k) for k, name in enumerate(frequencies)]
    rows = [
        (
            format_number(row["speed [rad/s]"]),
            *(format_number(row[name], 5) for name in frequencies),
        )
        for _, row in table.iterrows()
    ]
    return ResponsiveTable("speed [rad/s]", columns, rows, "the CSV file")


def parts_table(kinds: Mapping[str, str]) -> ResponsiveTable:
    """The parts of a mechanism and what they are."""
    return ResponsiveTable("part", [Column("kind", sentences=True)], kinds.items())


def models_table(found: Iterable[Mapping[str, Any]]) -> ResponsiveTable:
    """Models that files define, with their parameters."""
    columns = [
        Column("t_end\n[s]", 3),
        Column("file", 1, sentences=True),
        Column("parameters", 2, sentences=True),
        Column("about", 4, sentences=True),
    ]
    rows = []
    for one in found:
        values = ", ".join(f"{name}={value}" for name, value in one["parameters"].items())
        rows.append(
            (one["name"], f"{one['t_end']:g}", Path(one["file"]).name, values, one["about"])
        )
    return ResponsiveTable("model", columns, rows, "--json")


def studies_table(found: Iterable[Mapping[str, Any]]) -> ResponsiveTable:
    """Studies that files define, with the models they are of."""
    columns = [Column("cases"), Column("file", 1, sentences=True), Column("of", 2, sentences=True)]
    rows = [
        (x["name"], str(x["cases"]), Path(x["file"]).name, ", ".join(x["models"])) for x in found
    ]
    return ResponsiveTable("study", columns, rows, "--json")


def problems_table(found: Iterable[Mapping[str, Any]]) -> ResponsiveTable:
    """Files and what is wrong with them."""
    rows = [(Path(one["file"]).name, one["problem"]) for one in found]
    return ResponsiveTable("file", [Column("cannot be listed", sentences=True)], rows)
