"""Error control of adaptive integrators: tested components, tolerances and highest order.

The choices rest on measurements, which validation/tolerances prints as tables.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import FirstOrderForm, Formulation
from beamdae.integrators.run_plan import Mode, RunPlan

Array = np.ndarray

ERROR_CONTROL = ("auto", "positions", "rigid velocities", "velocities", "all")
# Absolute tolerance of unknowns outside the error test.
_UNTESTED_ATOL = 1e10
# Upper bound on the Newton error of untested multipliers, relative to the force scale. The bound is
# lowered to the square root of a tight tolerance, except in the index-3 form, where rounding errors
# are larger.
_MAX_MULTIPLIER_ERROR = 1e-3
# Accumulated rounding error of a position, relative to the size of the mechanism, ...
POSITION_ROUNDING = 1e-14
# ... and to its largest coordinate, as in `consistent_start`. With half of this value, Radau passes
# its error test up to 1 km from the origin; with a fifth, it fails at 300 m.
_COORDINATE_ROUNDING = 2e-15

# Modes are stiff, and their vibrations are not resolved, if they are this many times faster than
# the motion. The ratio is larger for BDF, because unresolved modes limit its order to 2.
STIFF_RATIO_BDF = 300.0
STIFF_RATIO_RADAU = 30.0
# Damping ratio above which BDF of order 5 is stable: cosine of its stability angle, 52 degrees.
STABLE_DAMPING_RATIO = 0.62
# Second-order steps resolve modes up to this factor times (rate of the motion) / sqrt(rtol).
# Lightly damped modes below this limit do not slow order 5 down (measured).
_RESOLVED_RATIO = 12.0
# Phase errors add up over the N periods of a run, those of free orbits with N^2. The local
# tolerance falls with N to these powers, chosen by the errors in validation/tolerances: if stiff
# modes are not resolved, ...
_PERIOD_EXPONENT = 1.0
# ... if all velocities are tested without constraints (2 (k + 1) / k at order k = 5, because the
# error of a run falls with the local tolerance to the power k / (k + 1)), ...
_PERIOD_EXPONENT_ORBITS = 2.4
# ... with constraints, whose singular positions are not passed at much tighter tolerances, ...
_PERIOD_EXPONENT_CONSTRAINED = 0.5
# ... and with constraints for the periods beyond `_MANY_PERIODS`: errors of a rigid pendulum are
# then 5 to 8 rtol after 80 periods and 4 to 9 after 260, those of `arevalo` at most 57 after 30
# times its end time. With an exponent of 1.5, they were 20 to 28, 55 to 73 and 495 rtol.
_PERIOD_EXPONENT_LONG = 2.1
# In longer runs, `Auto` runs Radau.
_MANY_PERIODS = 10.0
# With less of the regularization velocity of friction / (rtol times the largest velocity), `Auto`
# runs Radau. At rtol = 1e-5, a block on a belt with a regularization velocity of 3, 1 and 0.1 times
# 1e-6 m/s and 0.5 m/s was wrong by 0, 0.3 to 10 and 19 to 90 % with BDF, by up to 0.3 % with Radau.
_MIN_SPEED_RATIO = 2.0
# Factor of the tolerance of second-order steps if no velocities of a beam in absolute coordinates
# can be tested: the velocities of all its nodes contain fast vibrations.
_ABSOLUTE_BEAM_FACTOR = 0.05
_HIGHEST_ORDER = 5
_LIMITED_ORDER = 2
# Calibrated so that the largest error of a run stays below 100 rtol, or below 30 rtol with damping.
_LINEAR_FACTOR = 0.045
_ASYMPTOTIC_FACTORS = {1: 16.0, 2: 6.0, 3: 2.0, 4: 0.7, 5: 0.3}
# Tolerance of multipliers: this multiple of rtol, within limits, relative to their largest values
# so far, or to a fraction of the force scale of the motion, if that is larger.
_MULTIPLIER_FACTOR = 10.0
_MULTIPLIER_TOLERANCES = (1e-6, 0.01)
_LEAST_FORCE_SHARE = 1e-2
_LEAST_FORCE = 1e-200  # avoids division by zero without any forces
# Forces may jump: shorter steps, relative to the time scale of the motion, are not tested.
_SHORTEST_TESTED_STEP = 1e-4


@dataclass(frozen=True)
class MotionScales:
    """Characteristic scales of the motion of a mechanism, from which error weights are computed.

    Attributes
    ----------
    position
        Scale of each coordinate [m or rad], (n,); see `RunPlan.scales`.
    size
        Characteristic length [m] for each coordinate, or 1 for an angle, (n,); rounding errors of
        positions are relative to it.
    distance
        Largest position [m] or angle [rad], relative to `size`.
    rate
        Characteristic rate of the motion [1/s]; the scale of velocities is `position` * `rate`.
    force
        Scale of the multipliers [N or N m].
    periods
        Number of periods of the motion during the run, at least 1.
    """

    position: Array
    size: Array
    rate: float
    force: float
    periods: float = 1.0
    distance: float = 0.0

    @property
    def rounding_ratio(self) -> float:
        """Rounding errors of positions relative to those near the origin, at least 1."""
        return max(1.0, _COORDINATE_ROUNDING / POSITION_ROUNDING * self.distance)

    def tolerances(self, local: float) -> Array:
        """Return absolute position tolerances [m or rad], (n,), for the relative tolerance `local`.

        They are not smaller than rounding errors.
        """
        return np.maximum(local * self.position, POSITION_ROUNDING * self.size)

    def first_step(self, local: float, state: State) -> float:
        """Return the first step h [s], for which h^2 a / 2 is within the position tolerances.

        Here, a are the accelerations of `state`. The step is also limited to sqrt(2 local) / rate,
        where `local` is the relative tolerance.
        """
        fastest = float(np.max(np.abs(state.a) / self.tolerances(local)))
        return float(np.sqrt(2.0 / max(fastest, self.rate**2 / local)))


def motion_rate(plan: RunPlan) -> float:
    """Return the characteristic rate of the motion during a run [1/s].

    It is the largest of 1 / duration, 1 / (time scale of the laws), and the rate that a pilot run
    measured. If no pilot run measured a rate, the rates of the initial velocities and
    accelerations take its place.
    """
    equations, state, position = plan.equations, plan.state, plan.scales
    rates = [1.0 / plan.duration]
    if plan.amplitudes is None:
        rates.append(float(np.max(np.abs(state.v / position))))
        rates.append(float(np.sqrt(np.max(np.abs(state.a / position)))))
    else:
        rates.append(plan.amplitudes.rate)
    if equations.time_scale is not None:
        rates.append(1.0 / equations.time_scale)
    return max(rates)


def count_periods(plan: RunPlan) -> float:
    """Return the number of periods of the motion during a run, at least 1."""
    # A short time scale of a law does not repeat the motion.
    rate = plan.partial_rate if plan.amplitudes is None else plan.amplitudes.rate
    return max(1.0, rate * plan.duration / (2.0 * np.pi))


def reduce_tolerance(periods: float, exponent: float, long_exponent: float) -> float:
    """Return the factor of the tolerance for a number of periods, over which errors accumulate.

    The factor falls with the number of periods to the power -`exponent`, and with the power
    -`long_exponent` beyond ten periods.
    """
    few, long = min(periods, _MANY_PERIODS), max(periods / _MANY_PERIODS, 1.0)
    return few**-exponent * long**-long_exponent


def motion_scales(plan: RunPlan) -> MotionScales:
    """Return the scales of the motion during a run."""
    equations, state, position = plan.equations, plan.state, plan.scales
    rate = motion_rate(plan)
    inertial = plan.starter.force(plan.time, state.q, state.v, position * rate**2)
    force = max(float(np.max(np.abs(inertial))), float(np.max(np.abs(state.lam), initial=0.0)))
    size = equations.position_scales
    # Pressures and other first-order states do not round positions.
    coordinates = equations.without_states(np.abs(state.q) + position)
    distance = float(np.max(coordinates / size, initial=0.0))
    return MotionScales(position, size, rate, force, count_periods(plan), distance)


@dataclass(frozen=True)
class ErrorControl:
    """Resolved error control of one run.

    Attributes
    ----------
    policy
        Components in the error test: "positions"; "rigid velocities" (positions, and velocities of
        rigid bodies and of frames); "velocities" (positions and all velocities); or "all" (also
        multipliers).
    max_order
        Highest order of the method.
    reason
        Reason for the choices of "auto", or "as set" if neither setting was "auto".
    is_limited
        True if "auto" limited the order to 2 because of lightly damped modes.
    """

    policy: str
    max_order: int
    reason: str
    is_limited: bool = False

    def tolerance(self, rtol: float, scales: MotionScales, form: FirstOrderForm) -> float:
        """Return the tolerance of the local error that keeps the error of a run near `rtol`.

        The error test uses the root mean square over all components, which may be as small as
        1/sqrt(size) times the largest component; the tolerance is therefore divided by sqrt(size).
        The error of a run is proportional to the local tolerance to the power k / (k + 1), where k
        is the order. For small `rtol`, the local tolerance is therefore proportional to
        rtol^((k + 1) / k). Because errors accumulate over the periods of the motion, the local
        tolerance also decreases with the number of periods.
        """
        k = self.max_order
        asymptotic = _ASYMPTOTIC_FACTORS[k] * rtol ** ((k + 1) / k)
        # Errors accumulate over the periods.
        if self.policy not in ("velocities", "all"):
            factor = scales.periods**-_PERIOD_EXPONENT
        elif form.equations.m == 0:
            factor = scales.periods**-_PERIOD_EXPONENT_ORBITS
        else:
            exponents = _PERIOD_EXPONENT_CONSTRAINED, _PERIOD_EXPONENT_LONG
            factor = reduce_tolerance(scales.periods, *exponents)
        if k == _LIMITED_ORDER and any(part.rigid_count == 0 for part in form.equations.parts):
            factor *= _ABSOLUTE_BEAM_FACTOR
        return float(factor * min(_LINEAR_FACTOR * rtol, asymptotic) / np.sqrt(form.size))

    def absolute_tolerances(
        self, tolerance: float, scales: MotionScales, form: FirstOrderForm, iterated: bool = False
    ) -> Array:
        """Return absolute tolerances of (q, v, multipliers), huge for untested components.

        If `iterated` is True, untested multipliers lam have tolerances for Newton's iteration. If
        the unknowns include time integrals of the multipliers, these tolerances are multiplied by a
        typical step h, for which (h rate)^(k + 1) equals the tolerance of a single component; k is
        the highest order.
        """
        n, m = form.equations.n, form.equations.m
        has_impulses = form.formulation.impulses
        rate = scales.rate if has_impulses else 1.0
        atol = np.full(form.size, _UNTESTED_ATOL)
        atol[:n] = positions = scales.tolerances(tolerance)
        tested = self.tested_velocities(form.equations)
        atol[n : 2 * n][tested] = positions[tested] * scales.rate
        if self.policy == "all":
            atol[2 * n :] = tolerance * scales.force / rate
        elif iterated:
            root = np.sqrt(form.size)
            error = _MAX_MULTIPLIER_ERROR
            if form.formulation.index < 3:
                error = min(_MAX_MULTIPLIER_ERROR, np.sqrt(tolerance * root))
            lam_atol = error * scales.force / root
            step = (tolerance * root) ** (1.0 / (self.max_order + 1)) / rate
            atol[2 * n : 2 * n + m] = lam_atol * (step if has_impulses else 1.0)
        return atol

    def untested(self, form: FirstOrderForm) -> Array | None:
        """Return the mask of untested (q, v, multipliers), or None if all are tested."""
        n = form.equations.n
        mask = np.full(form.size, self.policy != "all")
        mask[:n] = False
        mask[n : 2 * n] = ~self.tested_velocities(form.equations)
        return mask if mask.any() else None

    def tested_velocities(
        self, equations: EquationsOfMotion, tangent_frames: bool = False
    ) -> Array:
        """Return the mask of the velocities in the error test, (n,).

        With `tangent_frames`, "rigid velocities" include frames that move with one section. BDF
        would follow the vibrations of this section with ten times as many steps. Rates of
        first-order states are never tested: they follow from the states, and those of fast states
        are so large that steps would shrink to less than a hundredth of their time constants.
        """
        tested = np.full(equations.n, self.policy in ("velocities", "all"))
        if self.policy == "rigid velocities":
            for part in equations.parts:
                tested[part.rigid] |= tangent_frames or not part.follows_section
        tested[equations.states] = False
        return tested


def needs_radau(plan: RunPlan, rtol: float) -> bool:
    """Return True if BDF would be less accurate at a tolerance, or slower, than Radau.

    This applies if a natural mode is over 300 times faster than the motion, if the run has more
    than 10 periods, with sampled controllers, after whose samples BDF begins again at order 1, or
    with nonholonomic constraints. Errors of velocities displace the path of a skate for good: at
    rtol = 1e-5, chains and sliders with skates were wrong by up to 220 rtol.

    It also applies if the tolerance of velocities is not far below the regularization velocity of
    friction: Newton's method then does not resolve the force of a part that sticks, which exceeded
    the static friction by a third in blocks on belts.
    """
    equations = plan.equations
    if len(equations.nonholonomic_rows) or equations.controllers:
        return True
    speeds = [x.speed for x in equations.frictions.values()]
    motion = equations.without_states(plan.scales / equations.position_scales)
    velocity = motion_rate(plan) * equations.length * float(np.max(motion, initial=0.0))  # [m/s]
    if min(speeds, default=np.inf) < _MIN_SPEED_RATIO * rtol * velocity:
        return True
    if count_periods(plan) > _MANY_PERIODS:
        return True
    return _has_stiff_modes(plan, STIFF_RATIO_BDF)


def _has_stiff_modes(plan: RunPlan, ratio: float) -> bool:
    """Return True if a mode is more than `ratio` times faster than the motion."""
    fastest = max((mode.frequency for mode in plan.fastest_modes()), default=0.0)
    return fastest > ratio * motion_rate(plan)


def resolve_error_control(
    policy: str,
    max_order: int | str,
    formulation: Formulation,
    rtol: float,
    rate: float,
    stiff_ratio: float,
    fastest_modes: Callable[[], tuple[Mode, ...]],
    multipliers_matter: bool = False,
) -> ErrorControl:
    """Return the error control of a run, with "auto" resolved as follows.

    - Without stiff modes, positions and velocities are tested and the order is at most 5.
    - With stiff modes, the velocities of deformations and of beams in absolute coordinates are not
      tested: resolving axial vibrations would cost 20 to 1000 times as much. Velocities of rigid
      bodies and chord frames are tested if all stiff modes have damping ratios above 0.62 (for
      example, because of strong material damping); otherwise, these velocities vibrate, too.
    - BDF of orders 3 to 5 is unstable near the imaginary axis, where undamped modes lie. With stiff
      modes, the order is therefore limited to 2, unless their damping ratios are above 0.62 and
      second-order steps would resolve the modes with smaller ratios.
    - In the index-3 form, only positions are tested, because the error of velocities grows as the
      step shrinks.
    - Testing multipliers would stall "ggl", "index2" and, once it drifts, "index1". With
      "stabilized-index1", they are tested if no mode is stiff and either all motions are prescribed
      or forces such as friction depend on multipliers. If all motions are prescribed, positions and
      velocities do not reveal errors of the multipliers: drive torques were wrong by 13 % at rtol
      1e-5.

    Parameters
    ----------
    policy, max_order
        Settings of the integrator: "auto" or a value.
    formulation
        First-order form of the equations.
    rtol
        Relative tolerance of the run.
    rate
        Rate of the motion [1/s].
    stiff_ratio
        Modes are stiff if they are this many times faster than the motion.
    fastest_modes
        Function that returns the fastest natural mode of each body; not called if neither setting
        is "auto".
    multipliers_matter
        True if forces depend on multipliers or all motions are prescribed.
    """
    if policy != "auto" and max_order != "auto":
        return ErrorControl(policy, int(max_order), "as set")
    modes = fastest_modes()
    fastest = max((mode.frequency for mode in modes), default=0.0)
    stiff = stiff_ratio * rate
    # The damping ratio due to material damping is proportional to frequency: BDF of order 5 is
    # stable for modes above this frequency [rad/s].
    shares = (STABLE_DAMPING_RATIO / max(x.damping_ratio, STABLE_DAMPING_RATIO) for x in modes)
    light = max((x.frequency * share for x, share in zip(modes, shares, strict=True)), default=0.0)
    overdamped = all(
        mode.damping_ratio > STABLE_DAMPING_RATIO for mode in modes if mode.frequency > stiff
    )
    if fastest <= stiff:
        choice, order = "velocities", _HIGHEST_ORDER
        reason = "no mode is much faster than the motion"
    elif overdamped and light <= _RESOLVED_RATIO * rate / np.sqrt(rtol):
        choice, order = "rigid velocities", _HIGHEST_ORDER
        reason = "fast modes have damping ratios above 0.62"
    else:
        choice = "rigid velocities" if overdamped else "positions"
        order, reason = _LIMITED_ORDER, "fast modes are lightly damped"
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
        max_order == "auto" and order == _LIMITED_ORDER,
    )


def weigh_velocities(plan: RunPlan, scales: Array) -> Array:
    """Return reciprocal scales of the velocities [s/m or s/rad], (n,), given those of positions.

    Velocities of first-order states, and all if a mode is stiff, are not tested: their weights are
    zero.
    """
    if _has_stiff_modes(plan, STIFF_RATIO_RADAU):
        return np.zeros(len(scales))
    return plan.equations.without_states(1.0 / (scales * motion_rate(plan)))


class MultiplierTolerances(NamedTuple):
    """Tolerances of the error test of multipliers, by default none.

    Attributes
    ----------
    weights
        Reciprocal tolerances of the multipliers, (m,), which fall as the multipliers grow; (0,) if
        they are not tested.
    tolerance
        Tolerance relative to the largest values.
    shortest_step
        Step [s] below which multipliers are not tested, because they may jump.
    """

    weights: Array = np.zeros(0)
    tolerance: float = 0.0
    shortest_step: float = math.inf


UNTESTED_MULTIPLIERS = MultiplierTolerances()


def plan_multiplier_tolerances(
    plan: RunPlan, scales: MotionScales, rtol: float
) -> MultiplierTolerances:
    """Return the tolerances of a run with `rtol`; none if there are free motions.

    If joints and drivers prescribe all motions, positions and velocities do not reveal errors of
    the multipliers.
    """
    equations = plan.equations
    if not equations.is_driven:
        return UNTESTED_MULTIPLIERS
    tolerance = float(np.clip(_MULTIPLIER_FACTOR * rtol, *_MULTIPLIER_TOLERANCES))
    arms = equations.length / equations.constraint_scales
    forces = np.maximum(_LEAST_FORCE_SHARE * scales.force * arms, _LEAST_FORCE)
    largest = np.maximum(np.abs(plan.state.lam), forces)
    shortest = _SHORTEST_TESTED_STEP / scales.rate
    return MultiplierTolerances(1.0 / (tolerance * largest), tolerance, shortest)
