"""Warnings about runs that leave the range of a table or the end of a beam."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.table_arguments import compile_table_arguments, find_distinct
from beamdae.errors import format_percent
from beamdae.model_checks.strain_limits import sample_times

if TYPE_CHECKING:
    from beamdae.results.run_data import RunData

_MIN_EXCESS = 1e-3  # outside a table, relative to its range; less hardly changes its value
_MAX_OVERRUN = 0.01  # beyond an end of a beam, relative to its length


def table_range_warnings(run: RunData) -> Iterator[str]:
    """Yield a warning per argument of a table that leaves its range in a run.

    Tables over time are exempt, because they usually hold their last value, and so are sides at
    which the table is zero or constant: one-sided forces and limits continue there as they should.
    """
    for term in find_distinct(compile_table_arguments(run.equations)):
        intervals = [x for x in run.trajectory.intervals if term.part not in x.inactive]
        is_exempt = term.is_limited or term.table.is_repeated or not term.depends_on_motion
        if is_exempt or not intervals:
            continue
        t = np.concatenate([x.t for x in intervals])
        x = np.concatenate([term.argument.values(i.with_branch(i.t), i.state) for i in intervals])
        low, high = term.limits
        sides = {0: low - x, -1: x - high}
        held = [beyond for side, beyond in sides.items() if not term.continues_as_constant(side)]
        excess = np.max(held, axis=0, initial=0.0) if held else np.zeros(len(x))
        k = int(np.argmax(excess))
        if excess[k] > _MIN_EXCESS * (high - low):
            yield (
                f"{term.describe(float(x[k]))} at t = {t[k]:.6g} s, where its value is held; "
                "extend the table, repeat its last value if it stays constant, or pass "
                "outside='repeat' or 'error'; check the units."
            )


def overrun_warnings(run: RunData) -> Iterator[str]:
    """Yield a warning per sliding point and end of its beam beyond which it slides."""
    mechanism = run.equations.mechanism
    parts = () if mechanism is None else mechanism.parts.values()
    points: list[Any] = [x for x in parts if x.moves_along_beam and x.coordinates]
    if mechanism is None or not points:
        return
    times = sample_times(run.trajectory)
    q = run.trajectory.positions_at(times)
    for point in points:
        beam, rows = point.beam, map_coordinates(mechanism).slice_of(point)
        s = q[:, rows].ravel()
        for end, overrun in (("start", -s), ("end", s - beam.length)):
            (beyond,) = np.nonzero(overrun > _MAX_OVERRUN * beam.length)
            if len(beyond):
                share = format_percent(np.max(overrun) / beam.length)
                yield (
                    f"{point.name}: {point.a.body.name} is beyond the {end} of {beam.name} at "
                    f"t = {times[beyond[0]]:.4g} s and later by up to {share} of its length; end "
                    'the run earlier, set ends="stop", or check the unit of the speed.'
                )
