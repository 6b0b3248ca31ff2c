"""Warnings about friction whose regularization changes the sliding of parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.friction_sliding import SlidingTerm, compile_sliding
from beamdae.errors import format_percent
from beamdae.parts.forces.regularized_friction import RegularizedFriction
from beamdae.results.diagnostics.contacts.coulomb_sliding import (
    CoulombSliding,
    SlidingDynamics,
    estimate_coulomb_sliding,
    sliding_dynamics,
)
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_MAX_SLOW_SHARE = 0.5  # of the time with a normal force
# Sliding that drivers and joints prescribe over smaller distances, relative to the length of the
# mechanism, is negligible.
_MIN_PRESCRIBED_DISTANCE = 1e-4
# Parts that friction N moves by less than this share of a distance are not held by it there: the
# pins of a flexible coupler between a crank and a rocker turn with them.
_MAX_YIELD = 0.01
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
# Sliding speed / regularization velocity from which on friction is that of a part that slides
_FULL_FRICTION = float(np.arctanh(_MAX_CREEP_RATIO))
# Deviation from the sliding with Coulomb's law / distance. Deviations are proportional to the
# regularization velocity, and in conveyors and inertia drives within a tenth of those from runs
# with a thirtieth of this velocity, from 0.1 % to 80 %.
_MAX_DEVIATION = 0.025
_RECOMMENDED_DEVIATION = 0.005
_MIN_HELD_DEVIATION = 20.0  # larger ones are those of parts that friction holds
# Creep shifts the times at which sliding with static friction begins, and changes positions by up
# to 9 times as much as it moves the part, as in blocks on belts.
_MAX_AMPLIFICATION = 10.0
# Largest reduction of the friction of parts that slide during this share of the time or more
_MAX_REDUCTION, _MIN_SLIDING_SHARE = 0.1, 0.5
# Estimates keep the friction of other parts that slide with it. If its power exceeds this share of
# the power of the part, estimates of errors of 1 % are up to 10 %, as in two blocks on a spring.
_MIN_COUPLING = 0.1
_MAX_SHARED_DEVIATION = 0.15


def slow_sliding_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning per part whose sliding differs from that with Coulomb's law.

    The distance differs by more than 2.5 % (15 % if parts with friction slide together), the
    friction of a part without static friction that slides is on average more than 10 % too small,
    or a part creeps that friction should hold, by more than 0.3 % of the length of the mechanism
    (in bearings 0.003 rad).

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    slidings = [_record_sliding(equations, x, trajectory) for x in compile_sliding(equations)]
    present = [x for x in slidings if x is not None]
    for sliding in present:
        others = [x for x in present if x is not sliding]
        warning = _SlidingCheck(equations, sliding, others).warning()
        if warning is not None:
            yield warning


class _Place(NamedTuple):
    """State of a run, and the equations of the parts that are active there."""

    equations: EquationsOfMotion
    time: Array
    state: State


class _Sliding(NamedTuple):
    """Sliding of one part at the steps of a run.

    Attributes
    ----------
    term
        Sliding velocity of the part, and the law of its friction.
    times, velocities, normal_forces, durations
        Times [s], sliding velocities [m/s], normal forces [N] and time steps [s], (k,) each.
    slowest
        Place with the lowest sliding speed with a normal force.
    """

    term: SlidingTerm
    times: Array
    velocities: Array
    normal_forces: Array
    durations: Array
    slowest: _Place

    @property
    def is_loaded(self) -> Array:
        return self.normal_forces > self.term.law.min_force

    @property
    def travel(self) -> float:
        """Largest distance between two positions of the part [m]."""
        mean = 0.5 * (self.velocities[1:] + self.velocities[:-1])
        return float(np.ptp(np.append(0.0, np.cumsum(mean * np.diff(self.times)))))

    @property
    def friction(self) -> float:
        """Mean friction N with a normal force [N]."""
        forces, durations = self.normal_forces[self.is_loaded], self.durations[self.is_loaded]
        return self.term.law.largest_coefficient * float(np.average(forces, weights=durations))


def _record_sliding(
    equations: EquationsOfMotion, term: SlidingTerm, trajectory: Trajectory
) -> _Sliding | None:
    """Return the sliding of a part during a run, None without friction."""
    rows, places = [], []
    for interval in trajectory.intervals:
        state, times = interval.state, interval.times[:: interval.nodes_per_step]
        slip, force = term.evaluate_with_forces(times, state)
        if term.name in interval.inactive:
            force = np.zeros_like(force)
        steps = np.diff(interval.t)
        durations = 0.5 * (np.append(0.0, steps) + np.append(steps, 0.0))
        rows.append((interval.t, slip, force, durations))
        speed = np.where(force > term.law.min_force, np.abs(slip), np.inf)
        k = int(np.argmin(speed))
        place = _Place(
            interval.active_equations(equations), times[k], State(*(x[k] for x in state))
        )
        places.append((speed[k], place))
    _, slowest = min(places, key=lambda x: float(x[0]))
    t, slip, force, duration = (np.concatenate(x) for x in zip(*rows, strict=True))
    sliding = _Sliding(term, t, slip, force, duration, slowest)
    has_friction = np.any(sliding.durations[sliding.is_loaded]) and sliding.friction > 0.0
    return sliding if has_friction else None


@dataclass(frozen=True)
class _SlidingCheck:
    """Check of the sliding of one part during a run.

    Attributes
    ----------
    equations
        Equations of motion of all parts.
    sliding
        Sliding of the part.
    others
        Sliding of the other parts with friction.
    """

    equations: EquationsOfMotion
    sliding: _Sliding
    others: Sequence[_Sliding]

    @property
    def name(self) -> str:
        return self.sliding.term.name

    @property
    def law(self) -> RegularizedFriction:
        return self.sliding.term.law

    @property
    def size(self) -> float:
        """Size of the motions that matter [m]."""
        return self.law.radius or self.equations.length

    @cached_property
    def dynamics(self) -> SlidingDynamics:
        """Mass and stiffness of the sliding where the part is slowest."""
        others = [(x.term, x.friction / self.sliding.friction) for x in self.others]
        duration = float(self.sliding.times[-1] - self.sliding.times[0])
        equations, time, state = self.sliding.slowest
        return sliding_dynamics(equations, self.sliding.term, time, state, duration, others)

    def warning(self) -> str | None:
        """Return the warning, None if there is none."""
        share = self._relative_deviation() if self._may_deviate() else 0.0
        reduction = self._reduction() if self._may_be_reduced() else 0.0
        is_shared = share > _MAX_DEVIATION and self.dynamics.coupling > _MIN_COUPLING
        has_deviation = share > (_MAX_SHARED_DEVIATION if is_shared else _MAX_DEVIATION)
        clauses, error = [], 0.0
        if has_deviation:
            error, size = share, format_percent(share)
            clauses.append(f"it slides over a distance that is wrong by about {size}")
        if reduction > _MAX_REDUCTION:
            error, left = max(error, reduction), format_percent(1.0 - reduction)
            clauses.append(f"while it slides, its friction is on average {left} of that of its law")
        if clauses:
            name = self.law.speed_name
            effect = "the part creeps" if has_deviation else "friction is reduced"
            speed = self.law.speed * _RECOMMENDED_DEVIATION / error
            return (
                f"{self.name}: {' and, '.join(clauses)}, because {name} is {self.law.speed:g} m/s, "
                f"below which {effect}; use {name}={speed:.2g}."
            )
        return self._warning_of_creep()

    def _is_prescribed(self, distance: float) -> bool:
        """Return True if drivers and joints prescribe the sliding over a distance [m]."""
        return self.sliding.friction * self.dynamics.compliance < _MAX_YIELD * distance

    def _may_deviate(self) -> bool:
        """Return False if the sliding by Coulomb's law cannot differ by more than the limit."""
        times, slip = self.sliding.times, self.sliding.velocities
        is_slow = self.sliding.is_loaded & (np.abs(slip) < _FULL_FRICTION * self.law.speed)
        if not np.any(is_slow):
            return False
        travel = self.sliding.travel
        if self.law.static is not None:
            creep = float(self.sliding.durations[is_slow] @ np.abs(slip[is_slow]))
            return _MAX_AMPLIFICATION * creep > _MAX_DEVIATION * travel
        # From then on, the sliding speeds differ by at most this multiple of the regularization
        # velocity.
        deviation = _FULL_FRICTION * self.law.speed * (times[-1] - times[np.argmax(is_slow)])
        return bool(deviation > _MAX_DEVIATION * (travel - deviation))

    def _may_be_reduced(self) -> bool:
        """Return False if the mean friction, also of a part that sticks, is near its limit."""
        is_loaded = self.sliding.is_loaded
        ratio = np.abs(np.tanh(self.sliding.velocities[is_loaded] / self.law.speed))
        weights = (self.sliding.durations * self.sliding.normal_forces)[is_loaded]
        return bool(np.average(ratio, weights=weights) < 1.0 - _MAX_REDUCTION)

    @cached_property
    def coulomb(self) -> CoulombSliding:
        """Sliding with Coulomb's law."""
        times, force = self.sliding.times, self.sliding.normal_forces
        is_known = np.isfinite(force)
        normal = np.interp(times, times[is_known], force[is_known])
        dynamics = self.dynamics
        if self._is_prescribed(self.sliding.travel):
            dynamics = dynamics._replace(inverse_mass=0.0, stiffness_ratio=0.0)
        return estimate_coulomb_sliding(self.law, dynamics, times, self.sliding.velocities, normal)

    def _relative_deviation(self) -> float:
        """Return the error of the distance that the part slides, 0 if it rests."""
        if self.coulomb.distance <= _MAX_CREEP * self.size:
            return 0.0
        share = self.coulomb.deviation / self.coulomb.distance
        return share if share < _MIN_HELD_DEVIATION else 0.0

    def _reduction(self) -> float:
        """Return the share by which friction is reduced while the part slides, 0 if it sticks.

        Friction is less than that of its law also while stick-slip with static friction sticks.
        """
        if self.law.static is not None:
            return 0.0
        is_prescribed = self._is_prescribed(self.coulomb.distance)
        smallest = _MIN_PRESCRIBED_DISTANCE if is_prescribed else _MAX_CREEP
        is_resting = self.coulomb.distance <= smallest * self.size
        if is_resting or self.coulomb.sliding_share < _MIN_SLIDING_SHARE:
            return 0.0
        return 1.0 - self.coulomb.friction_ratio

    def _warning_of_creep(self) -> str | None:
        """Return the warning of a part that friction should hold, None if there is none."""
        is_loaded = self.sliding.is_loaded
        slip, duration = self.sliding.velocities[is_loaded], self.sliding.durations[is_loaded]
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
        # A part that starts at rest and never slides is held under any load.
        is_held = load is not None or (not slid and abs(ratio[0]) < _MAX_START_RATIO)
        has_crept = distance > max(_MAX_CREEP * self.size, _MAX_CREEP_SHARE * slid)
        if not (is_held and has_crept) or self._is_prescribed(distance):
            return None
        limit = f"{self.law.coefficient_name if self.law.static is None else 'static'} N"
        name = self.law.speed_name
        amount = f"{distance:.3g} m"
        if self.law.radius is not None:
            amount = f"{distance / self.law.radius:.3g} rad"
        largest = format_percent(float(np.max(np.abs(ratio))), 3)
        size = format_percent(load, 3) if load else f"up to {largest}"
        return (
            f"{self.name}: the load is {size} of {limit}, so that friction should hold it, but "
            f"it creeps over {amount}, because {name} is {self.law.speed:g} m/s; use a smaller "
            f"{name}=."
        )


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
