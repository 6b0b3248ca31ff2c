"""Values of observed columns at the steps of a run: extremes, means, and what the rows miss."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.measures import ObservedRows
from beamdae.results.columns import UNITS_OF_POSITIONS, largest_by
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray

_MAX_ROWS_AT_ONCE = 2048  # the columns of all steps may exceed the memory


@dataclass(frozen=True)
class StepExtremes:
    """Extremes of an observed column, their times [s], and its root mean square.

    All of them include the steps and the output rows. `tuple(extremes)` returns (min, min_time,
    max, max_time, rms).
    """

    min: float
    min_time: float
    max: float
    max_time: float
    rms: float

    def __iter__(self) -> Iterator[float]:
        return iter((self.min, self.min_time, self.max, self.max_time, self.rms))

    @property
    def half_range(self) -> float:
        """Half the difference of the extremes, in the unit of the column."""
        return 0.5 * (self.max - self.min)


class StepMeasures(NamedTuple):
    """Columns at the steps and the output rows of a run, (columns,) or (2, columns) each.

    Attributes
    ----------
    times, values
        Times [s] and values of the smallest and the largest value; not a number if a column is not
        finite at a step.
    rms, deviation
        Root mean squares of the columns, and of their deviations from the mean.
    excess
        Root mean squares of the distance of steps from the range of the two neighboring rows.
    excess_times, excess_values, excess_rows
        Time [s] and value at the largest distance, and the neighboring row that is nearer.
    """

    times: Array
    values: Array
    rms: Array
    deviation: Array
    excess: Array
    excess_times: Array
    excess_values: Array
    excess_rows: Array


def may_have_short_peaks(equations: EquationsOfMotion) -> bool:
    """Return True if forces may peak between rows: contacts, formulas of the user, and friction.

    Formulas count even if they are smooth.
    """
    mechanism = equations.mechanism
    if mechanism is not None and any(x.gaps for x in mechanism.parts.values()):
        return True
    kernels = (term.kernel for term in equations.forces)
    return any(not kernel.reused or kernel.local.n_multipliers for kernel in kernels)


def measure_steps(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    row_times: Array,
    observed: Mapping[str, Array],
    magnitudes: Collection[str] = (),
) -> StepMeasures:
    """Measure the observed columns at all steps between the first and the last output row.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    row_times
        Times (k,) of the output rows [s].
    observed
        Observed columns (k,) at these times, by header.
    magnitudes
        Headers of magnitudes, of which only the largest value matters.
    """
    rows = np.column_stack([np.zeros((len(row_times), 0)), *observed.values()])
    last, count = len(row_times) - 1, rows.shape[1]
    has_lower_side = np.array([x not in magnitudes for x in observed], bool)
    selected = list(_select_steps(trajectory, row_times))
    # Trapezoidal weights of all values in the integral over the times.
    all_times = np.concatenate([row_times, *(interval.t[steps] for interval, steps in selected)])
    order, weights = np.argsort(all_times, kind="stable"), np.zeros(len(all_times))
    widths = 0.5 * np.diff(all_times[order])
    weights[order] = np.append(0.0, widths) + np.append(widths, 0.0)
    # Columns may be infinite or not a number at some times.
    with np.errstate(invalid="ignore", over="ignore"):
        # Of the negative columns, the columns, and their distances from the rows.
        largest, times = np.zeros((2, 3, count))
        for side, sign in enumerate((-1.0, 1.0)):
            signed = np.where(np.isfinite(rows), sign * rows, -np.inf)
            largest[side], times[side] = signed.max(axis=0), row_times[signed.argmax(axis=0)]
        excess_values, excess_rows = np.zeros((2, count))
        is_finite = np.ones(count, bool)
        # Sums of differences from the first row are small beside positions far from the origin.
        changes, weight = rows - rows[0], weights[: last + 1]
        sums = np.stack([weight @ changes, weight @ changes**2, 0.0 * rows[0]])
        done = last + 1
        for interval, steps in selected:
            evaluate = ObservedRows(equations.with_loads_of(interval.configuration))
            step_times, state = interval.times[:: interval.nodes_per_step], interval.state
            for k in range(0, len(steps), _MAX_ROWS_AT_ONCE):
                here = steps[k : k + _MAX_ROWS_AT_ONCE]
                block, t = evaluate(step_times[here], *(x[here] for x in state)), interval.t[here]
                is_finite &= np.isfinite(block).all(axis=0)
                gaps = np.clip(np.searchsorted(row_times, t) - 1, 0, max(last - 1, 0))
                around = rows[gaps[0] : gaps[-1] + 2] if last else rows[[0, 0]]
                low, high = (f(around[:-1], around[1:]) for f in (np.minimum, np.maximum))
                low = np.where(has_lower_side, low, -np.inf)
                nearest = np.clip(block, low[gaps - gaps[0]], high[gaps - gaps[0]])
                excess = np.abs(block - nearest)
                for side, x in enumerate((-block, block, excess)):
                    (columns,) = np.nonzero(np.max(x, axis=0) > largest[side])
                    index = np.argmax(x[:, columns], axis=0)
                    largest[side, columns] = x[index, columns]
                    times[side, columns] = t[index]
                    if x is excess:
                        excess_values[columns] = block[index, columns]
                        excess_rows[columns] = nearest[index, columns]
                changes, weight = block - rows[0], weights[done : done + len(here)]
                sums += np.stack([weight @ changes, weight @ changes**2, weight @ excess**2])
                done += len(here)
        mean, squares, missed = sums / (weights.sum() or 1.0)
        rms = np.sqrt(np.maximum(squares + 2.0 * rows[0] * mean + rows[0] ** 2, 0.0))
        deviation = np.sqrt(np.maximum(squares - mean**2, 0.0))
    values = np.where(is_finite, [-largest[0], largest[1]], np.nan)
    of_excess = np.sqrt(missed), times[2], excess_values, excess_rows
    return StepMeasures(times[:2], values, rms, deviation, *of_excess)


def _select_steps(trajectory: Trajectory, row_times: Array) -> Iterator[tuple[Interval, Array]]:
    """Yield intervals and the indices of their steps inside the rows that are no rows."""
    begin, end = row_times[0], row_times[-1]
    of_rows = trajectory.interval_index(row_times)
    for number, interval in enumerate(trajectory.intervals):
        if interval.t[0] == interval.t[-1] and begin < end:
            continue  # between simultaneous events, where states have no duration
        is_new = (interval.t >= begin) & (interval.t <= end)
        is_new &= ~np.isin(interval.t, row_times[of_rows == number])
        yield interval, np.flatnonzero(is_new)


def refine_extremes(
    extreme_times: Array,
    extremes: Array,
    nodes: Array,
    observe_at: Callable[[Array], Array],
) -> tuple[Array, Array]:
    """Return times and values (2, n) of extremes with those of the column between its nodes.

    All values are those of the columns themselves: at the vertices of parabolas through three
    times, and at these. Errors of the extremes of a sine are below 1e-7 of its amplitude.

    Parameters
    ----------
    extreme_times, extremes
        Times (2, n) [s], and values of the smallest and the largest value.
    nodes
        Ascending times (k,) of the steps or the rows [s].
    observe_at
        Function that returns the columns (j, n) at ascending times (j,) [s].
    """
    if len(nodes) < 3 or not extremes.size:
        return extreme_times, extremes
    steps, k = np.diff(nodes), np.searchsorted(nodes, extreme_times)
    # The farther neighbor, with three times between the ends of the run.
    distances = np.maximum(np.append(0.0, steps)[k], np.append(steps, 0.0)[k])
    distances = np.minimum(distances, 0.5 * (nodes[-1] - nodes[0]))
    centers = np.clip(extreme_times, nodes[0] + distances, nodes[-1] - distances)
    stencils = centers + distances * np.array([-1.0, 0.0, 1.0])[:, None, None]
    times, index = np.unique(stencils, return_inverse=True)
    columns = observe_at(times)
    before, here, after = columns[index.reshape(stencils.shape), np.arange(columns.shape[1])]
    # Columns may be infinite or not a number at some times.
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        shifts = 0.5 * (before - after) / (before - 2.0 * here + after)
    vertices = np.unique((centers + shifts * distances)[np.abs(shifts) < 1.0])
    candidates = np.concatenate([extremes, columns, observe_at(vertices)])
    candidates = np.where(np.isfinite(candidates), candidates, extremes[0])
    of_candidates = np.concatenate([times, vertices])[:, None] + np.zeros(columns.shape[1])
    of_candidates = np.concatenate([extreme_times, of_candidates])
    rows = np.stack([np.argmin(candidates, axis=0), np.argmax(candidates, axis=0)])
    return np.take_along_axis(of_candidates, rows, 0), np.take_along_axis(candidates, rows, 0)


def measure_means(trajectory: Trajectory, count: int, observe: Callable[..., Array]) -> Array:
    """Return the means (n,) of the observed columns over the run by the quadrature of its steps.

    `observe` returns the columns (j, n), given rows (t, branch), (j, 2), and states.
    """
    integral = np.zeros(count)
    for interval in trajectory.intervals:
        if interval.t[-1] > interval.t[0]:
            values = observe(interval.times, *interval.rows)
            integral += interval.integrate_to_steps(values)[-1]
    return integral / (trajectory.end - trajectory.start)


def measure_mechanism(equations: EquationsOfMotion, trajectory: Trajectory) -> dict[str, float]:
    """Return the sizes of the rates and the reactions of a mechanism in a run, by unit.

    They are the largest half ranges of the velocities and accelerations of the coordinates, and the
    largest magnitudes of the multipliers. A fixed point moves by errors only, and so do reactions
    that vanish by symmetry, even if no other motion or force is observed.
    """
    rows = [interval.rows for interval in trajectory.intervals]
    units = [x.unit for x in equations.coordinates]
    reactions = np.max([np.max(np.abs(x.lam), axis=0) for x in rows], axis=0)
    sizes = largest_by((x.unit for x in equations.multipliers), reactions.tolist())
    for per, motions in (("/s", [x.v for x in rows]), ("/s^2", [x.a for x in rows])):
        high = np.max([np.max(x, axis=0) for x in motions], axis=0)
        low = np.min([np.min(x, axis=0) for x in motions], axis=0)
        rates = largest_by(units, (0.5 * (high - low)).tolist())
        sizes |= {f"{unit}{per}": rates[unit] for unit in UNITS_OF_POSITIONS if unit in rates}
    return sizes
