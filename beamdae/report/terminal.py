"""Tables for the terminal, from the tables of solutions and studies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from rich import box
from rich.table import Table

from beamdae.results.headers import Header
from beamdae.results.validity import BeamRange

# Values this small beside the largest in their unit are what rounding leaves of zero.
_ROUNDING = 1e-12

# Settings of a run that have rows of their own.
_TOLD_APART = ("integrator", "amplitudes")

# Header in the terminal by column of a comparison.
_COMPARED = {
    "status": "status",
    "wall time [s]": "wall\n[s]",
    "steps": "steps",
    "rejected steps": "rejected",
    "residual calls": "residual\ncalls",
    "Jacobian calls": "Jacobian\ncalls",
    "error [-]": "error\n[-]",
    "max position drift": "position\ndrift",
    "max velocity drift": "velocity\ndrift",
    "energy imbalance [-]": "energy\nimbalance",
}


def number(value: Any, digits: int = 3) -> str:
    """A number in few characters; a dash for one that is not there."""
    if value is None or value is pd.NA or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, (bool, str)):
        return str(value)
    if isinstance(value, (int, np.integer)):
        return f"{value:d}"
    return f"{float(value):.{digits}g}"


def facts(title: str, rows: Mapping[str, Any]) -> Table:
    """Two columns: what, and how much."""
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=None,
        show_header=False,
        pad_edge=False,
    )
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    for name, value in rows.items():
        table.add_row(name, value if isinstance(value, str) else number(value))
    return table


def run_facts(summary: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, str]:
    """What a run did and how well, from `Solution.summary()` and `Solution.integrator`."""
    s = {name: number(value) for name, value in summary.items()}
    shown = {k: v for k, v in settings.items() if v is not None and k not in _TOLD_APART}
    amplitudes = settings.get("amplitudes", {})
    moves = ", ".join(f"{name} {number(value)}" for name, value in amplitudes.items())
    scaled = {"amplitudes": f"{moves} (size of the part, or rad)"} if amplitudes else {}
    return {
        "status": str(s["reason"]),
        "time reached": f"{number(summary['last_time'], 6)} s",
        "integrator": f"{settings.get('integrator', '')} "
        + ", ".join(f"{name}={number(value)}" for name, value in shown.items()),
        **scaled,
        "steps": f"{s['steps']}, {s['rejected_steps']} rejected, "
        f"{s['newton_failures']} Newton failures",
        "calls": f"{s['residual_calls']} residual, {s['jacobian_calls']} Jacobian, "
        f"{s['factorizations']} factorizations",
        "wall time": f"{s['wall_time']} s, and {s['setup_time']} s to build",
        "drift": f"{s['max_position_drift']} in positions, {s['max_velocity_drift']} in velocities",
        "residual": f"{s['max_residual']} of the largest force",
        "energy imbalance": f"{s['energy_imbalance']} of the energy turned over",
    }


def validity(beams: Iterable[BeamRange]) -> Table:
    """How far each beam went from its floating frame, and what its strains make of it."""
    table = _table("beam", "deflection\nof length", "rotation\n[rad]", "strain\n[-]", "error\n[-]")
    for beam in beams:
        row = (beam.deflection, beam.rotation, beam.strain, beam.error)
        table.add_row(beam.name, *(number(value, 2) for value in row))
    return table


def ranges(observed: pd.DataFrame, errors: pd.DataFrame | None = None) -> Table:
    """Smallest, largest and last value of each observed column, and what is told of its error.

    `errors` has a row for each column, first its amplitude, then what is shown.
    """
    told = [] if errors is None else list(errors.columns[1:])
    table = _table("observed", "min", "max", "end", *(name.replace(" ", "\n", 1) for name in told))
    largest: dict[str, float] = {}
    for name in map(str, observed):
        size = float(observed[name].abs().max())
        if math.isfinite(size):
            kind = Header.of(name).kind
            largest[kind] = max(largest.get(kind, 0.0), size)
    for name in map(str, observed):
        values, rounding = observed[name], _ROUNDING * largest.get(Header.of(name).kind, 0.0)
        row = (float(x) for x in (values.min(), values.max(), values.iloc[-1]))
        said = [] if errors is None else [number(errors.loc[name, column], 2) for column in told]
        table.add_row(name, *(number(0.0 if abs(x) < rounding else x, 5) for x in row), *said)
    return table


def comparison_table(table: pd.DataFrame) -> Table:
    """The table of a study, with a mark on errors that the reference cannot resolve."""
    shown = [name for name in _COMPARED if name in table]
    result = _table("integrator", *(_COMPARED[name] for name in shown))
    for _, row in table.iterrows():
        cells = {name: number(row[name]) for name in shown}
        if row.get("below resolution", False):
            cells["error [-]"] = f"< {number(10.0 * row['reference uncertainty [-]'])}"
        result.add_row(row["label"], *cells.values())
    return result


def failures(table: pd.DataFrame) -> list[str]:
    """A sentence for each row of a study that did not reach its end."""
    failed = table[table["status"] != "ok"]
    where = failed["group"] + ", " + failed["label"]
    return [f"{i}: {s}" for i, s in zip(where, failed["reason"], strict=True)]


def listing(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """A table of texts, folded where they are long."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for header in headers:
        table.add_column(header, overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def _table(first: str, *headers: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column(first, overflow="fold")
    for header in headers:
        table.add_column(header, justify="right", no_wrap=True)
    return table
