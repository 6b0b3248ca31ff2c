"""Warnings about friction of parts that slide too slowly for its regularization."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.friction_sliding import SlidingTerm, compile_sliding
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.least_strain import solve_least_change
from beamdae.errors import format_percent
from beamdae.parts.forces.regularized_friction import RegularizedFriction
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_MAX_SLOW_SHARE = 0.5  # of the time with a normal force
# Parts that move over smaller distances, relative to the length of the mechanism, stick. A load
# below friction N lets them creep, unless drivers and joints prescribe their sliding.
_MIN_DISTANCE = 1e-2
_MIN_PRESCRIBED_DISTANCE = 1e-4
_SPEED_CHANGE = 0.1  # relative to the regularization velocity
# Parts that friction N moves by less than this share of a distance are not held by it there: the
# pins of a flexible coupler between a crank and a rocker turn with them.
_MAX_YIELD = 0.01
_MAX_ROWS_AT_ONCE = 256
_RATIO_AT_FRICTION_SPEED = float(np.tanh(1.0))  # friction force / (friction N)
# Parts that friction should hold, and that creep over more than this distance and more than this
# share of the distance that they slide, are reported.
_MAX_CREEP = 3e-3
_MAX_CREEP_SHARE = 0.01
_MAX_START_RATIO = 0.05  # friction force / (friction N) of a part that starts at rest
# Friction balances the load of a part that creeps: the sliding speed is constant, within this ratio
# of its median, ...
_MAX_CREEP_SPREAD = 0.2
_MIN_CREEP_SHARE = 0.5  # ... during this fraction of the time.
# Friction force / (friction N); more is the friction of a part that slides. At 0.999, the sliding
# speed is 3.8 times the regularization velocity.
_MAX_CREEP_RATIO = 0.999
# Distance crept at a reversal / distance slid between reversals. In a block that a harmonic drive
# pulls by a spring, 1.3 % change the force of the spring by 13 % of friction N, 0.6 % by 4 %.
_MAX_REVERSAL_CREEP = 0.01
_RECOMMENDED_REVERSAL_CREEP = 0.0025


def slow_sliding_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning per part that slides below its regularization velocity most of the time.

    The friction force is then well below friction N. Parts that stick, and creep over less than
    0.3 % of the length of the mechanism (in bearings 0.003 rad), are exempt; if drivers and joints
    prescribe the sliding, 0.01 %. Parts that slide to and fro, faster than this velocity, have a
    warning if they creep over more than 1 % of the distance between reversals, and slide over more
    than 1 % of the largest motion and of the length of the mechanism (in bearings 0.01 rad) in all.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    for term in compile_sliding(equations):
        warning = _Sliding(equations, term).warning(trajectory)
        if warning is not None:
            yield warning


@dataclass(frozen=True)
class _Sliding:
    """Sliding of one part during a run.

    Attributes
    ----------
    equations
        Equations of motion of all parts.
    term
        Sliding velocity of the part, and the law of its friction.
    """

    equations: EquationsOfMotion
    term: SlidingTerm

    @property
    def name(self) -> str:
        return self.term.name

    @property
    def law(self) -> RegularizedFriction:
        return self.term.law

    def warning(self, trajectory: Trajectory) -> str | None:
        """Return the warning, None if there is none."""
        durations, slips, forces, places = [np.zeros(0)], [np.zeros(0)], [np.zeros(0)], []
        for interval in trajectory.intervals:
            if self.name in interval.inactive:
                continue
            state, times = interval.state, interval.times[:: interval.nodes_per_step]
            slip, force = self.term.evaluate_with_forces(times, state)
            steps = np.diff(interval.t)
            weights = 0.5 * (np.append(0.0, steps) + np.append(steps, 0.0))
            durations.append(weights)
            slips.append(slip)
            forces.append(force)
            if np.isfinite(slip).any():
                k = int(np.nanargmin(np.abs(slip)))
                places.append((abs(slip[k]), times[k], State(*(x[k] for x in state))))
        if not places:
            return None
        slowest = min(places, key=lambda x: x[0])[1:]
        duration, slip = np.concatenate(durations), np.concatenate(slips)
        is_loaded = np.isfinite(slip)
        normal = np.concatenate(forces)

        def is_prescribed(distance: float) -> bool:
            mean = np.average(normal[is_loaded], weights=duration[is_loaded])
            force = self.law.largest_coefficient * float(mean)
            displacement = self._displacement(*slowest, force, trajectory.end - trajectory.start)
            return displacement < _MAX_YIELD * distance

        slow = self._warning_of_slow_sliding(slip[is_loaded], duration[is_loaded], is_prescribed)
        if slow is not None:
            return slow
        size = self.law.radius or min(self.equations.length, _largest_motion(trajectory))
        return self._warning_of_reversals(slip, duration, size, is_prescribed)

    def _warning_of_slow_sliding(
        self, slip: Array, duration: Array, is_prescribed: Callable[[float], bool]
    ) -> str | None:
        """Return the warning of sliding that is slow most of the time, None if there is none."""
        ratio = np.tanh(slip / self.law.speed)
        total = float(np.sum(duration))
        is_slow = np.abs(ratio) < _MAX_CREEP_RATIO
        load = _constant_ratio(ratio[is_slow], duration[is_slow])
        if load is None:
            is_slow = np.abs(ratio) < _RATIO_AT_FRICTION_SPEED
        slow = float(np.sum(duration[is_slow]))
        if not slow or slow <= _MAX_SLOW_SHARE * total:
            return None
        slid = float(duration[~is_slow] @ np.abs(slip[~is_slow]))
        duration, ratio = duration[is_slow], ratio[is_slow]
        speed = self.law.speed * np.arctanh(ratio)
        # Vibrations of a part that sticks cancel.
        distance = float(np.ptp(np.append(0.0, np.cumsum(duration * speed))))
        share_of_length = distance / (self.law.radius or self.equations.length)
        is_fixed = share_of_length > _MIN_PRESCRIBED_DISTANCE and is_prescribed(distance)
        # A part that starts at rest and never slides is held under any load.
        is_held = load is not None or (not slid and abs(ratio[0]) < _MAX_START_RATIO)
        has_crept = is_held and share_of_length > _MAX_CREEP and distance > _MAX_CREEP_SHARE * slid
        if not (share_of_length > _MIN_DISTANCE or is_fixed or has_crept):
            return None
        limit = f"{self.law.coefficient_name if self.law.static is None else 'static'} N"
        name = self.law.speed_name
        if not is_fixed and has_crept:
            amount = f"{distance:.3g} m"
            if self.law.radius is not None:
                amount = f"{distance / self.law.radius:.3g} rad"
            largest = format_percent(float(np.max(np.abs(ratio))), 3)
            size = format_percent(load, 3) if load else f"up to {largest}"
            return (
                f"{self.name}: the load is {size} of {limit}, so that friction "
                f"should hold it, but it creeps over {amount}, because {name} is "
                f"{self.law.speed:g} m/s; "
                f"use a smaller {name}=."
            )
        mean = float(duration @ np.abs(ratio)) / slow
        if mean > _RATIO_AT_FRICTION_SPEED:
            return None
        what = "contact" if self.law.is_contact else "run"
        return (
            f"{self.name}: the sliding speed is below {name} ({self.law.speed:g} m/s) during "
            f"{100.0 * slow / total:.0f} % of the {what}, which reduces the friction to "
            f"{100.0 * mean:.0f} % of {limit}; use a smaller {name}=."
        )

    def _warning_of_reversals(
        self, slip: Array, duration: Array, size: float, is_prescribed: Callable[[float], bool]
    ) -> str | None:
        """Return the warning of creep between sliding to and fro, None if there is none.

        Parts that slide over less than 1 % of the `size` [m] in all are exempt.
        """
        # Phases of sliding (1, -1), of creep (0) and without a normal force (2)
        phase = np.where(np.abs(slip) < self.law.speed, 0.0, np.sign(slip))
        phase[np.isnan(slip)] = 2.0
        starts = np.flatnonzero(np.diff(phase, prepend=np.nan))
        distance = np.add.reduceat(np.nan_to_num(np.abs(slip)) * duration, starts)
        phase = phase[starts]
        is_sliding = np.abs(phase) == 1.0
        n_reversals = int(np.count_nonzero(np.diff(phase[is_sliding])))
        if not n_reversals:
            return None
        is_reversal = (phase[1:-1] == 0.0) & (phase[:-2] * phase[2:] == -1.0)
        creep = float(np.sum(distance[1:-1][is_reversal])) / n_reversals
        slid = float(np.sum(distance[is_sliding]))
        stroke = slid / (n_reversals + 1)
        share = creep / stroke
        if slid < _MIN_DISTANCE * size or share <= _MAX_REVERSAL_CREEP or is_prescribed(stroke):
            return None
        name = self.law.speed_name
        speed = self.law.speed * _RECOMMENDED_REVERSAL_CREEP / share
        return (
            f"{self.name}: at each reversal, it creeps over {format_percent(share)} of the "
            f"distance between reversals, because {name} is {self.law.speed:g} m/s, which reduces "
            "the friction there and relaxes forces that it should hold; use "
            f"{name}={speed:.2g} or less."
        )

    def _displacement(self, time: Array, state: State, force: float, duration: float) -> float:
        """Return by how much a friction force [N] changes the sliding [m] of a run.

        Drivers and joints prescribe the sliding, except for elastic deformations by the force and
        motions that it causes against inertia in the run of this duration [s].
        """
        solver, gradient = ConsistencySolver(self.equations), self._gradient(time, state)
        stiffness, _, mass = solver.linearize_forces(time, solver.rest_state(state.q))
        rows = solver.constraint_matrix(time, state.q)
        gaps = np.zeros(rows.shape[0])
        change = solve_least_change(stiffness + mass / duration**2, rows, gaps, force * gradient)
        return abs(float(gradient @ change))

    def _gradient(self, time: Array, state: State) -> Array:
        """Return the derivative of the sliding speed by the velocities, (n,)."""
        scales = self.equations.position_scales
        changes = _SPEED_CHANGE * self.law.speed / self.equations.length * scales
        (before,) = self.term.evaluate(time[None], State(*(x[None] for x in state)))
        rates = []
        for k in range(0, len(changes), _MAX_ROWS_AT_ONCE):
            columns = range(k, min(k + _MAX_ROWS_AT_ONCE, len(changes)))
            times, *values = (np.repeat(x[None], len(columns), axis=0) for x in (time, *state))
            states = State(*values)
            states.v[np.arange(len(columns)), columns] += changes[columns]
            rates.append((self.term.evaluate(times, states) - before) / changes[columns])
        return np.concatenate(rates)


def _largest_motion(trajectory: Trajectory) -> float:
    """Return the largest change of a coordinate in a run [m or rad]."""
    rows = [x.rows.q for x in trajectory.intervals]
    low, high = (np.array([f(x, axis=0) for x in rows]) for f in (np.min, np.max))
    return float(np.max(np.max(high, axis=0) - np.min(low, axis=0), initial=0.0))


def _constant_ratio(ratio: Array, duration: Array) -> float | None:
    """Return the median of |ratio| if the sliding speed is near its median most of the time."""
    if not float(np.sum(duration)) > 0.0:
        return None
    order = np.argsort(ratio)
    share = np.cumsum(duration[order]) / np.sum(duration)
    median = ratio[order[min(int(np.searchsorted(share, 0.5)), len(ratio) - 1)]]
    speed, usual = np.arctanh(ratio), np.arctanh(median)
    is_near = np.abs(speed - usual) <= _MAX_CREEP_SPREAD * abs(usual)
    if float(np.sum(duration[is_near])) <= _MIN_CREEP_SHARE * float(np.sum(duration)):
        return None
    return abs(float(median))
