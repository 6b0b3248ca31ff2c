"""Characteristics of step responses: rise time, settling time, overshoot, steady-state error."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamdae.errors import BeamdaeError

Array = np.ndarray

_RISE_LIMITS = (0.1, 0.9)  # fractions of the step between which the rise time is measured
_STEADY_PART = 0.25  # last part of the time in which a steady column does not leave the band


class StepResponse(NamedTuple):
    """Characteristics of a step response.

    Attributes
    ----------
    rise_time
        Time from 10 % to 90 % of the step [s]; nan if 90 % is not reached.
    settling_time
        Time from the step until the column remains within the band about the target [s]; nan if it
        is outside at the end.
    overshoot
        Largest excess over the target, as a fraction of the step.
    peak, peak_time
        Largest value in the direction of the step, and the time from the step to it [s].
    steady_state_error
        Target minus the last value; nan if the values in the last quarter of the time since the
        step differ from it by more than the band.
    """

    rise_time: float
    settling_time: float
    overshoot: float
    peak: float
    peak_time: float
    steady_state_error: float


def measure_step_response(
    name: str, times: Array, values: Array, target: float, band: float
) -> StepResponse:
    """Return the characteristics of a column after a step at the first of `times`.

    Parameters
    ----------
    name
        Name of the column, for messages.
    times, values
        Times [s] and values of the column since the step, (k,).
    target
        Value that the column should reach.
    band
        Half the width of the band in which the column is settled, as a fraction of the step; of the
        range of the column, if that is smaller, in the test of a steady state.
    """
    step = target - values[0]
    if not np.all(np.isfinite(values)):
        raise BeamdaeError(f"step_response: {name} is not finite at some of the times.")
    if step == 0.0:
        raise BeamdaeError(
            f"step_response: {name} starts at {target:.6g}, the target; pass target= and t= of a "
            "step."
        )
    elapsed, response = times - times[0], (values - values[0]) / step
    low, high = (_first_crossing(elapsed, response, limit) for limit in _RISE_LIMITS)
    outside = np.flatnonzero(np.abs(response - 1.0) > band)
    settling = 0.0
    if outside.size:
        last = int(outside[-1])
        settling = np.nan
        if last + 1 < len(response):
            side = np.sign(response[last] - 1.0)
            before, after = side * (response[last : last + 2] - 1.0)
            share = (before - band) / (before - after)
            settling = elapsed[last] + share * (elapsed[last + 1] - elapsed[last])
    last_values = response[elapsed >= (1.0 - _STEADY_PART) * elapsed[-1]]
    largest_change = float(np.max(np.abs(last_values - response[-1])))
    is_steady = largest_change <= band * min(1.0, float(np.ptp(response)))
    k = int(np.argmax(response))
    return StepResponse(
        rise_time=float(high - low),
        settling_time=float(settling),
        overshoot=float(max(response[k] - 1.0, 0.0)),
        peak=float(values[k]),
        peak_time=float(elapsed[k]),
        steady_state_error=float(target - values[-1]) if is_steady else np.nan,
    )


def _first_crossing(elapsed: Array, response: Array, limit: float) -> float:
    """Return the time at which the response first reaches a limit, or nan if it does not."""
    reached = np.flatnonzero(response >= limit)
    if not reached.size:
        return np.nan
    k = int(reached[0])  # at least 1, because the response begins at zero
    share = (limit - response[k - 1]) / (response[k] - response[k - 1])
    return float(elapsed[k - 1] + share * (elapsed[k] - elapsed[k - 1]))
