"""Amplitudes of the motion of a mechanism, which serve as scales of its errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, PartCoordinates
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Smallest amplitude of a part, relative to the largest amplitude of all parts, ...
_MIN_PART_SHARE = 1e-3
# ... and of a state, or a coordinate of a constrained system, whose unit may differ. The place of a
# slider on a beam is no such part: it would need errors below rounding while the slider rests.
_MIN_COORDINATE_SHARE = 1e-5
# The scale of a deformation is its amplitude. Deformations below this fraction of the amplitude of
# their part have a larger scale, because ever smaller vibrations are ever faster: ...
SMALL_DEFORMATION_SHARE = 1e-2
# ... this multiple of their amplitude, with which the deflections of undamped stiff strips in
# validation/tolerances are within 70 rtol (with the limit above as the scale: 4400 rtol), ...
_SMALL_DEFORMATION_FACTOR = 3.0
# ... but at least this fraction of the amplitude of the part.
_MIN_DEFORMATION_SHARE = 1e-5
# Largest amplitude of an angle [rad]: a quarter turn to either side separates points as far as any
# rotation can.
_MAX_ANGLE_AMPLITUDE = 0.5 * np.pi
# Largest variance of an angle [rad^2]: the variance over one uniform revolution.
_MAX_ANGLE_VARIANCE = np.pi**2 / 3.0
# A mechanism is at rest if no part moves by more than this fraction of its size.
_REST_AMPLITUDE = 1e-9


@dataclass(frozen=True)
class Amplitudes:
    """Amplitudes of the parts of a mechanism during a run.

    Attributes
    ----------
    by_part
        Dimensionless amplitude of each part: the largest amplitude of its coordinates, where
        amplitudes of lengths are divided by the size of the part. Amplitudes of angles [rad],
        limited to pi/2, are not divided, because an angle moves the points of a body of size L by
        up to L times the angle.
    scales
        Scale of each coordinate [m or rad], (n,): an amplitude, which is multiplied by the size of
        the part if the coordinate is a length. In general, this is the amplitude of the part. For a
        deformation relative to a floating frame, it is the largest amplitude of deformations of the
        same kind (u, v or phi) over all nodes. For a beam in absolute coordinates, it is the
        amplitude of the rotations of its sections relative to the first section. In both of these
        cases, an amplitude below 1e-2 of the amplitude of the part is multiplied by 3, up to this
        limit, and is at least 1e-5 of the amplitude of the part. The amplitude of the part would be
        too large, because deflections are often 1e2 to 1e5 times smaller than the motion of a beam.
    part_scales
        Scale of each coordinate [m or rad], (n,), with the amplitude of its part.
    rate
        Highest rate of all parts [1/s], 0 if nothing moves. The rate of a part is the root mean
        square of its velocities divided by the standard deviation of its positions. The standard
        deviation of an angle is limited to its value over one uniform revolution. The rate of a
        first-order state is pi/2 times the mean absolute value of its rate divided by its
        amplitude, the same for a harmonic motion, because the mean square would be that of a short
        transient. Parts whose amplitudes are at most 1e-3 of the largest amplitude are ignored;
        for bodies, the largest one is that of all bodies if one moves.
    """

    by_part: dict[str, float]
    scales: Array
    part_scales: Array
    rate: float

    @classmethod
    def from_trajectory(cls, equations: EquationsOfMotion, trajectory: Trajectory) -> Amplitudes:
        """Compute the amplitudes of a run; the amplitude of a coordinate is half its range.

        The amplitude of a part is at least 1e-3 of the largest amplitude, or 1e-5 for a state or a
        single coordinate of a constrained system; for bodies, the largest one is that of all bodies
        if one moves. If nothing moves, all amplitudes are 1.
        """
        angles, sizes = equations.is_angle, _coordinate_sizes(equations)
        q, v = (
            np.concatenate([getattr(i.state, x) for i in trajectory.intervals]) / sizes
            for x in ("q", "v")
        )
        half_ranges = 0.5 * np.ptp(q, axis=0)
        half_ranges[angles] = np.minimum(half_ranges[angles], _MAX_ANGLE_AMPLITUDE)
        amplitudes = {part.name: float(np.max(half_ranges[part.rows])) for part in equations.parts}
        largest = max(amplitudes.values())
        is_at_rest = largest <= _REST_AMPLITUDE
        if is_at_rest:
            amplitudes = dict.fromkeys(amplitudes, 1.0)
        # Amplitudes of states, such as pressures, have other units than those of bodies.
        largest_of_bodies = max(
            (amplitudes[part.name] for part in equations.parts if not part.is_state), default=0.0
        )
        if not largest_of_bodies > _REST_AMPLITUDE:
            largest_of_bodies = largest
        references = {
            part.name: largest if part.is_state else largest_of_bodies for part in equations.parts
        }
        by_part = {
            part.name: _round_to_two_digits(
                max(amplitudes[part.name], _min_share(equations, part) * references[part.name])
            )
            for part in equations.parts
        }
        scales = sizes.copy()
        for part in equations.parts:
            scales[part.rows] *= by_part[part.name]
        part_scales = scales.copy()
        for part in () if is_at_rest else equations.parts:
            for rows in _group_deformations(equations, part):
                amplitude = float(np.max(half_ranges[rows]))
                scales[rows] = sizes[rows] * _deformation_scale(amplitude, by_part[part.name])
            rotations = q[:, part.rows][:, angles[part.rows]]
            if part.rigid_count == 0 and rotations.shape[1] > 1:
                bending = 0.5 * float(np.max(np.ptp(rotations - rotations[:, :1], axis=0)))
                scale = min(_deformation_scale(bending, by_part[part.name]), by_part[part.name])
                scales[part.rows] = sizes[part.rows] * scale
        weights = _step_weights(trajectory)
        variance = np.average((q - np.average(q, axis=0, weights=weights)) ** 2, 0, weights)
        variance[angles] = np.minimum(variance[angles], _MAX_ANGLE_VARIANCE)
        mean_square_rate = np.average(v**2, 0, weights)
        states = equations.states
        mean_rate = np.average(np.abs(v[:, states]), 0, weights)
        mean_square_rate[states] = (0.5 * np.pi * mean_rate) ** 2
        variance[states] = half_ranges[states] ** 2
        rates = [
            float(np.sqrt(np.sum(mean_square_rate[part.rows]) / np.sum(variance[part.rows])))
            for part in equations.parts
            if not is_at_rest
            and amplitudes[part.name] > _MIN_PART_SHARE * references[part.name]
            and np.any(variance[part.rows] > 0.0)
        ]
        return cls(by_part, scales, part_scales, _round_to_two_digits(max(rates, default=0.0)))


def _group_deformations(equations: EquationsOfMotion, part: PartCoordinates) -> list[list[int]]:
    """Return lists of the rows of deformations of the same kind, such as u1, u2, ..."""
    groups: dict[str, list[int]] = {}
    for row in range(part.deformations.start, part.deformations.stop):
        groups.setdefault(equations.coordinates[row].name.rstrip("0123456789"), []).append(row)
    return list(groups.values())


def _deformation_scale(amplitude: float, part_amplitude: float) -> float:
    """Return the scale of a deformation; see `Amplitudes.scales`."""
    amplitude = _round_to_two_digits(amplitude)
    enlarged = max(_SMALL_DEFORMATION_FACTOR * amplitude, _MIN_DEFORMATION_SHARE * part_amplitude)
    return min(enlarged, max(amplitude, SMALL_DEFORMATION_SHARE * part_amplitude))


def _min_share(equations: EquationsOfMotion, part: PartCoordinates) -> float:
    is_separate = part.is_state or equations.mechanism is None
    is_single = part.rows.stop - part.rows.start == 1
    return _MIN_COORDINATE_SHARE if is_separate and is_single else _MIN_PART_SHARE


def _round_to_two_digits(value: float) -> float:
    # Rounding errors of the pilot run must not change the main run.
    return float(f"{value:.1e}")


def _step_weights(trajectory: Trajectory) -> Array:
    """Return the duration [s] that each step represents, or ones if all durations are zero."""
    times = [interval.t for interval in trajectory.intervals]
    weights = np.concatenate([np.gradient(t) if len(t) > 1 else np.zeros(1) for t in times])
    return weights if weights.any() else np.ones(len(weights))


def _coordinate_sizes(equations: EquationsOfMotion) -> Array:
    """Return, for each coordinate, the size [m] of its part, or 1 for an angle; (n,)."""
    size = np.ones(equations.n)
    for part in equations.parts:
        size[part.rows] = part.size
    return np.where(equations.is_angle, 1.0, size)
