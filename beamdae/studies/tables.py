"""The tables of a study: a row a case, and what they come to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from beamdae.studies.case import Case, text_of
from beamdae.studies.deviations import deviations, reactions
from beamdae.studies.event_columns import event_errors, is_count, misfit
from beamdae.studies.references import RESOLUTION, Reference
from beamdae.studies.told import COUNTS, MEASURES
from beamdae.studies.work import Outcome

LEVELS = (1e-2, 1e-3, 1e-4, 1e-5)
ERROR, COST = "error [-]", "wall time [s]"
# What integrators are refined by, a column each.
REFINED = ("rtol", "step")
_PARAMETER = "parameter: "


def row(case: Case, group: str, outcome: Outcome, reference: Reference | None) -> dict[str, Any]:
    """The row of a case: what it was, what it cost, how well it did."""
    accuracy = case.integrator.accuracy
    values: dict[str, Any] = {
        "model": case.model.name,
        **{_PARAMETER + name: _cell(value) for name, value in case.parameters.items()},
        "group": group,
        "integrator": case.integrator.method,
        "label": case.label,
        "series": case.series,
        "settings": ", ".join(f"{k}={v}" for k, v in case.changed.items()),
        **{name: accuracy.value if accuracy.name == name else np.nan for name in REFINED},
        "status": outcome.status.kind,
        "reason": "" if outcome.status.success else outcome.status.sentence,
        "reached [s]": np.nan,
        **dict.fromkeys(COUNTS),
        **dict.fromkeys(MEASURES, np.nan),
        **outcome.values,
    }
    return values if reference is None else values | _errors(outcome, reference)


def _errors(outcome: Outcome, reference: Reference) -> dict[str, Any]:
    """Largest error of all columns, of each and of the reactions, relative to amplitudes."""
    columns: dict[str, Any] = dict.fromkeys(
        [ERROR, "below resolution", "reaction error [-]"], np.nan
    )
    columns["below resolution"] = False
    columns["reference uncertainty [-]"] = reference.uncertainty
    # A run that took no step has its start to show, which is no error.
    if reference.table is None or outcome.table is None or not outcome.values.get("steps"):
        return columns
    error = deviations(outcome.table, reference.table, reference.columns)
    columns[ERROR] = float(error.to_numpy().max())
    complete = outcome.status.success
    columns["below resolution"] = bool(complete and columns[ERROR] < reference.resolves)
    forces = reactions(reference.table)
    if forces:
        of_forces = deviations(outcome.table, reference.table, forces)
        columns["reaction error [-]"] = float(of_forces.to_numpy().max())
    for name in reference.columns:
        columns[f"error of {name}, end"] = float(error[name].iloc[-1]) if complete else np.nan
        columns[f"error of {name}, max"] = float(error[name].max())
        columns[f"error of {name}, rms"] = float(np.sqrt(np.mean(error[name] ** 2)))
    columns |= event_errors(outcome.values, reference.events)
    if complete and (others := misfit(outcome.values, reference.events)):
        columns["warnings"] = " ".join(filter(None, [outcome.values["warnings"], others]))
    return columns


def _cell(value: Any) -> Any:
    # Longer whole numbers are no numbers to those who read tables.
    short = not isinstance(value, int) or abs(value) < 2**63
    return value if isinstance(value, (bool, int, float, str)) and short else text_of(value)


def case_table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """One row a case; counts are whole numbers, or missing.

    Parameters stand between the model and the group, under their own name if no other column has
    it, else as "parameter NAME".
    """
    table = pd.DataFrame(rows)
    columns = [str(c) for c in table]
    parameters = [c for c in columns if c.startswith(_PARAMETER)]
    others = [c for c in columns if not c.startswith(_PARAMETER)]
    table = table[[others[0], *parameters, *others[1:]]]
    plain = {c: c.removeprefix(_PARAMETER) for c in parameters}
    names = {c: f"parameter {name}" if name in others else name for c, name in plain.items()}
    table = table.rename(columns=names)
    if "below resolution" in table:
        # Where no error is asked for, there is none a reference would have to resolve.
        table["below resolution"] = table["below resolution"].eq(True)
    return table.astype({c: "Int64" for c in map(str, table) if c in COUNTS or is_count(c)})


def summary(cases: pd.DataFrame) -> pd.DataFrame:
    """By group: the fastest integrator for each accuracy, observed orders, crossovers.

    Rows whose error the reference cannot resolve count for accuracies it can resolve: their error
    is at most that. Of cases that are not measured there is nothing to say.
    """
    lines: list[dict[str, Any]] = []
    told = cases["status"] == ("ok" if ERROR in cases else "")
    for group, rows in cases[told].groupby("group", sort=False):
        measured = rows.dropna(subset=[ERROR])
        lines += _best(str(group), measured)
        lines += _orders(str(group), measured[~measured["below resolution"]])
        lines += _crossovers(str(group), measured[~measured["below resolution"]])
    return pd.DataFrame(lines, columns=["group", "what", "at", "answer", "value", "unit"])


def _line(group: str, what: str, at: str, answer: str, value: float, unit: str) -> dict[str, Any]:
    return {
        "group": group,
        "what": what,
        "at": at,
        "answer": answer,
        "value": value,
        "unit": unit,
    }


def _best(group: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    lines = []
    # Of an error the reference cannot resolve it is known that it is at most that.
    unresolved = RESOLUTION * rows["reference uncertainty [-]"]
    measured = rows[ERROR].where(~rows["below resolution"], unresolved)
    for level in LEVELS:
        enough = rows[measured <= level]
        if len(enough):
            best = enough.sort_values(COST).iloc[0]
            at = f"error <= {level:.0e}"
            lines.append(_line(group, "fastest", at, best["label"], best[COST], "s"))
    return lines


def _orders(group: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Slope of the error over step or tolerance, fitted to all runs of a series."""
    lines = []
    for series, runs in rows.groupby("series", sort=False):
        error = runs[ERROR].to_numpy()
        for name in REFINED:
            size = runs[name].to_numpy(float)
            if len(np.unique(size)) < 2 or np.isnan(size).any() or np.min(error) <= 0.0:
                continue
            order = float(np.polyfit(np.log(size), np.log(error), 1)[0])
            at = f"{size.max():g} to {size.min():g}"
            lines.append(_line(group, f"order in {name}", at, str(series), order, "-"))
    return lines


def _crossovers(group: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Errors at which another series becomes the fastest, by interpolation of each series."""
    curves = {}
    for series, runs in rows.groupby("series", sort=False):
        ordered = runs.sort_values(ERROR)
        if len(ordered) > 1 and ordered[ERROR].min() > 0.0:
            curves[str(series)] = np.log(ordered[[ERROR, COST]].to_numpy(float).T)
    if not curves:
        return []
    ends = np.concatenate([c[0] for c in curves.values()])
    levels = np.linspace(ends.max(), ends.min(), 200)
    costs = np.array([_cost_at(levels, error, cost) for error, cost in curves.values()])
    names = list(curves)
    winners = np.argmin(costs, axis=0)
    lines = []
    for k in np.flatnonzero(np.diff(winners)):
        # A series that merely ends is not overtaken: the new one has to exist on either side, the
        # old one as well.
        if not np.isfinite(costs[[winners[k], winners[k + 1]], k : k + 2]).all():
            continue
        at, to = names[winners[k]], names[winners[k + 1]]
        lines.append(
            _line(group, "crossover", f"{at} to {to}", to, float(np.exp(levels[k + 1])), "error")
        )
    return lines


def _cost_at(levels: np.ndarray, error: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Cost of errors between those of a series: none for smaller, the cheapest for larger ones."""
    inside = np.interp(levels, error, np.minimum.accumulate(cost))
    return np.where(levels < error[0], np.inf, inside)


def mesh_summary(cases: pd.DataFrame, over: str) -> pd.DataFrame:
    """By group of a mesh study: observed order of the error over the refined parameter."""
    lines = []
    for group, rows in cases[cases["status"] == "ok"].groupby("group", sort=False):
        measured = rows.dropna(subset=[ERROR]).sort_values(over)
        measured = measured[~measured["below resolution"] & (measured[ERROR] > 0.0)]
        size, error = measured[over].to_numpy(float), measured[ERROR].to_numpy()
        for k in range(1, len(measured)):
            order = float(np.log(error[k - 1] / error[k]) / np.log(size[k] / size[k - 1]))
            at = f"{over} {size[k - 1]:g} to {size[k]:g}"
            lines.append(_line(str(group), "order in space", at, f"{error[k]:.2e}", order, "-"))
    return pd.DataFrame(lines, columns=["group", "what", "at", "answer", "value", "unit"])
