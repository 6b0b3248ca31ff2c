"""The case table of a study: a row a case."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from beamdae.studies.case import Case, format_parameter
from beamdae.studies.deviations import compute_deviations, select_reaction_columns
from beamdae.studies.execution.case_run import Outcome
from beamdae.studies.references import Reference
from beamdae.studies.run_values import (
    COUNT_COLUMNS,
    MEASURE_COLUMNS,
    compute_event_errors,
    describe_event_mismatch,
    is_event_count,
)

ERROR_COLUMN, WALL_TIME_COLUMN = "error [-]", "wall time [s]"
# What integrators are refined by, a column each.
ACCURACY_COLUMNS = ("rtol", "step")
_PARAMETER_PREFIX = "parameter: "


def tabulate_case(
    case: Case, group: str, outcome: Outcome, reference: Reference | None
) -> dict[str, Any]:
    """The row of a case: what it was, what it cost, how well it did."""
    accuracy = case.integrator.accuracy
    values: dict[str, Any] = {
        "model": case.model.name,
        **{
            _PARAMETER_PREFIX + name: _format_cell(value) for name, value in case.parameters.items()
        },
        "group": group,
        "integrator": case.integrator.method,
        "label": case.label,
        "series": case.series,
        "settings": ", ".join(f"{k}={v}" for k, v in case.changed.items()),
        **{name: accuracy.value if accuracy.name == name else np.nan for name in ACCURACY_COLUMNS},
        "status": outcome.status.kind,
        "reason": "" if outcome.status.success else outcome.status.sentence,
        "reached [s]": np.nan,
        **dict.fromkeys(COUNT_COLUMNS),
        **dict.fromkeys(MEASURE_COLUMNS, np.nan),
        **outcome.values,
    }
    return values if reference is None else values | _error_columns(outcome, reference)


def _error_columns(outcome: Outcome, reference: Reference) -> dict[str, Any]:
    """Largest error of all columns, of each and of the reactions, relative to amplitudes."""
    columns: dict[str, Any] = dict.fromkeys(
        [ERROR_COLUMN, "below resolution", "reaction error [-]"], np.nan
    )
    columns["below resolution"] = False
    columns["reference uncertainty [-]"] = reference.uncertainty
    # A run that took no step has its start to show, which is no error.
    table = outcome.table
    if reference.table is None or table is None or not outcome.values.get("steps"):
        return columns
    error = compute_deviations(table, reference.table, reference.columns)
    columns[ERROR_COLUMN] = float(error.to_numpy().max())
    complete = outcome.status.success
    columns["below resolution"] = bool(complete and columns[ERROR_COLUMN] < reference.resolution)
    forces = select_reaction_columns(reference.table)
    if forces:
        of_forces = compute_deviations(table, reference.table, forces)
        columns["reaction error [-]"] = float(of_forces.to_numpy().max())
    for name in reference.columns:
        columns[f"error of {name}, end"] = float(error[name].iloc[-1]) if complete else np.nan
        columns[f"error of {name}, max"] = float(error[name].max())
        columns[f"error of {name}, rms"] = float(np.sqrt(np.mean(error[name] ** 2)))
    columns |= compute_event_errors(outcome.values, reference.events)
    if complete and (others := describe_event_mismatch(outcome.values, reference.events)):
        columns["warnings"] = " ".join(filter(None, [outcome.values["warnings"], others]))
    return columns


def _format_cell(value: Any) -> Any:
    # Longer whole numbers are no numbers to those who read tables.
    short = not isinstance(value, int) or abs(value) < 2**63
    return (
        value if isinstance(value, (bool, int, float, str)) and short else format_parameter(value)
    )


def assemble_case_table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """One row a case; counts are whole numbers, or missing.

    Parameters stand between the model and the group, under their own name if no other column has
    it, else as "parameter NAME".
    """
    table = pd.DataFrame(rows)
    columns = [str(c) for c in table]
    parameters = [c for c in columns if c.startswith(_PARAMETER_PREFIX)]
    others = [c for c in columns if not c.startswith(_PARAMETER_PREFIX)]
    table = table[[others[0], *parameters, *others[1:]]]
    plain = {c: c.removeprefix(_PARAMETER_PREFIX) for c in parameters}
    names = {c: f"parameter {name}" if name in others else name for c, name in plain.items()}
    table = table.rename(columns=names)
    if "below resolution" in table:
        # Where no error is asked for, there is none a reference would have to resolve.
        table["below resolution"] = table["below resolution"].eq(True)
    return table.astype(
        {c: "Int64" for c in map(str, table) if c in COUNT_COLUMNS or is_event_count(c)}
    )
