"""Plan of a run: smooth intervals, consistent start, fastest modes, amplitudes and longest step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.smooth_intervals import branch_time, plan_ends, time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.parts.laws import MIN_STEPS_PER_TIME_SCALE
from beamdae.results.trajectory import Trajectory
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

_POWER_ITERATIONS = 12


class Mode(NamedTuple):
    """Natural frequency [rad/s] and damping ratio of a mode."""

    frequency: float
    damping_ratio: float


def estimate_fastest_modes(
    solver: ConsistencySolver, time: Array, state: State
) -> tuple[Mode, ...]:
    """Estimate the fastest natural mode of each elastic body of the constrained mechanism.

    The method is power iteration with M^-1 K under the constraints, where K = dF/dq and M = dF/da.
    First-order states are constant. A body is a set of parts that M and K couple. The coordinates
    of one part are coupled even if their entries of M and K are zero, which depends on the
    orientation of a straight beam. The iterate is normalized separately for each body, so that the
    fastest body does not mask slower ones. Bodies without stiffness or inertia are omitted.
    """
    stiffness, damping, mass = solver.linearize_forces(time, state)
    e = solver.equations
    # The first coordinate of each part is coupled to the others.
    first = np.zeros(e.n, np.intp)
    for part in e.parts:
        first[part.rows] = part.rows.start
    entries = [(x.indices, column_indices(x), np.abs(x.data) > 0.0) for x in (stiffness, mass)]
    rows = np.concatenate([first, *(i[is_coupled] for i, _, is_coupled in entries)])
    columns = np.concatenate([np.arange(e.n), *(j[is_coupled] for _, j, is_coupled in entries)])
    graph = sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(e.n, e.n))
    count, body = connected_components(graph, directed=False)
    x = np.cos(np.arange(e.n) ** 2.0)
    for _ in range(_POWER_ITERATIONS):
        x = solver.solve_saddle(time, state.q, state.v, stiffness @ x, 0.0)[0]
        size = np.zeros(count)
        np.maximum.at(size, body, np.abs(x))
        x /= np.where(size > 0.0, size, 1.0)[body]

    inertia, elastic, dissipated = (
        np.bincount(body, x * (matrix @ x), count) for matrix in (mass, stiffness, damping)
    )
    is_elastic = (inertia > 0.0) & (elastic != 0.0)
    frequency = np.sqrt(np.abs(elastic[is_elastic]) / inertia[is_elastic])
    ratio = dissipated[is_elastic] / (2.0 * frequency * inertia[is_elastic])
    return tuple(Mode(float(w), float(z)) for w, z in zip(frequency, ratio, strict=True))


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
        angles, sizes = equations.is_angle, np.ones(equations.n)
        for part in equations.parts:
            sizes[part.rows] = part.size
        sizes[angles] = 1.0
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
        by_part = {}
        for part in equations.parts:
            is_separate = part.is_state or equations.mechanism is None
            is_single = part.rows.stop - part.rows.start == 1
            share = _MIN_COORDINATE_SHARE if is_separate and is_single else _MIN_PART_SHARE
            least = share * references[part.name]
            by_part[part.name] = _round_to_two_digits(max(amplitudes[part.name], least))
        scales = sizes.copy()
        for part in equations.parts:
            scales[part.rows] *= by_part[part.name]
        part_scales = scales.copy()
        for part in () if is_at_rest else equations.parts:
            # Deformations of the same kind, such as u1, u2, ...
            groups: dict[str, list[int]] = {}
            for row in range(part.deformations.start, part.deformations.stop):
                kind = equations.coordinates[row].name.rstrip("0123456789")
                groups.setdefault(kind, []).append(row)
            for rows in groups.values():
                amplitude = float(np.max(half_ranges[rows]))
                scales[rows] = sizes[rows] * _deformation_scale(amplitude, by_part[part.name])
            rotations = q[:, part.rows][:, angles[part.rows]]
            if part.rigid_count == 0 and rotations.shape[1] > 1:
                bending = 0.5 * float(np.max(np.ptp(rotations - rotations[:, :1], axis=0)))
                scale = min(_deformation_scale(bending, by_part[part.name]), by_part[part.name])
                scales[part.rows] = sizes[part.rows] * scale
        # The duration [s] that each step represents.
        times = [interval.t for interval in trajectory.intervals]
        weights = np.concatenate([np.gradient(t) if len(t) > 1 else np.zeros(1) for t in times])
        weights = weights if weights.any() else np.ones(len(weights))
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


def _deformation_scale(amplitude: float, part_amplitude: float) -> float:
    """Return the scale of a deformation; see `Amplitudes.scales`."""
    amplitude = _round_to_two_digits(amplitude)
    enlarged = max(_SMALL_DEFORMATION_FACTOR * amplitude, _MIN_DEFORMATION_SHARE * part_amplitude)
    return min(enlarged, max(amplitude, SMALL_DEFORMATION_SHARE * part_amplitude))


def _round_to_two_digits(value: float) -> float:
    # Rounding errors of the pilot run must not change the main run.
    return float(f"{value:.1e}")


# Runs that would need more steps are rejected.
_MAX_PLANNED_STEPS = 1e8
# Least number of steps in a run; with `MIN_STEPS_PER_TIME_SCALE` it sets the default longest step.
_MIN_STEPS_PER_RUN = 20.0


@dataclass(frozen=True)
class RunPlan:
    """Smooth intervals of a run, its consistent start, and the amplitudes of its motion.

    Attributes
    ----------
    starter
        Solver for consistent states of `equations`.
    intervals
        (start, end) of the smooth intervals between breakpoints and short pulses [s].
    state
        Consistent state at the start, or after the last event with actions.
    fastest_modes
        Cached function that returns the fastest natural mode of each elastic body in this state.
    amplitudes
        Amplitudes of the parts measured by a pilot run, or None.
    partial_rate
        Rate of the motion [1/s] that a pilot run measured over many periods, if it was too short to
        measure amplitudes; otherwise 0.
    is_adaptive
        True if an error tolerance determines the steps.
    matrices
        Last matrix by name of the method, so that a run can reuse the pivots of its pilot run.
    """

    starter: ConsistencySolver
    intervals: tuple[tuple[float, float], ...]
    state: State
    fastest_modes: Callable[[], tuple[Mode, ...]]
    amplitudes: Amplitudes | None = None
    partial_rate: float = 0.0
    is_adaptive: bool = True
    matrices: dict[str, FactorizedMatrix] = field(default_factory=dict, compare=False)

    def matrix(self, method: str, pattern: sp.csc_array) -> FactorizedMatrix:
        """Return a new matrix for a method; the pivots of its last matrix are tried first."""
        matrix = FactorizedMatrix.from_pattern(pattern, pivot_source=self.matrices.get(method))
        self.matrices[method] = matrix
        return matrix

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations to integrate."""
        return self.starter.equations

    @property
    def time(self) -> Array:
        """(t, branch) at the start of the run [s]."""
        return np.array([self.intervals[0][0], branch_time(*self.intervals[0])])

    @property
    def scales(self) -> Array:
        """Scale of each coordinate [m or rad], (n,).

        The scale is the amplitude measured by a pilot run or given by the model, if available;
        otherwise, it is the characteristic length, or 1 for an angle.
        """
        if self.amplitudes is not None:
            return self.amplitudes.scales
        scales = self.equations.scales
        return self.equations.position_scales if scales is None else scales

    @property
    def duration(self) -> float:
        """Duration of the run [s]."""
        return self.intervals[-1][1] - self.intervals[0][0]

    def longest_step(self, max_step: float | None) -> float:
        """Return the longest step [s]: `max_step`, or by default a step that resolves the laws.

        The default is a twentieth of the run, or a quarter of the time scale of the laws if this is
        shorter.
        """
        if max_step is not None:
            return max_step
        scale, longest = self.equations.time_scale, self.duration / _MIN_STEPS_PER_RUN
        return longest if scale is None else min(longest, scale / MIN_STEPS_PER_TIME_SCALE)

    def require_feasible_steps(self, part: str, step: float | None, max_step: float | None) -> None:
        """Reject equal steps `step` [s], or longest adaptive ones, too short for this run.

        `part` names the integrator in the message.

        Raises
        ------
        BeamdaeError
            If the run would take more than 1e8 steps of this length.
        """
        setting = "the longest step (a quarter of the time scale of the laws)"
        if step is not None or max_step is not None:
            setting = "max_step" if step is None else "step"
        longest = self.longest_step(max_step) if step is None else step
        if self.duration > _MAX_PLANNED_STEPS * longest:
            raise BeamdaeError(
                f"{part}: {setting} of {longest:.3g} s requires {self.duration / longest:.2g} "
                f"steps in {self.duration:g} s, more than the maximum of {_MAX_PLANNED_STEPS:.0e}; "
                "use a longer step or an earlier end time."
            )


def plan_run(equations: EquationsOfMotion, times: Array, is_adaptive: bool = True) -> RunPlan:
    """Return the plan of a run from the first to the last of `times` [s].

    Raises
    ------
    BeamdaeError
        If the mass matrix is not symmetric or not positive semidefinite, the model has no
        consistent start, or a law becomes infinite.
    """
    start, end = float(times[0]), float(times[-1])
    intervals = tuple(pairwise((start, *plan_ends(equations, start, end, is_adaptive))))
    starter = ConsistencySolver(equations)
    starter.require_inertia()
    first = time_on_branch(equations.breakpoints, start, end)
    state = starter.start_state(first, equations.q0, equations.v0)
    # Cached because the pilot run and the main run need the same modes.
    modes = cache(partial(estimate_fastest_modes, starter, first, state))
    return RunPlan(starter, intervals, state, modes, is_adaptive=is_adaptive)
