"""What an adaptive integrator tests its error against, and up to which order it may go.

The choices rest on measurements: validation/tolerances prints the table behind them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from beamdae.equations.formulations import FirstOrder, Formulation, State
from beamdae.equations.natural_frequencies import Mode
from beamdae.integrators.run_plan import Route

Array = np.ndarray

ERROR_CONTROL = ("auto", "positions", "velocities", "all")
_UNTESTED = 1e10
# The most that Newton's iteration may leave of multipliers that the error test does not see, of the
# force; for small tolerances it is their square root, but on index 3, where rounding leaves more.
_LEFT = 1e-3
# What a chain of roundings leaves of a position, relative to the size of the mechanism.
ROUNDING = 1e-14

# Modes this much faster than the motion are stiff: the step is meant to pass over them. BDF loses
# more by that than methods of order 5 that are as stable.
STIFF_FOR_BDF, STIFF_FOR_RADAU = 300.0, 30.0
# BDF of order 5 is stable for damping ratios above 0.62, cos of its angle of 52 degrees.
_STABLE_RATIO = 0.62
# Steps of order 2 resolve modes up to this over the square root of rtol, times the rate of the
# motion: lightly damped ones among them cost order 5 nothing (validation/tolerances, --damping).
_RESOLVED = 12.0
# Below this rtol order 2 takes longer than a method of order 5 as stable (validation/tolerances).
_ORDER_2_LOSES = 3e-6
# The largest error over a run stays below 100 rtol (30 rtol with damping) with these factors.
_SAFETY = 0.045
_ASYMPTOTIC = {1: 16.0, 2: 6.0, 3: 2.0, 4: 0.7, 5: 0.3}


@dataclass(frozen=True)
class Scales:
    """Natural sizes of a mechanism's motion.

    Attributes
    ----------
    position
        Of each coordinate [m or rad]: its motion, or else the mechanism.
    size
        Of the mechanism, by coordinate [m or rad]: what positions are rounded against.
    rate
        Characteristic rate of the motion [1/s]; velocities are of size position * rate.
    force
        Of the multipliers [N or N m].
    """

    position: Array
    size: Array
    rate: float
    force: float

    def tolerances(self, local: float) -> Array:
        """Tolerances of the positions, at least what rounding leaves of them."""
        return np.maximum(local * self.position, ROUNDING * self.size)

    def first_step(self, local: float, state: State) -> float:
        """Step [s] over which accelerations move a position by its tolerance."""
        fastest = float(np.max(np.abs(state.a) / self.tolerances(local)))
        return float(np.sqrt(2.0 / max(fastest, self.rate**2 / local)))


def scales(route: Route) -> Scales:
    """Natural sizes from what a scout saw, the consistent start and the laws' time scale."""
    equations, state, position = route.equations, route.state, route.scales
    candidates = [1.0 / route.duration]
    if route.amplitudes is None:
        candidates.append(float(np.max(np.abs(state.v / position))))
        candidates.append(float(np.sqrt(np.max(np.abs(state.a / position)))))
    else:
        candidates.append(route.amplitudes.rate)
    if equations.time_scale is not None:
        candidates.append(1.0 / equations.time_scale)
    rate = max(candidates)
    inertial = route.starter.forces(route.time, state, position * rate**2)
    force = max(float(np.max(np.abs(inertial))), float(np.max(np.abs(state.lam), initial=0.0)))
    return Scales(position, equations.position_scales, rate, force)


@dataclass(frozen=True)
class ErrorControl:
    """Resolved error control of one run.

    Attributes
    ----------
    policy
        "positions", "velocities" (and positions) or "all" (and multipliers).
    max_order
        Highest BDF order.
    reason
        Why "auto" chose so, one sentence.
    loses_below
        The rtol below which a method of order 5 that is as stable takes less than BDF.
    """

    policy: str
    max_order: int
    reason: str
    loses_below: float = 0.0

    def tolerance(self, rtol: float, size: int) -> float:
        """Tolerance of the local error test that keeps the error of a whole run near `rtol`.

        The test norm is a root mean square over `size` components: times sqrt(size) it bounds the
        largest one. The error of a run grows with the local tolerance to the power k / (k + 1), k
        the order, so for small rtol the local tolerance must fall with rtol^((k + 1) / k), as in
        RADAU5 (Hairer & Wanner, Solving ODEs II, 1996, section IV.8).
        """
        k = self.max_order
        return min(_SAFETY * rtol, _ASYMPTOTIC[k] * rtol ** ((k + 1) / k)) / np.sqrt(size)

    def absolute(
        self, tolerance: float, scales: Scales, form: FirstOrder, iterated: bool = False
    ) -> Array:
        """Absolute tolerances of (q, v, multipliers); untested components get a huge one.

        Untested multipliers that are `iterated` get one for Newton's iteration alone; their time
        integrals get that over a step of the length whose error of order k + 1 is the tolerance.
        """
        n, m = form.equations.n, form.equations.m
        rate = scales.rate if form.formulation.impulses else 1.0
        atol = np.full(form.size, _UNTESTED)
        atol[:n] = positions = scales.tolerances(tolerance)
        if self.policy in ("velocities", "all"):
            atol[n : 2 * n] = positions * scales.rate
        if self.policy == "all":
            atol[2 * n :] = tolerance * scales.force / rate
        elif iterated:
            root = np.sqrt(form.size)
            small = np.sqrt(tolerance * root) if form.formulation.index < 3 else _LEFT
            left = min(_LEFT, small) * scales.force / root
            step = (tolerance * root) ** (1.0 / (self.max_order + 1)) / rate
            atol[2 * n : 2 * n + m] = left * (step if form.formulation.impulses else 1.0)
        return atol

    def untested(self, form: FirstOrder) -> Array | None:
        """Which of (q, v, multipliers) the error test does not see, if any."""
        n = form.equations.n
        begin = {"positions": n, "velocities": 2 * n, "all": form.size}[self.policy]
        return np.arange(form.size) >= begin if begin < form.size else None


def resolve(
    policy: str,
    max_order: int | str,
    formulation: Formulation,
    rtol: float,
    rate: float,
    stiff_ratio: float,
    fastest_modes: Callable[[], tuple[Mode, ...]],
    multipliers_matter: bool = False,
) -> ErrorControl:
    """Resolve "auto": which components are tested, and the highest order.

    `rate` is that of the motion, `stiff_ratio` how much faster modes have to be to be passed over,
    `fastest_modes` gives the fastest natural mode of each body, `multipliers_matter` is whether
    forces depend on multipliers, or constraints leave no motion free.

    Without modes much faster than the motion, positions and velocities are tested and the order
    goes up to 5. With such modes only positions are tested: resolving axial vibrations would cost
    20 to 1000 times as much. BDF of order 3 to 5 is unstable next to the imaginary axis, where
    undamped modes sit: the order stops at 2 unless in every body all modes that steps of order 2
    would not resolve anyhow are overdamped, as material damping makes them if there is enough of
    it. On index 3 only positions are tested, the error of velocities grows there as the step falls.
    Multipliers stall "ggl" and "index2", and "index1" as it drifts. Of "stabilized-index1" they are
    tested where no mode is passed over and either nothing is free, for positions and velocities of
    what is driven throughout say nothing of them (drive torques were off by 13 % at rtol 1e-5), or
    friction depends on them.
    """
    if policy != "auto" and max_order != "auto":
        return ErrorControl(policy, int(max_order), "as set")
    modes = fastest_modes()
    fastest = max((mode.frequency for mode in modes), default=0.0)
    stiff = stiff_ratio * rate
    light = max((_lightly_damped(mode) for mode in modes), default=0.0)
    overdamped = all(m.damping_ratio > _STABLE_RATIO for m in modes if m.frequency > stiff)
    if fastest <= stiff:
        choice, order, reason = "velocities", 5, "no mode is much faster than the motion"
        loses_below = np.inf if fastest > STIFF_FOR_RADAU * rate else 0.0
    elif overdamped and light <= _RESOLVED * rate / np.sqrt(rtol):
        choice, order, reason = "positions", 5, "the fast modes are overdamped"
        loses_below = 0.0
    else:
        choice, order, reason = "positions", 2, "fast modes are lightly damped"
        loses_below = _ORDER_2_LOSES
    if formulation.index == 3:
        choice = "positions"
    if multipliers_matter and formulation.impulses and choice == "velocities":
        choice = "all"
    reason = (
        f"{reason} (fastest {fastest:.3g} rad/s, lightly damped up to {light:.3g} rad/s, "
        f"motion {rate:.3g} rad/s)"
    )
    return ErrorControl(
        choice if policy == "auto" else policy,
        order if max_order == "auto" else int(max_order),
        reason,
        loses_below if max_order == "auto" else 0.0,
    )


def _lightly_damped(mode: Mode) -> float:
    """Frequency up to which the modes of a body may be lightly damped [rad/s].

    Material damping grows with the frequency: those above share _STABLE_RATIO are stable.
    """
    if mode.damping_ratio <= _STABLE_RATIO:
        return mode.frequency
    return mode.frequency * _STABLE_RATIO / mode.damping_ratio
