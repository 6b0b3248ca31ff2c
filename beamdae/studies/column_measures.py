"""Measures of observed columns: final value, extremes and root mean square of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from beamdae.results.columns import observed_columns
from beamdae.results.step_extremes import StepExtremes

Array = np.ndarray


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
