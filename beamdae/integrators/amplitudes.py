"""How far a mechanism moves: what its errors are to be small against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, PartCoordinates
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# What moves less than this share of what moves most is taken to move so much: a part, or a
# coordinate of a constrained system, which may mean anything.
_LEAST_SHARE = 1e-3
_LEAST_SHARE_ALONE = 1e-5
# What moves less than this share of its size does not move.
_AT_REST = 1e-9


@dataclass(frozen=True)
class Amplitudes:
    """How far the parts of a mechanism move in a run.

    Attributes
    ----------
    by_part
        Amplitude of each part over its size: the largest of those of its lengths over its extent
        and of its angles [rad], for points of a body of size L move by L times its angle.
    scales
        Natural size of the motion of each coordinate [m or rad], (n,): the amplitude times the
        size of its part, or the amplitude itself for an angle.
    rate
        Fastest rate of the parts [1/s], the root mean square of velocities over that of positions
        about their mean.
    """

    by_part: dict[str, float]
    scales: Array
    rate: float

    @classmethod
    def of(cls, equations: EquationsOfMotion, trajectory: Trajectory) -> Amplitudes:
        """Amplitudes of a run: half the ranges of the coordinates over its steps.

        A part that hardly moves beside others is given a thousandth of their motion, a coordinate
        of a constrained system 1e-5 of it; where nothing moves, sizes are the scales.
        """
        sizes = _sizes(equations)
        q, v = (
            np.concatenate([getattr(i.state, x) for i in trajectory.intervals]) / sizes
            for x in ("q", "v")
        )
        found = {
            part.name: float(np.max(0.5 * np.ptp(q[:, part.rows], axis=0)))
            for part in equations.parts
        }
        most = max(found.values())
        if most <= _AT_REST:
            found = dict.fromkeys(found, 1.0)
        by_part = {
            part.name: _rounded(max(found[part.name], _least_share(part) * most))
            for part in equations.parts
        }
        scales = sizes.copy()
        for part in equations.parts:
            scales[part.rows] *= by_part[part.name]
        weights = _durations(trajectory)
        spread = np.average((q - np.average(q, axis=0, weights=weights)) ** 2, 0, weights)
        speed = np.average(v**2, 0, weights)
        rates = [
            float(np.sqrt(np.sum(speed[part.rows]) / np.sum(spread[part.rows])))
            for part in equations.parts
            if found[part.name] > _LEAST_SHARE * most and np.any(spread[part.rows] > 0.0)
        ]
        return cls(by_part, scales, _rounded(max(rates, default=0.0)))


def _least_share(part: PartCoordinates) -> float:
    alone = part.rows.stop - part.rows.start == 1
    return _LEAST_SHARE_ALONE if alone else _LEAST_SHARE


def _rounded(value: float) -> float:
    """To two digits: what rounding does to a scout is not to be seen in the run after it."""
    return float(f"{value:.1e}")


def _durations(trajectory: Trajectory) -> Array:
    """How long each step stands for [s], or shares of nothing."""
    times = [interval.t for interval in trajectory.intervals]
    found = np.concatenate([np.gradient(t) if len(t) > 1 else np.zeros(1) for t in times])
    return found if found.any() else np.ones(len(found))


def _sizes(equations: EquationsOfMotion) -> Array:
    """Size of the part of each length, 1 for an angle."""
    size = np.ones(equations.n)
    for part in equations.parts:
        size[part.rows] = part.size
    angle = [coordinate.unit == "rad" for coordinate in equations.coordinates]
    return np.where(angle, 1.0, size)
