"""Warnings about points that slide beyond an end of their beam."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import format_percent
from beamdae.model_checks.strain_limits import sample_times
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Distance beyond an end, relative to the beam, up to which a sliding point has no warning.
_MAX_OVERRUN = 0.01


def overrun_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning per sliding point that is beyond an end of its beam."""
    mechanism = equations.mechanism
    parts = () if mechanism is None else mechanism.parts.values()
    loads: list[Any] = [x for x in parts if x.moves_along_beam]
    if mechanism is None or not loads:
        return
    for load in loads:
        if load.coordinates:
            yield from _overrun_warnings(load, equations, trajectory)


def _overrun_warnings(
    load: Any, equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[str]:
    """Yield a warning if a sliding point is more than 1 % of the beam beyond an end of it."""
    assert equations.mechanism is not None
    rows, beam = map_coordinates(equations.mechanism).slice_of(load), load.beam
    times = sample_times(trajectory)
    s = trajectory.positions_at(times)[:, rows].ravel()
    for end, overrun in (("start", -s), ("end", s - beam.length)):
        worst = float(np.max(overrun))
        if not worst > _MAX_OVERRUN * beam.length:
            continue
        # Rounding errors of a point that starts at the end are not the first passage.
        passed = int(np.argmax(overrun > _MAX_OVERRUN * beam.length))
        first = int(np.max(np.flatnonzero(overrun[:passed] <= 0.0), initial=-1)) + 1
        near = slice(max(first - 1, 0), first + 1)
        time = np.interp(0.0, overrun[near], times[near])
        stays = np.all(overrun[first:] > 0.0)
        when = f"from t = {time:.4g} s on" if stays else f"first at t = {time:.4g} s"
        yield (
            f"{load.name}: {load.a.body.name} is beyond the {end} of {beam.name} {when}, by up to "
            f"{format_percent(worst / beam.length)} of its length, where its tangent continues the "
            'beam; end the run earlier, set ends="stop", or check the unit of the speed.'
        )
