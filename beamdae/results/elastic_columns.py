"""Forces of beams and springs between the steps of a run.

At the steps and stages, elastic forces are in equilibrium with the loads. Between them,
interpolated positions have errors within the tolerance, which deform stiff parts: the axial force
at the clamp of a thin blade was wrong by 93 % of its largest value, the force of a stiff bushing by
49 %. Interpolated forces are as accurate as accelerations and reactions. Quantities with kinks,
which polynomials overshoot, follow from the positions: magnitudes, such as the largest stress, the
force of a contact, and formulas of the user. Events monitor the interpolated forces, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.measures import ObservedRows
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray


def find_elastic_columns(equations: EquationsOfMotion) -> Array:
    """Return the indices of elastic forces among the observed columns.

    See `Quantity.is_elastic`.
    """
    counts = [len(x.columns) for x in equations.observables]
    (columns,) = np.nonzero(np.repeat([x.is_elastic for x in equations.observables], counts))
    return columns


def observe_elastic_columns(
    equations: EquationsOfMotion, trajectory: Trajectory, max_rows: int
) -> list[Array]:
    """Return the columns of `find_elastic_columns` at the nodes of each interval, (k, c) each.

    At most `max_rows` states are evaluated together.
    """
    observables = tuple(x for x in equations.observables if x.is_elastic)
    values: dict[int, Array] = {}
    # Together, because runs with many events have many intervals of a few nodes.
    for inactive in dict.fromkeys(x.inactive for x in trajectory.intervals):
        here = [k for k, x in enumerate(trajectory.intervals) if x.inactive == inactive]
        active = replace(equations.without_loads_of(inactive), observables=observables)
        observe = ObservedRows(active)
        intervals = [trajectory.intervals[k] for k in here]
        ends = np.cumsum([len(x.nodes) for x in intervals])
        blocks = [
            _observe_nodes(observe, intervals, slice(first, first + max_rows))
            for first in range(0, ends[-1], max_rows)
        ]
        values |= dict(zip(here, np.split(np.concatenate(blocks), ends[:-1]), strict=True))
    return [values[k] for k in range(len(trajectory.intervals))]


def _observe_nodes(observe: ObservedRows, intervals: Sequence[Interval], nodes: slice) -> Array:
    """Return the columns at some of the nodes of all intervals."""
    times, states, first = [], [], 0
    for interval in intervals:
        rows = slice(max(nodes.start - first, 0), max(nodes.stop - first, 0))
        first += len(interval.nodes)
        if first > nodes.start and rows.stop > 0:
            times.append(interval.times[rows])
            states.append([x[rows] for x in interval.rows])
    if len(times) == 1:
        # A selection of all would copy the states.
        return observe(times[0], *states[0])
    return observe(np.concatenate(times), *map(np.concatenate, zip(*states, strict=True)))


def interpolate_elastic_columns(
    trajectory: Trajectory, values: Sequence[Array], times: Array, columns: Array
) -> None:
    """Replace columns (j, c) at ascending times (j,) [s], given those at the nodes of intervals.

    Columns of intervals that store only some of their steps remain, because their nodes are rows.
    """
    index = trajectory.interval_index(times)
    for k, interval in enumerate(trajectory.intervals):
        here = index == k
        if interval.record is None and here.any():
            columns[here] = interval.interpolate_forces(values[k], times[here])
