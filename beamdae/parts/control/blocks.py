"""Blocks of continuous controllers: transfer functions and PID, made of states."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    require_finite,
    require_name,
    require_pair,
    require_positive,
    require_sequence,
    short_repr,
)
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.signals import NO_UNIT, find_unit, require_formula
from beamdae.symbolic.local_symbols import SX

_SECONDS = re.compile(r"s(?:\^(-?\d+))?")  # factor of a unit, with its exponent


def _integrate_unit(unit: str | None, count: int = 1) -> str:
    """Return the unit of the value integrated `count` times over time; "-" if it is unknown."""
    if unit is None:
        return NO_UNIT
    # All factors behind a slash divide: N/m s is N/(m s).
    above, *below = unit.split("/")
    factors = [(x, 1) for x in above.split()] + [(x, -1) for x in " ".join(below).split()]
    power_of_seconds = count
    others: dict[int, list[str]] = {1: [], -1: []}  # by the sign of their exponent
    for factor, sign in factors:
        if match := _SECONDS.fullmatch(factor):
            power_of_seconds += sign * int(match[1] or 1)
        elif factor not in ("1", NO_UNIT):
            others[sign].append(factor)
    if power_of_seconds:
        size = abs(power_of_seconds)
        others[int(np.sign(power_of_seconds))].append("s" if size == 1 else f"s^{size}")
    numerator, denominator = (" ".join(x) for x in others.values())
    if not denominator:
        return numerator or NO_UNIT
    return f"{numerator or 1}/{denominator}"


def _require_mechanism(caller: str, value: Any) -> None:
    if not isinstance(value, Mechanism):
        raise BeamdaeError(f"{caller}: mechanism must be a Mechanism, got {short_repr(value)}.")


@contextmanager
def _all_or_no_states(mechanism: Mechanism) -> Iterator[None]:
    """Remove the states added within the context if one of them cannot be added."""
    parts, observables = dict(mechanism.parts), dict(mechanism.observables)
    try:
        yield
    except BeamdaeError:
        for current, before in ((mechanism.parts, parts), (mechanism.observables, observables)):
            for name in current.keys() - before.keys():
                del current[name]
        raise


def transfer_function(
    mechanism: Mechanism,
    name: str,
    value: Any,
    numerator: Sequence[float],
    denominator: Sequence[float],
    scale: float = 1.0,
    unit: str | None = None,
) -> SX:
    """Add a transfer function and return its output, a formula of its states.

    The block is the controllable canonical form x_1' = x_2, ...,
    x_n' = value - (a_0 x_1 + ... + a_n-1 x_n) with the output b_0 x_1 + ... + b_n-1 x_n + d value.
    All states start at zero.

    Parameters
    ----------
    mechanism
        Mechanism to which the states `name` 1, ..., `name` n are added.
    name
        Name of the block.
    value
        Input of the block: a formula of inputs, sensors and states.
    numerator, denominator
        Coefficients in descending powers of s, as in `scipy.signal.TransferFunction`. The degree of
        the numerator must not exceed that of the denominator.
    scale
        Typical size of `value`, from which the scales of the states follow; see `Mechanism.state`.
    unit
        Unit of `value`. Defaults to that of the sensors, inputs and states in `value` if it is
        their sum or difference and they have one unit, otherwise to "-"; x_k has this unit times
        s^(n - k + 1).

    Returns
    -------
    casadi.SX
        The output, for laws and formulas.

    Raises
    ------
    BeamdaeError
        If an argument is invalid.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> step = mech.input("step", default=1.0)
    >>> output = bd.transfer_function(mech, "filter", step, [4.0], [1.0, 2.0, 4.0])
    >>> response = mech.state("response", output)
    """
    _require_mechanism("transfer_function", mechanism)
    name, what = require_name("transfer_function", name), "a list of numbers"
    value = require_formula(name, "value", value)
    b, a = (
        np.trim_zeros(
            np.array(
                [require_finite(name, key, x) for x in require_sequence(name, key, values, what)]
            ),
            "f",
        )
        for key, values in (("numerator", numerator), ("denominator", denominator))
    )
    if len(a) == 0 or len(b) > len(a):
        raise BeamdaeError(
            f"{name}: the degree of the numerator must not exceed that of the denominator, got "
            f"{short_repr(numerator)} and {short_repr(denominator)}."
        )
    what = f"the coefficients divided by the first of the denominator ({a[0]:g})"
    # Python floats: overflows of arrays issue warnings.
    a, b = (
        np.array([require_finite(name, what, x / float(a[0])) for x in values.tolist()])
        for values in (a, np.concatenate([np.zeros(len(a) - len(b)), b]))
    )
    direct, count = b[0], len(a) - 1
    # x_k is about value / w^(n-k+1), where w is the geometric mean of the poles other than zero.
    # In slow filters, this size is not reached within seconds.
    (nonzero,) = np.nonzero(a)
    rate = max(1.0, abs(float(a[nonzero[-1]])) ** (1.0 / max(nonzero[-1], 1)))
    sizes = [rate ** float(k - count) for k in range(count)]
    unit, scale = find_unit(name, value, unit), require_positive(name, "scale", scale)
    with _all_or_no_states(mechanism):
        states = [
            mechanism.state(
                f"{name} {k + 1}", unit=_integrate_unit(unit, count - k), scale=scale * x
            )
            for k, x in enumerate(sizes)
        ]
    # Ascending powers, without the leading coefficient 1.
    feedback, output = value, direct * value
    for state, low, out in zip(states, a[:0:-1], b[:0:-1], strict=True):
        feedback = feedback - low * state
        output = output + (out - direct * low) * state
    for k, state in enumerate(states):
        state.follows(states[k + 1] if k + 1 < count else feedback)
    return output


def pid(
    mechanism: Mechanism,
    name: str,
    error: Any,
    kp: float,
    ki: float = 0.0,
    kd: float = 0.0,
    *,
    rate: Any = None,
    filter_time: float | None = None,
    limits: tuple[float, float] | None = None,
    tracking_time: float | None = None,
    scale: float = 1.0,
    unit: str | None = None,
) -> SX:
    """Add a continuous PID controller and return its output, a formula of its states.

    u = kp error + ki I + kd D with I' = error and D = `rate`, or, with a filter,
    D = (error - F) / T and T F' = error - F. With `limits`, the output is clipped to them, and the
    integral follows I' = error + (clipped u - u) / (ki T_t), so that it does not wind up (back
    calculation: Astrom & Hagglund, Advanced PID Control, ISA 2006, section 3.5).

    Parameters
    ----------
    mechanism
        Mechanism to which the states `name` integral and `name` filter are added.
    name
        Name of the controller.
    error
        Setpoint minus measured value: a formula of inputs, sensors and states.
    kp, ki, kd
        Gains.
    rate
        Rate of the error, such as the negative value of a sensor. If None, `filter_time` is
        required for kd.
    filter_time
        Time constant T of the derivative [s]. Its filter starts at zero, so that an error e at the
        start causes a peak of kd e / T; `start={"NAME filter.value": e}` avoids it.
    limits
        Smallest and largest output.
    tracking_time
        Time constant T_t [s] by which the integral leaves saturation. Defaults to kp / ki; required
        with `limits` if kp = 0.
    scale
        Typical size of the states; see `Mechanism.state`.
    unit
        Unit of `error`, with the default of `transfer_function`; the integral has this unit times
        s.

    Returns
    -------
    casadi.SX
        The output, for laws and formulas.

    Raises
    ------
    BeamdaeError
        If an argument is invalid.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> stage = mech.add(bd.PointMass("stage", 2.0, at=(0.0, 0.0)))
    >>> rail = mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), stage.point))
    >>> x = mech.sensor("x", stage.point, "x")
    >>> v = mech.sensor("v", stage.point, "x_dot")
    >>> force = bd.pid(mech, "servo", 0.1 - x, kp=300.0, ki=400.0, kd=40.0, rate=-v)
    >>> motor = mech.add(bd.Force("motor", stage.point, (force, 0.0)))
    >>> run = bd.simulate(mech, bd.Radau(), t_end=9.0)
    >>> print(f"{run['x'].iloc[-1]:.4f} m")
    0.1000 m
    """
    _require_mechanism("pid", mechanism)
    name, error = require_name("pid", name), require_formula(name, "error", error)
    kp, ki, kd = (require_finite(name, key, x) for key, x in (("kp", kp), ("ki", ki), ("kd", kd)))
    # Errors leave the mechanism unchanged.
    bounds, tracking, time = None, 0.0, 0.0
    if limits is not None:
        bounds = [require_finite(name, "limits", x) for x in require_pair(name, "limits", limits)]
        if not bounds[0] < bounds[1]:
            raise BeamdaeError(f"{name}: limits must ascend, got {short_repr(limits)}.")
        if ki and tracking_time is None and kp / ki <= 0.0:
            raise BeamdaeError(
                f"{name}: tracking_time has no default with limits, kp = {kp:g} and ki = {ki:g}; "
                "pass the time constant [s] by which the integral leaves saturation."
            )
        if ki:
            tracking = require_positive(
                name, "tracking_time", kp / ki if tracking_time is None else tracking_time
            )
    output = kp * error
    if kd and rate is not None:
        output = output + kd * require_formula(name, "rate", rate)
    elif kd:
        if filter_time is None:
            raise BeamdaeError(
                f"{name}: the derivative requires rate= or filter_time=; pass the measured rate of "
                "the error or a time constant [s]."
            )
        time = require_positive(name, "filter_time", filter_time)
    integral = None
    unit = find_unit(name, error, unit)
    with _all_or_no_states(mechanism):
        if kd and rate is None:
            filtered = mechanism.state(
                f"{name} filter", lambda x, t: (error - x) / time, 0.0, unit or NO_UNIT, scale
            )
            output = output + (kd / time) * (error - filtered)
        if ki:
            integral = mechanism.state(f"{name} integral", unit=_integrate_unit(unit), scale=scale)
            output = output + ki * integral
    clipped = output if bounds is None else ca.fmin(ca.fmax(output, bounds[0]), bounds[1])
    if integral is not None and bounds is not None:
        # ki (kp / ki) may differ from kp by rounding, and equal numbers in a formula are one. The
        # structure of equations that are differentiated may not depend on rounding.
        gain = kp if tracking_time is None else ki * tracking
        integral.follows(error + (clipped - output) / gain)
    elif integral is not None:
        integral.follows(error)
    mechanism.outputs[name] = clipped
    return clipped
