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

_MAX_OVERRUN = 0.01  # distance beyond an end without a warning, relative to the beam


def overrun_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning per sliding point and end of its beam beyond which it slides."""
    mechanism = equations.mechanism
    parts = () if mechanism is None else mechanism.parts.values()
    points: list[Any] = [x for x in parts if x.moves_along_beam and x.coordinates]
    if mechanism is None or not points:
        return
    times = sample_times(trajectory)
    for point in points:
        beam, rows = point.beam, map_coordinates(mechanism).slice_of(point)
        s = trajectory.positions_at(times)[:, rows].ravel()
        for end, overrun in (("start", -s), ("end", s - beam.length)):
            (beyond,) = np.nonzero(overrun > _MAX_OVERRUN * beam.length)
            if len(beyond):
                share = format_percent(np.max(overrun) / beam.length)
                yield (
                    f"{point.name}: {point.a.body.name} is beyond the {end} of {beam.name} at "
                    f"t = {times[beyond[0]]:.4g} s and later by up to {share} of its length; end "
                    'the run earlier, set ends="stop", or check the unit of the speed.'
                )
