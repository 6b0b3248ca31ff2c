"""What an adaptive integrator tests its error against, and up to which order it may go.

The choices rest on measurements: validation/tolerances prints the table behind them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from beamdae.equations.consistent_start import Starter
from beamdae.equations.formulations import FirstOrder, Formulation, State
from beamdae.equations.spectrum import Mode

Array = np.ndarray

ERROR_CONTROL = ("auto", "positions", "velocities", "all")
_UNTESTED = 1e10

# Modes this much faster than the motion are stiff: the step is meant to pass over them.
_STIFF_RATIO = 300.0
# BDF of order 5 is stable for damping ratios above 0.62, cos of its angle of 52 degrees.
_STABLE_RATIO = 0.62
# Lightly damped modes up to so many times the rate of the motion cost less than what the order
# gains (validation/tolerances, --damping).
_LIGHTLY_DAMPED = 2e4
# The largest error over a run stays below 100 rtol (30 rtol with damping) with these factors.
_SAFETY = 0.08
_ASYMPTOTIC = 16.0


@dataclass(frozen=True)
class Scales:
    """Natural sizes of a mechanism's motion.

    Attributes
    ----------
    position
        Of each coordinate: characteristic length, or 1 rad.
    rate
        Characteristic rate of the motion [1/s]; velocities are of size position * rate.
    force
        Of the multipliers [N or N m].
    """

    position: Array
    rate: float
    force: float


def scales(starter: Starter, time: Array, state: State, duration: float) -> Scales:
    """Natural sizes from the consistent start, the laws' time scale and the length of the run."""
    equations = starter.equations
    position = equations.position_scales
    candidates = [
        1.0 / duration,
        float(np.max(np.abs(state.v / position))),
        float(np.sqrt(np.max(np.abs(state.a / position)))),
    ]
    if equations.time_scale is not None:
        candidates.append(1.0 / equations.time_scale)
    rate = max(candidates)
    inertial = starter.forces(time, state, position * rate**2)
    force = max(float(np.max(np.abs(inertial))), float(np.max(np.abs(state.lam), initial=0.0)))
    return Scales(position, rate, force)


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
    """

    policy: str
    max_order: int
    reason: str

    def tolerance(self, rtol: float, size: int) -> float:
        """Tolerance of the local error test that keeps the error of a whole run near `rtol`.

        The test norm is a root mean square over `size` components: times sqrt(size) it bounds the
        largest one. The error of a run grows with the local tolerance to the power k / (k + 1), k
        the order, so for small rtol the local tolerance must fall with rtol^((k + 1) / k), as in
        RADAU5 (Hairer & Wanner, Solving ODEs II, 1996, section IV.8).
        """
        k = self.max_order
        return min(_SAFETY * rtol, _ASYMPTOTIC * rtol ** ((k + 1) / k)) / np.sqrt(size)

    def absolute(self, tolerance: float, scales: Scales, form: FirstOrder) -> Array:
        """Absolute tolerances of (q, v, multipliers); untested components get a huge one."""
        n = form.equations.n
        atol = np.full(form.size, _UNTESTED)
        atol[:n] = tolerance * scales.position
        if self.policy in ("velocities", "all"):
            atol[n : 2 * n] = tolerance * scales.position * scales.rate
        if self.policy == "all":
            rate = scales.rate if form.formulation.impulses else 1.0
            atol[2 * n :] = tolerance * scales.force / rate
        return atol


def resolve(
    policy: str,
    max_order: int | str,
    formulation: Formulation,
    rate: float,
    fastest_mode: Callable[[], Mode],
) -> ErrorControl:
    """Resolve "auto": which components are tested, and the highest order.

    `rate` is that of the motion, `fastest_mode` gives the fastest natural mode.

    Without modes much faster than the motion, positions and velocities are tested and the order
    goes up to 5. With such modes only positions are tested: resolving axial vibrations would cost
    20 to 1000 times as much. BDF of order 3 to 5 is unstable next to the imaginary axis, where
    undamped modes sit: the order stops at 2 unless all but the slowest modes are overdamped, as
    material damping makes them if there is enough of it. On index 3 only positions
    are tested, the error of velocities grows there as the step falls; multipliers never are, they
    stall "ggl" and "index2".
    """
    if policy != "auto" and max_order != "auto":
        return ErrorControl(policy, int(max_order), "as set")
    frequency, damping = fastest_mode()
    if frequency <= _STIFF_RATIO * rate:
        choice, order, reason = "velocities", 5, "no mode is much faster than the motion"
    elif damping * _LIGHTLY_DAMPED * rate >= _STABLE_RATIO * frequency:
        # Material damping grows with the frequency: above this share of it all modes are stable.
        choice, order, reason = "positions", 5, "the fast modes are overdamped"
    elif damping > _STABLE_RATIO:
        choice, order, reason = "positions", 2, "modes below the fastest are lightly damped"
    else:
        choice, order, reason = "positions", 2, "fast modes are undamped"
    if formulation.index == 3:
        choice = "positions"
    reason = f"{reason} (fastest {frequency:.3g} rad/s, damping ratio {damping:.2g})"
    return ErrorControl(
        choice if policy == "auto" else policy,
        order if max_order == "auto" else int(max_order),
        reason,
    )
