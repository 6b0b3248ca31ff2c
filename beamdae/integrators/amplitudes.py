"""How far a mechanism moves: what its errors are to be small against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, PartCoordinates
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# What moves less than this share of what moves most is taken to move so much: a part, or a
# coordinate of a constrained system, which may mean anything.
_MIN_PART_SHARE = 1e-3
_MIN_COORDINATE_SHARE = 1e-5
# The largest amplitude of an angle [rad]: a quarter of a turn to each side carries points as far
# apart as any turning does.
_MAX_ANGLE_AMPLITUDE = 0.5 * np.pi
# The mean square of an angle about its mean [rad^2] over one turn.
_MAX_ANGLE_VARIANCE = np.pi**2 / 3.0
# What moves less than this share of its size does not move.
_REST_AMPLITUDE = 1e-9


@dataclass(frozen=True)
class Amplitudes:
    """How far the parts of a mechanism move in a run.

    Attributes
    ----------
    by_part
        Amplitude of each part over its size: the largest of those of its lengths over its extent
        and of its angles [rad], for points of a body of size L move by L times its angle; however
        often it turns, an angle counts for pi / 2 at most.
    scales
        Natural size of the motion of each coordinate [m or rad], (n,): the amplitude times the
        size of its part, or for an angle the amplitude itself.
    rate
        Fastest rate of the parts [1/s], the root mean square of velocities over that of positions
        about their mean, that of an angle at most that of one turn.
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
        angles = np.array([c.unit == "rad" for c in equations.coordinates], bool)
        sizes = _coordinate_sizes(equations, angles)
        q, v = (
            np.concatenate([getattr(i.state, x) for i in trajectory.intervals]) / sizes
            for x in ("q", "v")
        )
        swings = 0.5 * np.ptp(q, axis=0)
        swings[angles] = np.minimum(swings[angles], _MAX_ANGLE_AMPLITUDE)
        found = {part.name: float(np.max(swings[part.rows])) for part in equations.parts}
        most = max(found.values())
        rests = most <= _REST_AMPLITUDE
        if rests:
            found = dict.fromkeys(found, 1.0)
        by_part = {
            part.name: _round_to_two_digits(max(found[part.name], _min_share(part) * most))
            for part in equations.parts
        }
        scales = sizes.copy()
        for part in equations.parts:
            scales[part.rows] *= by_part[part.name]
        weights = _step_weights(trajectory)
        spread = np.average((q - np.average(q, axis=0, weights=weights)) ** 2, 0, weights)
        spread[angles] = np.minimum(spread[angles], _MAX_ANGLE_VARIANCE)
        speed = np.average(v**2, 0, weights)
        rates = [
            float(np.sqrt(np.sum(speed[part.rows]) / np.sum(spread[part.rows])))
            for part in equations.parts
            if not rests
            and found[part.name] > _MIN_PART_SHARE * most
            and np.any(spread[part.rows] > 0.0)
        ]
        return cls(by_part, scales, _round_to_two_digits(max(rates, default=0.0)))


def _min_share(part: PartCoordinates) -> float:
    alone = part.rows.stop - part.rows.start == 1
    return _MIN_COORDINATE_SHARE if alone else _MIN_PART_SHARE


def _round_to_two_digits(value: float) -> float:
    """To two digits: what rounding does to a scout is not to be seen in the run after it."""
    return float(f"{value:.1e}")


def _step_weights(trajectory: Trajectory) -> Array:
    """How long each step stands for [s], or shares of nothing."""
    times = [interval.t for interval in trajectory.intervals]
    found = np.concatenate([np.gradient(t) if len(t) > 1 else np.zeros(1) for t in times])
    return found if found.any() else np.ones(len(found))


def _coordinate_sizes(equations: EquationsOfMotion, angles: Array) -> Array:
    """Size of the part of each length, 1 for an angle."""
    size = np.ones(equations.n)
    for part in equations.parts:
        size[part.rows] = part.size
    return np.where(angles, 1.0, size)
