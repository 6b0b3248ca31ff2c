"""Values of a run for tables: cost, quality, events, outputs, and measures of columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError, as_real, format_exception, short_repr, unbox_scalar
from beamdae.results.columns import observed_columns
from beamdae.results.outcome import format_event_counts
from beamdae.results.solution import Solution
from beamdae.results.step_extremes import StepExtremes
from beamdae.studies.tasks import Rows

EVENTS_COLUMN = "events"
WALL_TIME_COLUMN = "wall time [s]"
# Extremes of repeated runs; `WALL_TIME_COLUMN` contains the median.
MIN_WALL_TIME_COLUMN = "wall time min [s]"
MAX_WALL_TIME_COLUMN = "wall time max [s]"
MEASURING_TIME_COLUMN = "measuring time [s]"
REACHED_COLUMN = "reached [s]"
MEASURED_ERROR_COLUMN = "measured error [-]"  # largest one of the selected columns
SETTING_COLUMNS = ("formulation", "error control", "max order")
# Columns of the case table and their keys in `Solution.summary`.
COUNT_COLUMNS = {
    "steps": "steps",
    "rejected steps": "rejected_steps",
    "residual calls": "residual_calls",
    "Jacobian calls": "jacobian_calls",
    "factorizations": "factorizations",
    "solves": "solves",
    "Newton failures": "newton_failures",
}
MEASURE_COLUMNS = {
    "setup time [s]": "setup_time",
    WALL_TIME_COLUMN: "wall_time",
    "max position drift": "max_position_drift",
    "max velocity drift": "max_velocity_drift",
    "max residual [-]": "max_residual",
    "energy imbalance [-]": "energy_imbalance",
}

Array = np.ndarray


def collect_run_values(solution: Solution) -> dict[str, Any]:
    """Return settings, cost, quality and events of a run, keyed by column of the case table."""
    summary = solution.summary()
    settings = solution.integrator
    values = (
        settings.get("formulation", "stabilized-index1"),
        settings.get("error_control", ""),
        settings.get("max_order"),
    )
    names = [record.name for record in solution.event_records]
    warnings = "\n".join(solution.warnings)  # measures the errors
    return {
        REACHED_COLUMN: summary["last_time"],
        **dict(zip(SETTING_COLUMNS, values, strict=True)),
        **{column: summary[name] for column, name in (COUNT_COLUMNS | MEASURE_COLUMNS).items()},
        "warnings": warnings,
        **({EVENTS_COLUMN: format_event_counts(names)} if solution.equations.events else {}),
    }


def measured_errors(solution: Solution) -> dict[str, float]:
    """Return the errors of the observed columns that were measured, by header."""
    errors: Any = vars(solution).get("errors")
    pairs = () if errors is None else zip(errors.headers, errors.total.tolist(), strict=True)
    return {header: error for header, error in pairs if not np.isnan(error)}


def summarize_wall_times(times: Sequence[float]) -> dict[str, float]:
    """Return the median wall time [s] and, for several runs, the shortest and the longest."""
    summary = {WALL_TIME_COLUMN: float(np.median(times))}
    if len(times) > 1:
        summary |= {MIN_WALL_TIME_COLUMN: min(times), MAX_WALL_TIME_COLUMN: max(times)}
    return summary


def evaluate_outputs(outputs: Mapping[str, Callable[[Any], Any]], solution: Any) -> dict[str, Any]:
    """Return the values of the output functions of a sweep, keyed by column of the case table.

    The functions receive `solution`, which is a `Solution` or, in sweeps without runs, a `Model`.

    Raises
    ------
    BeamdaeError
        If a function fails, or returns anything but a number, a bool, a string or None.
    """
    values = {}
    for name, function in outputs.items():
        try:
            value = unbox_scalar(function(solution))
        except Exception as problem:
            raise BeamdaeError(
                f"the output {name!r} failed: {format_exception(problem)}."
            ) from problem
        number = as_real(value)
        if number is None and not isinstance(value, (bool, str, type(None))):
            raise BeamdaeError(
                f"the output {name!r} must be a number, a bool, a string or None, "
                f"got {short_repr(value)}."
            )
        values[format_output_column(name)] = value if number is None else number
    return values


def format_output_column(name: str) -> str:
    """Return the name of the column in the case table for an output of a sweep."""
    return f"output {name}"


def collect_rows(solution: Solution) -> Rows:
    """Return observed columns, energies and drift at the output times."""
    columns = solution.all_columns() | solution.drift_columns
    numbers = np.empty((len(solution.t), len(columns)))
    for k, column in enumerate(columns.values()):
        numbers[:, k] = column
    return Rows(tuple(columns)[1:], numbers)


def _time_average(t: Array, x: Array) -> Array:
    """Return the averages of the rows of `x` over the times `t` by the trapezoidal rule."""
    if len(t) < 2:
        return x[..., 0]
    return np.sum(0.5 * (x[..., 1:] + x[..., :-1]) * np.diff(t), axis=-1) / (t[-1] - t[0])


# Measures of observed columns, as functions of the times (n,) and the values (..., n).
MEASURES: Mapping[str, Callable[[Array, Array], Array]] = {
    "end": lambda t, x: x[..., -1],
    "max": lambda t, x: x.max(axis=-1),
    "min": lambda t, x: x.min(axis=-1),
    "RMS": lambda t, x: np.sqrt(_time_average(t, x**2)),
}


def measure_rows(
    columns: Sequence[str], numbers: Array, steps: Mapping[str, StepExtremes] | None = None
) -> dict[str, list[float]]:
    """Return all `MEASURES` of each observed column of a trajectory, by column.

    `numbers` contains the times [s] and the `columns`. "max", "min" and "RMS" include the values at
    the steps of the run, `steps`. The measures of a trajectory without rows are NaN.
    """
    headers = observed_columns(columns)
    values = np.full((len(headers), len(MEASURES)), np.nan)
    if headers and len(numbers):
        positions = {column: k for k, column in enumerate(columns, 1)}
        curves = numbers[:, [positions[header] for header in headers]]
        # Rows in memory are summed with smaller rounding errors.
        times, curves = np.ascontiguousarray(numbers[:, 0]), np.ascontiguousarray(curves.T)
        for k, measure in enumerate(MEASURES.values()):
            values[:, k] = measure(times, curves)
        smallest, largest, rms = (list(MEASURES).index(name) for name in ("min", "max", "RMS"))
        for row, header in zip(values, headers, strict=True):
            if steps and header in steps:
                row[smallest] = min(row[smallest], steps[header].min)
                row[largest] = max(row[largest], steps[header].max)
                row[rms] = steps[header].rms
    return dict(zip(headers, values.tolist(), strict=True))
