"""Warnings about sampled controllers that take hardly any sample in a run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.results.trajectory import Trajectory

_MIN_SAMPLES = 3
_ROUNDING = 1e-9  # of the number of samples; a sample at the end of a run has no effect


def rare_sample_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning per sampled controller with less than three samples in a run.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    for term in equations.controllers:
        every = term.controller.every
        count = int(np.ceil(trajectory.end / every - _ROUNDING))
        if 0 < count < _MIN_SAMPLES:
            yield (
                f"{term.controller.name}: samples only {'once' if count == 1 else 'twice'} in this "
                f"run, because every={every:.6g} s and the run takes {trajectory.end:.6g} s; check "
                "the unit of every."
            )
