"""The case table of a study: a row a case."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from beamdae.studies.case import Case, text_of
from beamdae.studies.deviations import deviations, reactions
from beamdae.studies.event_columns import event_errors, is_count, misfit
from beamdae.studies.execution.case_run import Outcome
from beamdae.studies.references import Reference
from beamdae.studies.run_values import COUNTS, MEASURES

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
    table = outcome.table
    if reference.table is None or table is None or not outcome.values.get("steps"):
        return columns
    error = deviations(table, reference.table, reference.columns)
    columns[ERROR] = float(error.to_numpy().max())
    complete = outcome.status.success
    columns["below resolution"] = bool(complete and columns[ERROR] < reference.resolves)
    forces = reactions(reference.table)
    if forces:
        of_forces = deviations(table, reference.table, forces)
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
