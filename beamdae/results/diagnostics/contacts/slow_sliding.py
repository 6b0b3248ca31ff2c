"""Warnings about friction of parts that slide too slowly for its regularization."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.friction_sliding import SlidingTerm, compile_sliding
from beamdae.errors import format_percent
from beamdae.parts.forces.regularized_friction import RegularizedFriction
from beamdae.results.diagnostics.contacts.coulomb_sliding import (
    SlidingDynamics,
    estimate_coulomb_sliding,
    sliding_dynamics,
)
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_MAX_SLOW_SHARE = 0.5  # of the time with a normal force
# Parts that move over smaller distances, relative to the length of the mechanism, stick. A load
# below friction N lets them creep, unless drivers and joints prescribe their sliding.
_MIN_DISTANCE = 1e-2
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
# Deviation from elastic forces that friction holds where the part sticks / (friction N)
_MAX_FORCE_DEVIATION = 0.2
_RECOMMENDED_FORCE_DEVIATION = 0.04
_MIN_HELD_DEVIATION = 20.0  # larger ones are those of parts that friction holds


def slow_sliding_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning per part that slides below its regularization velocity most of the time.

    The friction force is then well below friction N. Parts that stick, and creep over less than
    0.3 % of the length of the mechanism (in bearings 0.003 rad), are exempt; if drivers and joints
    prescribe the sliding, 0.01 %. Parts that slide over more than 1 % of the largest motion or of
    the length of the mechanism (in bearings 0.01 rad) have a warning if the distance differs by
    more than 2.5 % from that with Coulomb's law, or elastic forces by more than 20 % of friction N.

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
        rows, weights, places = [], [], []
        for interval in trajectory.intervals:
            state, times = interval.state, interval.times[:: interval.nodes_per_step]
            slip, force = self.term.evaluate_with_forces(times, state)
            if self.name in interval.inactive:
                force = np.zeros_like(force)
            rows.append((interval.t, slip, force))
            steps = np.diff(interval.t)
            weights.append(0.5 * (np.append(0.0, steps) + np.append(steps, 0.0)))
            if np.any(force > self.law.min_force):
                speed = np.where(force > self.law.min_force, np.abs(slip), np.inf)
                k = int(np.argmin(speed))
                places.append((speed[k], times[k], State(*(x[k] for x in state))))
        if not places:
            return None
        _, at, slowest = min(places, key=lambda x: x[0])
        t, slip, force = (np.concatenate(x) for x in zip(*rows, strict=True))
        duration, is_loaded = np.concatenate(weights), force > self.law.min_force

        @cache
        def dynamics() -> SlidingDynamics:
            run_time = trajectory.end - trajectory.start
            return sliding_dynamics(self.equations, self.term, at, slowest, run_time)

        loaded_time = float(np.sum(duration[is_loaded]))
        if not loaded_time > 0.0:
            return None
        mean = float(duration[is_loaded] @ force[is_loaded]) / loaded_time
        limit = self.law.largest_coefficient * mean

        def is_prescribed(distance: float) -> bool:
            return limit * dynamics().compliance < _MAX_YIELD * distance

        if self._may_deviate(t, slip, is_loaded):
            known = np.isfinite(force)
            normal = np.interp(t, t[known], force[known])
            coulomb = estimate_coulomb_sliding(self.law, dynamics(), t, slip, normal)
            size = self.law.radius or min(self.equations.length, _largest_motion(trajectory))
            if coulomb.path > _MIN_DISTANCE * size and not is_prescribed(coulomb.distance):
                share = coulomb.deviation / coulomb.distance
                of_force = coulomb.deviation * dynamics().stiffness / limit
                if share < _MIN_HELD_DEVIATION and (
                    share > _MAX_DEVIATION or of_force > _MAX_FORCE_DEVIATION
                ):
                    return self._describe_deviation(share, of_force)
        return self._warning_of_slow_sliding(slip[is_loaded], duration[is_loaded], is_prescribed)

    def _may_deviate(self, times: Array, slip: Array, is_loaded: Array) -> bool:
        """Return False if the sliding by Coulomb's law cannot differ by more than the limit."""
        if self.law.static is not None:
            return True
        is_slow = is_loaded & (np.abs(slip) < _FULL_FRICTION * self.law.speed)
        if not np.any(is_slow):
            return False
        # From then on, the sliding speeds differ by at most this multiple of the regularization
        # velocity.
        deviation = _FULL_FRICTION * self.law.speed * (times[-1] - times[np.argmax(is_slow)])
        travel = np.append(0.0, np.cumsum(0.5 * (slip[1:] + slip[:-1]) * np.diff(times)))
        return bool(deviation > _MAX_DEVIATION * (np.ptp(travel) - deviation))

    def _describe_deviation(self, share: float, share_of_force: float) -> str:
        name = self.law.speed_name
        if share > _MAX_DEVIATION:
            effect = f"it slides over a distance that is wrong by about {format_percent(share)}"
            factor = _RECOMMENDED_DEVIATION / share
        else:
            error = format_percent(share_of_force)
            effect = f"elastic forces that friction holds are wrong by about {error} of friction N"
            factor = _RECOMMENDED_FORCE_DEVIATION / share_of_force
        return (
            f"{self.name}: {effect}, because {name} is {self.law.speed:g} m/s, below which the "
            f"part creeps; use {name}={self.law.speed * factor:.2g} or less."
        )

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
