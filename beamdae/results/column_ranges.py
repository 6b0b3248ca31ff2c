"""Extremes and means of observed columns between output rows, for runs with all steps.

Amplitudes of periodic motions must not depend on the number of output rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from beamdae.results.columns import ColumnDict
from beamdae.results.missed_peaks import StepExtremes
from beamdae.results.trajectory import Trajectory

Array = np.ndarray


@dataclass(frozen=True)
class ColumnRange:
    """Smallest and largest value of an observed column."""

    least: float
    largest: float

    @property
    def half_range(self) -> float:
        """Half the difference of both values."""
        return 0.5 * (self.largest - self.least)

    @property
    def largest_magnitude(self) -> float:
        """Largest absolute value."""
        return max(abs(self.least), abs(self.largest))


def refine_step_extremes(
    headers: Sequence[str],
    extremes: Mapping[str, StepExtremes],
    row_times: Array,
    trajectory: Trajectory,
    observe_at: Callable[[Array], Array],
) -> ColumnDict:
    """Return the extremes of columns with peaks between the steps, such as those of stiff contacts.

    Parameters
    ----------
    headers
        Headers of all observed columns.
    extremes
        Extremes at steps and rows of some of them, see `measure_step_extremes`.
    row_times, trajectory, observe_at
        See `measure_column_ranges`.
    """
    names = [x for x in headers if x in extremes]
    if not names or len(row_times) < 2:
        return ColumnDict(extremes)
    selected = [headers.index(x) for x in names]
    values = np.array([(extremes[x].min, extremes[x].max) for x in names]).T
    times = np.array([(extremes[x].min_time, extremes[x].max_time) for x in names]).T
    steps = np.concatenate([row_times, *(x.t for x in trajectory.intervals)])
    distances = _find_distances(np.unique(steps), times)
    ends = row_times[0], row_times[-1]
    times, values = _refine(times, values, distances, ends, lambda t: observe_at(t)[:, selected])
    refined = zip(names, *values.tolist(), *times.tolist(), strict=True)
    return ColumnDict(
        {
            name: replace(extremes[name], min=low, max=high, min_time=low_time, max_time=high_time)
            for name, low, high, low_time, high_time in refined
        }
    )


def measure_column_ranges(
    columns: Mapping[str, Array],
    row_times: Array,
    extremes: Mapping[str, StepExtremes],
    trajectory: Trajectory,
    observe_at: Callable[[Array], Array],
) -> ColumnDict:
    """Return the range of each observed column over steps, rows and peaks between them.

    All values are those of the columns themselves: those at steps and rows, and at the vertices of
    parabolas through them. Errors of the extremes of a sine are below 1e-7 of its amplitude.

    Parameters
    ----------
    columns
        Observed columns (k,) at the output rows, by header.
    row_times
        Times (k,) of the rows [s].
    extremes
        Extremes at steps and rows, see `measure_step_extremes`; only the rows of other columns are
        considered.
    trajectory
        The steps of the run.
    observe_at
        Function that returns the columns (j, n) at ascending times (j,) [s].
    """
    if not columns:
        return ColumnDict()
    rows = np.column_stack(list(columns.values()))
    values = np.stack([np.min(rows, axis=0), np.max(rows, axis=0)])
    times = row_times[np.stack([np.argmin(rows, axis=0), np.argmax(rows, axis=0)])]
    at_steps = np.isin(list(columns), list(extremes))
    for k in np.flatnonzero(at_steps).tolist():
        extreme = extremes[list(columns)[k]]
        values[:, k] = extreme.min, extreme.max
        times[:, k] = extreme.min_time, extreme.max_time
    if len(row_times) > 2:
        steps = np.concatenate([row_times, *(x.t for x in trajectory.intervals)])
        distances = np.where(
            at_steps, _find_distances(np.unique(steps), times), _find_distances(row_times, times)
        )
        ends = row_times[0], row_times[-1]
        _, values = _refine(times, values, distances, ends, observe_at)
    ranges = map(ColumnRange, *values.tolist())
    return ColumnDict(dict(zip(columns, ranges, strict=True)))


def _find_distances(nodes: Array, times: Array) -> Array:
    """Return the distance of each time, one of the ascending nodes, to the farther neighbor."""
    steps = np.diff(nodes)
    k = np.searchsorted(nodes, times)
    before, after = np.append(0.0, steps)[k], np.append(steps, 0.0)[k]
    return np.asarray(np.maximum(before, after))


def _refine(
    extreme_times: Array,
    extremes: Array,
    distances: Array,
    ends: tuple[float, float],
    observe_at: Callable[[Array], Array],
) -> tuple[Array, Array]:
    """Return times and values (2, n) of extremes with the vertices of parabolas through 3 points.

    The points of the smallest and the largest value of each column are at their times (2, n) and at
    these distances (2, n) before and after them, moved between the ends [s] of the rows.
    """
    begin, end = ends
    distances = np.minimum(distances, 0.5 * (end - begin))
    centers = np.clip(extreme_times, begin + distances, end - distances)
    stencils = centers + distances * np.array([-1.0, 0.0, 1.0])[:, None, None]
    times, index = np.unique(stencils, return_inverse=True)
    columns = observe_at(times)
    before, here, after = columns[index.reshape(stencils.shape), np.arange(columns.shape[1])]
    # Columns may be infinite or not a number at some times.
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        shifts = 0.5 * (before - after) / (before - 2.0 * here + after)
    has_vertex = np.abs(shifts) < 1.0
    vertices = np.unique((centers + shifts * distances)[has_vertex])
    candidates = np.concatenate([extremes, columns, observe_at(vertices)])
    candidates = np.where(np.isfinite(candidates), candidates, extremes[0])
    of_candidates = np.concatenate([times, vertices])[:, None] + np.zeros(columns.shape[1])
    of_candidates = np.concatenate([extreme_times, of_candidates])
    rows = np.stack([np.argmin(candidates, axis=0), np.argmax(candidates, axis=0)])
    return np.take_along_axis(of_candidates, rows, 0), np.take_along_axis(candidates, rows, 0)


def measure_column_means(
    columns: Mapping[str, Array],
    row_times: Array,
    extremes: Mapping[str, StepExtremes],
    trajectory: Trajectory,
    observe: Callable[..., Array],
) -> ColumnDict:
    """Return the mean of each observed column over the run by the quadrature of its steps.

    Columns without `extremes`, see `measure_column_ranges`, are integrated over the rows.

    Parameters
    ----------
    columns, row_times, extremes, trajectory
        See `measure_column_ranges`.
    observe
        Function that returns the columns (j, n), given rows (t, branch), (j, 2), and states.
    """
    if not columns:
        return ColumnDict()
    rows = np.column_stack(list(columns.values()))
    means = rows[0]
    if row_times[-1] > row_times[0]:
        integral = 0.5 * np.diff(row_times) @ (rows[1:] + rows[:-1])
        means = integral / (row_times[-1] - row_times[0])
    if trajectory.end > trajectory.start:
        integral = np.zeros(len(columns))
        for interval in trajectory.intervals:
            if interval.t[-1] > interval.t[0]:
                values = observe(interval.times, *interval.rows)
                integral += interval.integrate_to_steps(values)[-1]
        at_steps = np.isin(list(columns), list(extremes))
        means = np.where(at_steps, integral / (trajectory.end - trajectory.start), means)
    return ColumnDict(dict(zip(columns, means.tolist(), strict=True)))
