"""Warnings about extremes of forces that belong to the vibration after a start as drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError, name_with_others
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.parts.mechanism import EQUILIBRIUM
from beamdae.results.columns import Header, remove_unit
from beamdae.results.diagnostics.resolution.missed_peaks import StepExtremes
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_UNITS = ("N", "N m", "Pa")
# Shares of the run: extremes in the first one are compared with those after the second one.
_EARLY_SHARE, _LATE_SHARE = 0.05, 0.1
# Extremes that exceed the later ones by less, relative to their value and to the range of the
# column, have no warning.
_MIN_EXCESS, _MIN_EXCESS_OF_RANGE = 0.05, 1e-3
# Largest displacement from the drawing to the equilibrium, relative to the amplitude of the run. If
# it is larger, the vibration is the motion of interest, as after a load that jumps at the start.
_MAX_DISPLACEMENT = 0.01
# Distance of the extreme from the value in equilibrium, relative to the change from the start to
# this value: 1 for an undamped vibration with one frequency.
_MAX_OVERSHOOT = 2.0
_AMPLITUDE_SAMPLES = 200
_MAX_ROWS_AT_ONCE = 2048


def start_transient_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    observe: Callable[..., Array],
) -> Iterator[str]:
    """Yield a warning if the largest forces are those of a vibration that the drawing causes.

    Elastic parts are drawn without stress, so that weights and preloads start to act suddenly. A
    start in equilibrium avoids this vibration, which hardly moves the mechanism.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    extremes
        Extremes of the observed columns by header, see `measure_step_extremes`.
    observe
        Function that returns the observed columns at rows of (t, branch) and of q, v, a, lam.
    """
    first = trajectory.intervals[0]
    start, duration = trajectory.start, trajectory.end - trajectory.start
    is_moving = any(np.any(equations.v0[x.rows]) for x in equations.parts if not x.is_state)
    if equations.mechanism is None or equations.start is not None or equations.redundant:
        return
    if equations.controllers:  # whose first commands excite vibrations, too
        return
    if is_moving or start != 0.0:
        return
    headers = list(equations.observed_headers)
    peaks = []
    for k, header in enumerate(headers):
        if header in extremes and Header.of(header).unit in _UNITS:
            x = extremes[header]
            for value, time in ((x.max, x.max_time), (x.min, x.min_time)):
                is_outward = value > 0.0 if value == x.max else value < 0.0
                if is_outward and start < time <= start + _EARLY_SHARE * duration:
                    peaks.append((k, value, time, x.max - x.min))
    if not peaks:
        return
    later = _later_extremes(trajectory, start + _LATE_SHARE * duration, observe)
    excesses = {}
    for k, value, time, size in peaks:
        after = later[1, k] if value > 0.0 else later[0, k]
        excess = (value - after) * np.sign(value)
        if excess > max(_MIN_EXCESS * abs(value), _MIN_EXCESS_OF_RANGE * size):
            excesses[k, value, time] = excess / abs(value)
    if not excesses:
        return
    states = State(*(x[:1] for x in first.rows))
    rest = _find_rest(first.active_equations(equations), first.times[0])
    if rest is None or not _is_near(equations, trajectory, states.q[0], rest.q):
        return
    at = first.times[:1]
    (drawn,) = observe(at, *states)
    (static,) = observe(at, *(x[None] for x in rest))
    caused = []
    for (k, value, time), excess in excesses.items():
        change, overshoot = static[k] - drawn[k], value - static[k]
        if 0.0 < overshoot * np.sign(change) <= _MAX_OVERSHOOT * abs(change):
            caused.append((excess, k, value, time))
    if not caused:
        return
    _, k, value, time = max(caused)
    others = list(dict.fromkeys(remove_unit(headers[x[1]]) for x in caused if x[1] != k))
    side, after = ("largest", later[1, k]) if value > 0.0 else ("smallest", later[0, k])
    unit = Header.of(headers[k]).unit
    yield (
        f"{name_with_others(remove_unit(headers[k]), others)}: "
        f"its {side} value, {value:.4g} {unit} at "
        f"t = {time:.3g} s, belongs to a vibration that begins because the drawing is not in "
        f"equilibrium ({side} value later: {after:.4g} {unit}); use start='equilibrium'."
    )


def _later_extremes(trajectory: Trajectory, begin: float, observe: Callable[..., Array]) -> Array:
    """Return the smallest and largest values of the observed columns from `begin` on, (2, k)."""
    extremes = []
    for interval in trajectory.intervals:
        step, rows = interval.nodes_per_step, interval.times[:: interval.nodes_per_step]
        first = int(np.searchsorted(rows[:, 0], begin))
        for k in range(first, len(rows), _MAX_ROWS_AT_ONCE):
            block = slice(k, k + _MAX_ROWS_AT_ONCE)
            values = observe(rows[block], *(x[::step][block] for x in interval.rows))
            extremes += [values.min(axis=0), values.max(axis=0)]
    return np.array([np.min(extremes, axis=0), np.max(extremes, axis=0)])


def _find_rest(equations: EquationsOfMotion, time: Array) -> State | None:
    """Return the state at the start of a run in equilibrium, or None if there is none."""
    # Imported here because few runs need a start in equilibrium.
    from beamdae.equations.starts.initial_conditions import apply_initial_conditions

    try:
        resting = apply_initial_conditions(equations, EQUILIBRIUM, float(time[0]))
        return ConsistencySolver(resting).start_state(time, resting.q0, resting.v0)
    except (BeamdaeError, SingularMatrixError):
        return None


def _is_near(equations: EquationsOfMotion, trajectory: Trajectory, q: Array, rest: Array) -> bool:
    """Return True if positions are near the equilibrium, compared with the motion of the run."""
    times = np.linspace(trajectory.start, trajectory.end, _AMPLITUDE_SAMPLES)
    amplitudes = 0.5 * np.ptp(trajectory.positions_at(times), axis=0)
    distances, amplitudes = (
        np.max(equations.without_states(x) / equations.position_scales, initial=0.0)
        for x in (np.abs(rest - q), amplitudes)
    )
    return bool(distances <= _MAX_DISPLACEMENT * amplitudes)
