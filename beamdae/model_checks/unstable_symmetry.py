"""Motions of a run that stay on an unstable path because nothing disturbs its symmetry.

A straight column under more than its buckling load, or a symmetric arch beyond its branch point,
has an unstable direction that its exact symmetry never excites: the run stays on the symmetric
path, which a real structure leaves.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import NamedTuple

import numpy as np
import scipy.linalg as la

from beamdae.beams.beam import Beam, beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.equations.starts.rank import scaled_null_space
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_MAX_TURN = 0.5  # of frames with constant matrices [rad]

# Intervals over which the smallest eigenvalue is averaged, as fractions of the run. Loads that
# vibrate about less than the buckling load do not buckle a column, although they exceed it at
# times. The last, short interval is that of loads that increase until the end.
_INTERVALS = ((0.0, 0.25), (0.25, 0.5), (0.5, 0.75), (0.75, 1.0), (0.9375, 1.0))
# Times in an interval, as fractions of it: multiples of the golden ratio, because equal distances
# could be periods of the load. The end is the first.
_FRACTIONS = 1.0 - (np.arange(32) * 0.5 * (np.sqrt(5.0) - 1.0)) % 1.0
# Fraction of the times at which the path is unstable. The rotation of a free body that vibrates has
# a stiffness of either sign, half of the time each, because the forces of the vibration turn with
# the body: it is not unstable. The average of the smallest eigenvalue does not show this, because
# other motions bound it above. Half of the times exceed this fraction of 32 by chance in 0.3 %.
_UNSTABLE_FRACTION = 0.75
# A disturbance grows by a factor of 1000 within the time of the run, from an imperfection to a
# deflection, and by a factor of e within the interval.
_GROWTH = math.log(1e3)
# Share of the motion along the unstable direction up to which it is rounding.
_EXCITED_SHARE = 1e-6
_MOTION_SAMPLES = 200
# Compressive force by which beams buckle, over EI / L^2: pi^2 / 4 for a cantilever of the length L,
# more for all other supports. Below this force, nothing is computed.
_MIN_LOAD = 1.0
_MAX_COORDINATES = 300  # of dense matrices
_ASYMMETRY_TOLERANCE = 1e-13  # of stiffness by follower forces, relative to the largest entry
_ROUNDING = 1e-15  # of eigenvalues, relative to the largest entry


def unstable_symmetry_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, largest_force: float
) -> Iterator[str]:
    """Yield a warning if a run stays on a path that the smallest disturbance would leave.

    Disturbances grow faster than e^(s t) if x^T (K + s C + s^2 M) x < 0 for a motion x that the
    joints allow, with the stiffness K at rest in the positions of the run. A warning is due if this
    holds on average and most of the time over a quarter of the run or at its end, and if the
    displacements since the start have no share in x. Mechanisms with controllers, first-order
    states that act on the motion, and forces without a potential are not examined, and neither are
    motions of beams that turn.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    largest_force
        Largest entry of the forces and the reactions in the run [N or N m].
    """
    beams = beams_of(equations.mechanism)
    duration = trajectory.end - trajectory.start
    if not beams or not duration > 0.0 or equations.n > _MAX_COORDINATES:
        return
    if equations.controllers:
        return
    length = sum(beam.length for beam in beams)
    stiffness = min(_smallest_stiffness(beam) for beam in beams)
    if largest_force * length**2 < _MIN_LOAD * stiffness:
        return
    sampled = np.linspace(trajectory.start, trajectory.end, _MOTION_SAMPLES)
    q = trajectory.positions_at(sampled)
    turning = [beam for beam in beams if _turns(q[:, _turning_coordinates(equations, beam)])]
    if len(turning) == len(beams):
        return
    of_turning = np.concatenate(
        [np.zeros(0, int), *(_coordinates_of(equations, x) for x in turning)]
    )
    for interval in _INTERVALS:
        begin, end = (trajectory.start + duration * x for x in interval)
        times = begin + (end - begin) * _FRACTIONS
        rate = max(_GROWTH / duration, 1.0 / (end - begin))
        motions = (find_least_stable(equations, trajectory, t, rate) for t in times)
        last = next(motions)
        if last is None or last.eigenvalue >= 0.0 or _is_excited(q[sampled <= end], last):
            continue
        sizes = np.abs(last.shape / equations.position_scales)
        if np.max(sizes[of_turning], initial=0.0) > _EXCITED_SHARE * np.max(sizes):
            continue
        if _is_unstable_mostly(chain([last], motions)):
            yield _describe(equations, last.shape, end)
            return


class LeastStableMotion(NamedTuple):
    """Motion that the joints allow with the smallest eigenvalue of K + s C + s^2 M.

    Attributes
    ----------
    eigenvalue
        The eigenvalue [J] in natural sizes of the coordinates; 0 if it is a rounding error.
    shape
        The motion (n,).
    mass
        The mass matrix M (n, n).
    """

    eigenvalue: float
    shape: Array
    mass: Array


def find_least_stable(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    t: float,
    rate: float,
    only_unstable: bool = False,
) -> LeastStableMotion | None:
    """Return the least stable motion about the positions at time `t` [s] for s = `rate` [1/s].

    None if the joints allow no motion, the forces have no potential, first-order states act on the
    motion, or, if `only_unstable`, all eigenvalues are positive, which takes less time.
    """
    times = np.array([t])
    (time,), states = trajectory.at(times)
    interval = trajectory.intervals[int(trajectory.interval_index(times)[0])]
    active, reactions = interval.active_equations(equations), states.lam
    if interval.configuration is not None:
        reactions = interval.configuration.select_multipliers(reactions)
    zero = np.zeros(active.n)
    tangent = compute_tangent(active, time, State(states.q[0], zero, zero, reactions[0]))
    moving = np.setdiff1d(np.arange(active.n), active.states)
    total, mass = tangent.stiffness + rate * tangent.damping, tangent.mass
    total = (total + rate**2 * mass).tocsr()[moving]
    constraints = tangent.acceleration_jacobian(active)
    if abs(total[:, active.states]).sum() or abs(constraints[:, active.states]).sum():
        return None
    total, mass = total[:, moving].toarray(), mass.tocsr()[moving][:, moving].toarray()
    scales = active.position_scales[moving]
    scaled = total * scales * scales[:, None]
    size = float(np.max(np.abs(scaled), initial=0.0))
    if np.max(np.abs(scaled - scaled.T), initial=0.0) > _ASYMMETRY_TOLERANCE * size:
        return None
    basis = scaled_null_space(constraints[:, moving], scales)
    if not basis.shape[1]:
        return None
    projected = basis.T @ total @ basis
    if only_unstable and _is_positive(projected):
        return None
    (eigenvalue,), vectors = la.eigh(projected, subset_by_index=[0, 0])
    is_rounding = abs(eigenvalue) <= _ROUNDING * size
    shape, mass_of_all = np.zeros(active.n), np.zeros((active.n, active.n))
    shape[moving], mass_of_all[np.ix_(moving, moving)] = basis @ vectors[:, 0], mass
    return LeastStableMotion(0.0 if is_rounding else eigenvalue, shape, mass_of_all)


def _is_positive(matrix: Array) -> bool:
    """Return True if all eigenvalues of a symmetric matrix are positive."""
    try:
        la.cholesky(matrix, check_finite=False)
    except la.LinAlgError:
        return False
    return True


def _is_unstable_mostly(motions: Iterable[LeastStableMotion | None]) -> bool:
    """Return True if the eigenvalues are negative on average and most of the time."""
    total, stable = 0.0, 0
    for motion in motions:
        eigenvalue = 0.0 if motion is None else motion.eigenvalue
        total += eigenvalue
        stable += eigenvalue >= 0.0
        if stable > (1.0 - _UNSTABLE_FRACTION) * _FRACTIONS.size:
            return False
    return total < 0.0


def _is_excited(q: Array, motion: LeastStableMotion) -> bool:
    """Return True if the displacements of coordinates (k, n) have a share in a motion."""
    displacements, shape = q - q[0], motion.shape
    momentum = displacements @ motion.mass
    share = np.max(np.abs(momentum @ shape)) / math.sqrt(shape @ motion.mass @ shape)
    size = math.sqrt(np.max(np.sum(momentum * displacements, axis=1)))
    return bool(share > _EXCITED_SHARE * size)


def _describe(equations: EquationsOfMotion, shape: Array, t: float) -> str:
    largest = int(np.argmax(np.abs(shape) / equations.position_scales))
    part = next(x.name for x in equations.parts if x.rows.start <= largest < x.rows.stop)
    return (
        f"{part}: up to t = {t:.4g} s, the run stays on an unstable path, as a straight column "
        "above its buckling load does, because nothing disturbs its symmetry; an actual structure "
        "leaves it; add an imperfection (bd.imperfect) or a small load."
    )


def _smallest_stiffness(beam: Beam) -> float:
    middles = 0.5 * (beam.mesh.element_bounds[1:] + beam.mesh.element_bounds[:-1])
    return min(float(beam.section.at(s).EI) for s in middles)


def _coordinates_of(equations: EquationsOfMotion, beam: Beam) -> range:
    """Return the indices of the coordinates of a beam."""
    part = equations.coordinates_of_part(beam.name)
    return range(part.rows.start, part.rows.stop)


def _turning_coordinates(equations: EquationsOfMotion, beam: Beam) -> list[int]:
    """Return the indices of the angle of a beam's frame or, without one, of all its sections."""
    part = equations.coordinates_of_part(beam.name)
    angles = [k for k in _coordinates_of(equations, beam) if equations.is_angle[k]]
    return [k for k in angles if part.rigid.start <= k < part.rigid.stop] or angles


def _turns(angles: Array) -> bool:
    """Return True if all angles (k, n) turn by more than linear models of a beam permit."""
    return bool(np.min(np.ptp(angles, axis=0)) > _MAX_TURN)
