"""Sliding with Coulomb's law, estimated from a run with regularized friction.

The deviation e of the sliding from that of the run obeys, with the effective mass m and the
stiffness k of the sliding, the rate v and normal force N of the run,

    m e'' + k e = mu N (tanh(v / v_r) - sign(v + e')),

where sign(0) is any value between -1 and 1 at which the part sticks.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.friction_sliding import SlidingTerm
from beamdae.equations.starts.closing import solve_least_change
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.parts.forces.regularized_friction import RegularizedFriction

Array = np.ndarray

_SPEED_CHANGE = 0.1  # relative to the regularization velocity
_MAX_ROWS_AT_ONCE = 256
# Change of the sliding speed in a step, relative to the regularization velocity, below which the
# mean of the regularized sign is its value at the mean speed.
_SMALL_CHANGE = 1e-3


class SlidingDynamics(NamedTuple):
    """Mass and stiffness of the sliding of a part, from its static shape under a friction force.

    Attributes
    ----------
    compliance
        Sliding per friction force [m/N], also by motions against inertia during the run.
    inverse_mass
        Acceleration of the sliding per force [1/kg]; 0 if drivers and joints prescribe it.
    stiffness_ratio
        Stiffness per mass [1/s^2].
    coupling
        Power of the friction of other parts / power of this one, if it slides.
    """

    compliance: float
    inverse_mass: float
    stiffness_ratio: float
    coupling: float


class CoulombSliding(NamedTuple):
    """Sliding with Coulomb's law.

    Attributes
    ----------
    deviation
        Largest deviation from the sliding of the run, or of the distance if it is larger [m].
    distance
        Largest distance between two positions [m].
    sliding_share
        Share of the impulse of the normal force during which the part slides.
    friction_ratio
        Friction of the run / friction with Coulomb's law, on average during this share.
    """

    deviation: float
    distance: float
    sliding_share: float
    friction_ratio: float


def sliding_dynamics(
    e: EquationsOfMotion,
    term: SlidingTerm,
    time: Array,
    state: State,
    duration: float,
    others: Iterable[tuple[SlidingTerm, float]] = (),
) -> SlidingDynamics:
    """Return mass and stiffness of the sliding at a state of a run of this `duration` [s].

    `others` are other parts with friction, and their friction relative to that of `term`.
    """
    solver, gradient = ConsistencySolver(e), _sliding_gradient(e, term, time, state)
    stiffness, _, mass = solver.linearize_forces(time, solver.rest_state(state.q))
    rows = solver.constraint_matrix(time, state.q)
    gaps = np.zeros(rows.shape[0])
    shape = solve_least_change(stiffness + mass / duration**2, rows, gaps, gradient)
    compliance = float(gradient @ shape)
    inertia, elasticity = float(shape @ (mass @ shape)), float(shape @ (stiffness @ shape))
    if not inertia > 0.0:
        return SlidingDynamics(abs(compliance), 0.0, 0.0, 0.0)
    power = sum(
        friction * abs(float(_sliding_rates(e, other, time, state, shape[None])[0]))
        for other, friction in others
    )
    return SlidingDynamics(
        compliance=abs(compliance),
        inverse_mass=compliance**2 / inertia,
        stiffness_ratio=max(elasticity / inertia, 0.0),
        coupling=power / abs(compliance),
    )


def estimate_coulomb_sliding(
    law: RegularizedFriction,
    dynamics: SlidingDynamics,
    times: Array,
    velocities: Array,
    normal_forces: Array,
) -> CoulombSliding:
    """Return the sliding with Coulomb's law from times, sliding velocities and forces of a run."""
    v0, v1 = velocities[:-1], velocities[1:]
    normal = 0.5 * (normal_forces[:-1] + normal_forces[1:])
    coefficient = law.coulomb_coefficient(0.5 * (v0 + v1))
    regularized = normal * coefficient * _mean_sign(v0 / law.speed, v1 / law.speed)
    rows = zip(*(x.tolist() for x in (np.diff(times), v0, v1, normal, regularized)), strict=True)

    static = law.coefficient if law.static is None else law.static
    v, e, position = float(velocities[0]), 0.0, 0.0
    sliding = impulse = impulse_of_run = 0.0
    deviation = lowest = highest = lowest_of_run = highest_of_run = 0.0
    for step, begin, end, normal_force, friction_force in rows:
        # Accelerations
        force = dynamics.inverse_mass * normal_force
        friction = dynamics.inverse_mass * friction_force
        if step <= 0.0:
            v += end - begin  # at impacts between intervals
            continue
        change = (end - begin) / step
        left, start = step, begin
        # Until it stops, and afterwards
        for _ in range(2):
            if left <= 0.0:
                break
            kinetic = force * law.coulomb_coefficient(v + 0.5 * change * left)
            stiffening = 1.0 + 0.5 * left * left * dynamics.stiffness_ratio
            restoring = dynamics.stiffness_ratio * (e + left * (v - start))
            load = change + (friction - restoring) / stiffening
            if v:
                rate = load - math.copysign(kinetic, v) / stiffening
                duration = min(left, -v / rate) if rate * v < 0.0 else left
            elif abs(load) > force * static / stiffening:
                rate, duration = load - math.copysign(kinetic, load) / stiffening, left
            else:
                rate, duration = 0.0, left
            slid = (v + 0.5 * rate * duration) * duration
            e += slid - (start + 0.5 * change * duration) * duration
            v = v + rate * duration if duration == left else 0.0
            start += change * duration
            position, left = position + slid, left - duration
            if slid:
                coefficient_at_slip = law.coulomb_coefficient(slid / duration)
                sliding += normal_force * duration
                impulse += normal_force * coefficient_at_slip * duration
                impulse_of_run += math.copysign(friction_force, slid * friction_force) * duration
        deviation = max(deviation, abs(e))
        lowest, highest = min(lowest, position), max(highest, position)
        of_run = position - e
        lowest_of_run, highest_of_run = min(lowest_of_run, of_run), max(highest_of_run, of_run)
    distance = highest - lowest
    # Both ends of a motion to and fro deviate.
    deviation = max(deviation, abs(distance - (highest_of_run - lowest_of_run)))
    total = float(np.sum(np.diff(times) * normal))
    share = sliding / total if total > 0.0 else 0.0
    return CoulombSliding(deviation, distance, share, impulse_of_run / impulse if impulse else 1.0)


def _mean_sign(begin: Array, end: Array) -> Array:
    """Return the mean of tanh(x) if x changes at a constant rate."""
    change = end - begin
    is_small = np.abs(change) < _SMALL_CHANGE
    integral = _log_cosh(end) - _log_cosh(begin)
    return np.where(
        is_small, np.tanh(0.5 * (begin + end)), integral / np.where(is_small, 1.0, change)
    )


def _log_cosh(x: Array) -> Array:
    return np.abs(x) + np.log1p(np.exp(-2.0 * np.abs(x)))  # plus a constant


def _sliding_gradient(e: EquationsOfMotion, term: SlidingTerm, time: Array, state: State) -> Array:
    """Return the derivative of the sliding speed by the velocities, (n,)."""
    rows = [
        _sliding_rates(e, term, time, state, np.eye(min(_MAX_ROWS_AT_ONCE, e.n - k), e.n, k))
        for k in range(0, e.n, _MAX_ROWS_AT_ONCE)
    ]
    return np.concatenate(rows)


def _sliding_rates(
    e: EquationsOfMotion, term: SlidingTerm, time: Array, state: State, shapes: Array
) -> Array:
    """Return the derivatives (k,) of the sliding speed by the amplitudes of velocities (k, n)."""
    sizes = np.max(np.abs(shapes / e.position_scales), axis=1)
    changes = _SPEED_CHANGE * term.law.speed / (e.length * sizes)
    times, *values = (np.repeat(x[None], 1 + len(shapes), axis=0) for x in (time, *state))
    states = State(*values)
    states.v[1:] += changes[:, None] * shapes
    speeds, _ = term.evaluate_with_forces(times, states)
    return (speeds[1:] - speeds[0]) / changes
