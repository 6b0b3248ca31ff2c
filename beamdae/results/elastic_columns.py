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
    observers = {
        inactive: ObservedRows(
            replace(equations.without_loads_of(inactive), observables=observables)
        )
        for inactive in {x.inactive for x in trajectory.intervals}
    }
    return [_observe_nodes(observers[x.inactive], x, max_rows) for x in trajectory.intervals]


def _observe_nodes(observe: ObservedRows, interval: Interval, max_rows: int) -> Array:
    """Return the columns at the nodes of an interval."""
    blocks = []
    for first in range(0, len(interval.nodes), max_rows):
        rows = slice(first, first + max_rows)
        blocks.append(observe(interval.times[rows], *(x[rows] for x in interval.rows)))
    return np.concatenate(blocks)


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
