"""Warnings about extremes of forces that belong to the vibration after a start as drawn.

Elastic parts are drawn without stress: weights, preloads and the inertia of parts that move from
the first instant on act suddenly. The vibration of a column is its difference between the start and
the state without vibrations, see `equations.starts.smooth_motion`; its peaks are up to twice this
difference from the motion without vibrations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.smooth_motion import find_smooth_state
from beamdae.equations.surface_gaps import compile_surface_gaps
from beamdae.errors import BeamdaeError, name_with_others
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.model_checks.contacts import contacts_of
from beamdae.model_checks.load_derivatives import read_state
from beamdae.parts.mechanism import EQUILIBRIUM
from beamdae.results.columns import UNITS_OF_LOADS, Header, remove_unit
from beamdae.results.step_extremes import StepExtremes
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_EARLY, _LATE = 0.25, 0.5  # extremes before and after these shares of the run are compared
_MIN_EXCESS = 0.05  # of the early extreme over the later ones, relative to it
_MIN_PART = 0.5  # of a value, to be its main cause
_MIN_SHARE = 0.01  # of an extreme, relative to the largest one with the same unit
# If the run moves less than this multiple of the displacement to the state without vibrations, the
# vibration is the motion of interest, as after a load that jumps at the start.
_MIN_TRAVEL = 10.0
_MAX_PENETRATIONS = 2.0  # displacements up to this multiple of a penetration are no such motion
_AMPLITUDE_SAMPLES = 200
_MAX_ROWS_AT_ONCE = 2048


def start_transient_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    observe: Callable[..., Array],
) -> Iterator[str]:
    """Yield a warning if the largest forces of a run are those of the vibration after its start.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    extremes
        Extremes of the observed columns by header, see `measure_step_extremes`.
    observe
        Function that returns the observed columns at rows of (t, branch) and of q, v, a, lam.
    """
    e, begin, duration = equations, trajectory.start, trajectory.end - trajectory.start
    if e.mechanism is None or e.redundant or e.controllers or begin != 0.0 or not duration > 0.0:
        return
    if e.start is not None and (
        e.start.moves or (e.start.closed_q is not None and e.start.description != EQUILIBRIUM)
    ):
        return  # positions by name may be those of a vibration, and a rotation has none
    largest: dict[str, float] = {}
    peaks: dict[int, tuple[float, float]] = {}
    for k, header in enumerate(e.observed_headers):
        unit = Header.of(header).unit
        if header not in extremes or unit not in UNITS_OF_LOADS:
            continue
        x = extremes[header]
        sides = (x.max, x.max_time), (x.min, x.min_time)
        value, t = max(sides, key=lambda side: abs(side[0]))
        largest[unit] = max(abs(value), largest.get(unit, 0.0))
        if 0.0 < t <= _EARLY * duration:
            peaks[k] = value, t
    if not peaks:
        return
    later = _later_magnitudes(trajectory, _LATE * duration, observe)
    excess = {
        k: 1.0 - float(later[k]) / abs(value)
        for k, (value, _) in peaks.items()
        if abs(value) >= _MIN_SHARE * largest[Header.of(e.observed_headers[k]).unit]
    }
    if not any(x > _MIN_EXCESS for x in excess.values()):
        return
    interval = trajectory.intervals[0]
    _, active, time, start = read_state(e, trajectory, begin)

    def observe_state(t: Array, state: State) -> Array:
        """Return the columns at (t, branch) and a state with the active multipliers."""
        q, v, a, lam = (x[None] for x in state)
        if interval.configuration is not None:
            lam = interval.configuration.expand_multipliers(lam, e.m)
        return np.asarray(observe(t[None], q, v, a, lam)[0])

    smooth, rest = _find_smooth_states(active, time, start)
    if smooth is None or rest is None or not _is_minor(active, trajectory, time, start, smooth):
        return
    drawn = observe_state(time, start)
    vibration = np.abs(observe_state(time, smooth) - drawn)
    caused = []
    for k, (value, t) in peaks.items():
        if not (excess.get(k, 0.0) > _MIN_EXCESS and t <= interval.t[-1]):
            continue
        (at,), states = trajectory.at(np.array([t]))
        near = find_smooth_state(ConsistencySolver(active), at, states.q[0], states.v[0])
        if near is None:
            continue
        share = (value - observe_state(at, near)[k]) * np.sign(value)
        if _MIN_PART * excess[k] * abs(value) < share <= 2.0 * vibration[k]:
            caused.append(k)
    if not caused:
        return
    worst, *others = sorted(caused, key=lambda k: -excess[k])
    by_loads = abs(observe_state(time, rest) - drawn)[worst] >= _MIN_PART * vibration[worst]
    remedy = "start drivers smoothly, as bd.run_up does, or a steady rotation by bd.rotation"
    if np.any(active.v0):
        remedy = "draw the parts as loaded"
    elif by_loads:
        remedy = "use start='equilibrium'"
    header = e.observed_headers[worst]
    names = list(dict.fromkeys(remove_unit(e.observed_headers[k]) for k in others))
    (value, t), unit = peaks[worst], Header.of(header).unit
    yield (
        f"{name_with_others(remove_unit(header), names)}: its largest value, {value:.4g} {unit} at "
        f"t = {t:.3g} s, belongs to the vibration that the start as drawn causes (largest one "
        f"later: {later[worst]:.4g} {unit}); {remedy}, or evaluate extremes after it has decayed."
    )


def _find_smooth_states(
    e: EquationsOfMotion, time: Array, start: State
) -> tuple[State | None, State | None]:
    """Return the states without vibrations near a start, with its velocities and at rest."""
    # Imported here because few runs need an equilibrium.
    from beamdae.equations.starts.initial_conditions import apply_initial_conditions

    q, solver = start.q, ConsistencySolver(e)
    try:
        if contacts_of(e):
            # Contacts have no stiffness yet in the drawing.
            q = apply_initial_conditions(e, EQUILIBRIUM, float(time[0])).q0
        rest = find_smooth_state(solver, time, q, start.v, is_at_rest=True)
        # Drivers may accelerate at once, but not have a velocity.
        smooth = find_smooth_state(solver, time, q, start.v) if np.any(start.v) else rest
    except (BeamdaeError, SingularMatrixError):
        return None, None
    return smooth, rest


def _is_minor(
    e: EquationsOfMotion, trajectory: Trajectory, time: Array, start: State, smooth: State
) -> bool:
    """Return True if the vibration is small beside the motion of the run."""

    def size(x: Array) -> float:
        return float(np.max(np.abs(e.without_states(x)) / e.position_scales, initial=0.0))

    if size(start.v - smooth.v) > _MIN_PART * size(start.v):
        return False
    times = np.linspace(trajectory.start, trajectory.end, _AMPLITUDE_SAMPLES)
    travel = size(0.5 * np.ptp(trajectory.positions_at(times), axis=0))
    gaps = compile_surface_gaps(e) if contacts_of(e) else ()
    depths = [-float(x.evaluate(time[:1], time[1], smooth.q[None])[0]) for x in gaps]
    penetration = max(depths, default=0.0) / e.length
    limit = max(travel / _MIN_TRAVEL, _MAX_PENETRATIONS * penetration)
    return size(smooth.q - start.q) <= limit


def _later_magnitudes(trajectory: Trajectory, begin: float, observe: Callable[..., Array]) -> Array:
    """Return the largest magnitudes (k,) of the observed columns from `begin` on."""
    magnitudes = []
    for interval in trajectory.intervals:
        step, rows = interval.nodes_per_step, interval.times[:: interval.nodes_per_step]
        for k in range(int(np.searchsorted(rows[:, 0], begin)), len(rows), _MAX_ROWS_AT_ONCE):
            block = slice(k, k + _MAX_ROWS_AT_ONCE)
            values = observe(rows[block], *(x[::step][block] for x in interval.rows))
            magnitudes.append(np.abs(values).max(axis=0))
    return np.asarray(np.max(magnitudes, axis=0))
