"""Warnings about laws with jumps of the slope, whose impulses reactions do not contain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.parts.joints.joint import Joint
from beamdae.results.event_records import EventRecord
from beamdae.results.trajectory import Trajectory

# Jump of the rate of a constraint relative to this rate, from which on a run has a warning. The
# consistent velocities of two segments differ by the tolerance of the run otherwise.
_MIN_JUMP = 1e-2
# Smallest jump relative to the sum of the terms of this rate at the largest velocities of the run;
# smaller ones are rounding or constraint drift.
_MIN_SHARE = 1e-3
# Velocities below this ratio to the largest one, both relative to the natural sizes of coordinates,
# are rounding errors, such as those of an angle that a driver holds.
_ROUNDING = 1e-9


def velocity_jump_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, event_records: Sequence[EventRecord]
) -> Iterator[str]:
    """Yield a warning if laws of drivers make velocities jump, except at events.

    The force that changes a velocity at once is infinite for an instant. The energy balance
    contains its work, but reactions, powers and their peaks do not contain it.
    """
    mechanism = equations.mechanism
    parts = {} if mechanism is None else mechanism.parts
    driven = {name for name, part in parts.items() if isinstance(part, Joint) and part.laws}
    if not driven or len(trajectory.intervals) == 1:
        return
    largest = np.max([np.max(np.abs(x.rows[1]), axis=0) for x in trajectory.intervals], axis=0)
    sizes = equations.position_scales
    largest = np.maximum(largest, _ROUNDING * np.max(largest / sizes) * sizes)
    at_events = {record.t for record in event_records}
    jumps: dict[str, set[float]] = {}
    for before, after in pairwise(trajectory.intervals):
        t = float(after.nodes[0])
        if t in at_events or before.configuration is not after.configuration:
            continue
        old, new = before.rows[1][-1], after.rows[1][0]
        if not np.any(np.abs(new - old) > _MIN_SHARE * largest):
            continue
        active = after.active_equations(equations)
        time = np.array([t, after.branch])
        jacobian = ConsistencySolver(active).constraint_matrix(time, after.rows[0][0])
        rates = np.abs(np.stack([jacobian @ x for x in (new - old, old, new)]))
        smallest = np.maximum(
            _MIN_JUMP * np.max(rates[1:], axis=0), _MIN_SHARE * (abs(jacobian) @ largest)
        )
        for k in np.flatnonzero(rates[0] > smallest):
            name = active.lam_names[k].rpartition(".")[0]
            if name in driven:
                jumps.setdefault(name, set()).add(t)
    for part, times in jumps.items():
        number = f"{len(times)} times, first " if len(times) > 1 else ""
        yield (
            f"{part}: the slope of its law jumps {number}at t = {min(times):.6g} s, so that "
            "velocities change at once; reactions, powers and their peaks do not contain the "
            "infinite forces of these instants; use a law with a continuous slope, such as a table "
            "with kind='pchip' whose first and last values repeat."
        )
