"""Warnings about extremes of forces that belong to the vibration after a start as drawn.

Elastic parts are drawn without stress. Weights and preloads, and the inertia of parts that move
from the first instant on, then act suddenly. The share of a vibration in a column is its difference
from the value at the state without vibrations, see `equations.starts.smooth_motion`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.smooth_motion import find_smooth_state
from beamdae.equations.surface_gaps import SurfaceGapTerm, compile_surface_gaps
from beamdae.errors import BeamdaeError, list_first, name_with_others
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.model_checks.model_contacts import contacts_of
from beamdae.parts.mechanism import EQUILIBRIUM
from beamdae.parts.rotation import Rotation
from beamdae.results.columns import Header, largest_of_kind, remove_unit
from beamdae.results.step_extremes import StepExtremes
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_UNITS = ("N", "N m", "Pa")
# Shares of the run: extremes in the first one are compared with those after the second one.
_EARLY_SHARE, _LATE_SHARE = 0.05, 0.1
# Largest magnitudes that exceed the later one by less, relative to their value, have no warning.
_MIN_EXCESS = 0.05
# Largest displacement from the drawing to the equilibrium, relative to the amplitude of the run. If
# it is larger, the vibration is the motion of interest, as after a load that jumps at the start.
_MAX_DISPLACEMENT = 0.01
# Largest displacement from the drawing to the equilibrium of mechanisms that drivers move, relative
# to the length of the mechanism or to 1 rad: their motion of interest is that of the drivers.
_MAX_DISPLACEMENT_OF_DRIVEN = 0.1
# The same relative to the largest penetration of a contact in equilibrium.
_MAX_PENETRATIONS = 2.0
_CONTACT_ITERATIONS = 4  # of states near a peak, in which contacts are stiffer or softer
_DRIVER_SAMPLES = 33  # times at which laws of drivers are compared
# Distance of the extreme from the value in equilibrium, relative to the change from the start to
# this value: 1 for an undamped vibration with one frequency.
_MAX_OVERSHOOT = 2.0
_AMPLITUDE_SAMPLES = 200
# The same shares for vibrations by inertia, which may have their extreme in the first revolution.
_EARLY_SHARE_OF_MOTION, _LATE_SHARE_OF_MOTION = 0.25, 0.5
# Part of inertia in the change of a column by the start; below, loads at rest cause the vibration,
# unless it is larger than this change explains.
_MIN_PART_OF_INERTIA = 0.5
# Velocities of a vibration, relative to those that are given to bodies, that move without it.
_MAX_VIBRATION_SHARE = 0.5
_MIN_SHARE_OF_KIND = 1e-2  # of the largest half range of the same kind of columns
# Distances from the start, relative to the largest one, between which a motion that repeats varies.
_MAX_DISTANCE_OF_RETURN, _MIN_LATE_AMPLITUDE = 0.05, 0.9
_REPETITION_SAMPLES = 2000
# Times relative to the duration of the run, not at multiples of a period, at which a rotation has
# to continue.
_ROTATION_SAMPLES = (0.131, 0.373, 0.619, 0.887)
_MAX_SPEED_CHANGE = 0.05
_RIGID_ROTATION_TOLERANCE = 1e-6  # of velocities, relative to the largest one
_ROUNDING = 1e-9  # of centers of rotation, and of drivers, relative to the length
# Displacement for the rate of a gap, relative to the length of the mechanism, and the smallest rate
# relative to the speeds of the bodies.
_DIFFERENCE, _MIN_SPEED_SHARE = 1e-6, 1e-6
_MAX_ROWS_AT_ONCE = 2048
_MAX_NAMES = 4  # of drivers


class _EarlyPeak(NamedTuple):
    """Largest magnitude of a column, in the first part of a run, that exceeds the later ones.

    Attributes
    ----------
    column
        Number of the column.
    value, time
        The value with this magnitude, and its time [s].
    later
        Largest magnitude in the last part of the run.
    """

    column: int
    value: float
    time: float
    later: float

    @property
    def excess(self) -> float:
        """Excess over the later magnitude, relative to the magnitude [-]."""
        return 1.0 - self.later / abs(self.value)


def start_transient_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    observe: Callable[..., Array],
) -> Iterator[str]:
    """Yield a warning if the largest forces are those of a vibration that the start causes.

    A start in equilibrium avoids the vibration by weights and preloads, which hardly moves the
    mechanism. A vibration by inertia does not belong to the periodic motion.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    extremes
        Extremes of the observed columns by header, see `measure_step_extremes`.
    observe
        Function that returns the observed columns at rows of (t, branch) and of q, v, a, lam.
    """
    if equations.mechanism is None or equations.redundant or trajectory.start != 0.0:
        return
    if not trajectory.end > trajectory.start:
        return
    if equations.controllers:  # whose first commands excite vibrations, too
        return
    sentence, columns = _examine_inertia(equations, trajectory, extremes, observe)
    if sentence:
        yield sentence
    headers = [equations.observed_headers[k] for k in columns]
    others = {header: x for header, x in extremes.items() if header not in headers}
    sentence = _examine_loads(equations, trajectory, others, observe)
    if sentence:
        yield sentence


def _examine_loads(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    observe: Callable[..., Array],
) -> str:
    """Return a warning about the vibration by loads, or by the inertia of moving bodies, or "".

    The peaks are compared with the equilibrium or, if bodies move, with states without vibrations
    near the peaks.
    """
    request = equations.start
    if request is not None and (request.moves or request.closed_q is not None):
        return ""  # named positions may be those of a vibration
    first = trajectory.intervals[0]
    time, start = first.times[0], State(*(x[0] for x in first.rows))
    active = first.active_equations(equations)
    cause, remedy = "the drawing is not in equilibrium", "use start='equilibrium'"
    bodies, motion = _find_moving_bodies(active, time, start)
    shares = _EARLY_SHARE, _LATE_SHARE
    if bodies:
        shares = _EARLY_SHARE_OF_MOTION, _LATE_SHARE_OF_MOTION
    peaks = _find_early_peaks(equations, trajectory, extremes, observe, *shares)
    if bodies:
        peaks = _without_impacts(equations, trajectory, peaks)
    if not peaks:
        return ""
    (drawn,) = observe(time[None], *(x[None] for x in start))
    is_driven, static = _has_moving_drivers(active, trajectory, start.q), drawn
    if not bodies:
        rest = _find_rest(equations, trajectory, time, start, is_driven)
        static = _observe_state(equations, trajectory, observe, time, rest)
    caused = []
    for peak in peaks:
        reference = static[peak.column]
        if bodies or is_driven:
            vibration = _vibration_in_peak(equations, trajectory, observe, peak)
            if not vibration:
                continue
            if bodies:
                reference = peak.value - vibration * np.sign(peak.value)
        change = reference - drawn[peak.column]
        overshoot = (peak.value - reference) * np.sign(change)
        if 0.0 < overshoot <= _MAX_OVERSHOOT * abs(change):
            caused.append(peak)
    if not caused:
        return ""
    if bodies:
        cause = f"{motion} and {cause}"
        remedy = _recommend_rotation(active, trajectory, time, start) or (
            "draw the parts as loaded, or read the extremes after it has decayed"
        )
    return _describe(caused, equations, cause, remedy)


def _find_rest(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    time: Array,
    start: State,
    is_driven: bool,
) -> State | None:
    """Return the equilibrium if it is near the start, or None."""
    active = trajectory.intervals[0].active_equations(equations)
    if not contacts_of(equations):
        # Most runs with another motion of interest need no search for the equilibrium. The
        # stiffness of a contact that is not yet loaded is that of an open one.
        near = find_smooth_state(ConsistencySolver(active), time, start.q, start.v, is_at_rest=True)
        if near is None or not _is_near(equations, trajectory, start.q, near.q, is_driven):
            return None
    rest = _find_start(active, time, EQUILIBRIUM)
    is_near = rest is not None and _is_near(equations, trajectory, start.q, rest.q, is_driven)
    return rest if is_near else None


def _examine_inertia(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    observe: Callable[..., Array],
) -> tuple[str, set[int]]:
    """Return a warning about the vibration by inertia that acts suddenly at the start, or "".

    The second result contains the numbers of the columns to which it applies.
    """
    if equations.start is not None and equations.start.description != EQUILIBRIUM:
        return "", set()  # named positions or velocities may be those of a vibration
    first = trajectory.intervals[0]
    time, start = first.times[0], State(*(x[0] for x in first.rows))
    active = first.active_equations(equations)
    drivers, cause = _find_sudden_drivers(active, trajectory, time, start.q)
    if not drivers:
        return "", set()
    headers = [x for x in equations.observed_headers if x in extremes]
    half_ranges = np.array([extremes[x].half_range for x in headers])
    limits = _MIN_SHARE_OF_KIND * largest_of_kind(headers, half_ranges, equations.length)
    large = zip(headers, (half_ranges > limits).tolist(), strict=True)
    examined = {x: extremes[x] for x, is_large in large if is_large}
    shares = _EARLY_SHARE_OF_MOTION, _LATE_SHARE_OF_MOTION
    peaks = _find_early_peaks(equations, trajectory, examined, observe, *shares)
    peaks = _without_impacts(equations, trajectory, peaks)
    if not peaks:
        return "", set()
    (drawn,) = observe(time[None], *(x[None] for x in start))
    # The stiffness of contacts is that in the equilibrium: in the drawing, they may be unloaded.
    rest = _find_start(active, time, EQUILIBRIUM) if contacts_of(equations) else None
    near = start if rest is None else start._replace(q=rest.q)
    smooth = _observe_state(
        equations, trajectory, observe, time, _find_smooth(equations, trajectory, time, near)
    )
    if rest is None:
        solver = ConsistencySolver(active)
        rest = find_smooth_state(solver, time, start.q, start.v, is_at_rest=True)
    # Friction by the speed of a driver is no inertia: it begins in equilibrium, too.
    balanced = _observe_moving(equations, trajectory, observe, time, rest, start.v)
    changes, by_inertia = np.abs(smooth - drawn), np.abs(smooth - balanced)
    is_inertia = by_inertia >= _MIN_PART_OF_INERTIA * changes
    vibrations = {x: _vibration_in_peak(equations, trajectory, observe, x) for x in peaks}
    limits = _MAX_OVERSHOOT * changes
    if not any(
        is_inertia[peak.column] and 0.0 < size <= limits[peak.column]
        for peak, size in vibrations.items()
    ):
        return "", set()
    # The start does not change the torque of a crank at its dead center, but the vibration does.
    caused = [
        peak
        for peak, size in vibrations.items()
        if size > 0.0 and (is_inertia[peak.column] or size > limits[peak.column])
    ]
    remedy = _recommend_rotation(active, trajectory, time, start) or (
        f"use bd.periodic if the motion repeats, or start the law of {drivers} smoothly, as "
        "bd.run_up does"
    )
    sentence = _describe(caused, equations, f"{cause} and inertia acts suddenly", remedy)
    return sentence, {x.column for x in caused}


def _find_sudden_drivers(
    e: EquationsOfMotion, trajectory: Trajectory, time: Array, q: Array
) -> tuple[str, str]:
    """Return the drivers that do not start from rest, and a phrase about them, or "".

    Drivers that begin at rest with an acceleration count if the motion repeats: otherwise, the
    vibration may be that of a positioning motion.
    """
    _, rates, accelerations = ConsistencySolver(e).constraint_levels(time, q, np.zeros(e.n))
    change, is_sudden = "a velocity", rates != 0.0
    if not np.any(is_sudden) and np.any(accelerations) and _repeats(e, trajectory):
        change, is_sudden = "an acceleration", accelerations != 0.0
    drivers = [e.lam_names[k].rpartition(".")[0] for k in np.flatnonzero(is_sudden)]
    return _describe_start(list(dict.fromkeys(drivers)), change)


def _find_moving_bodies(e: EquationsOfMotion, time: Array, start: State) -> tuple[str, str]:
    """Return the bodies with given velocities, and a phrase about them, or "".

    Velocities that are mostly those of a vibration do not count.
    """
    names = [x.name for x in e.parts if not x.is_state and np.any(e.v0[x.rows])]
    smooth = find_smooth_state(ConsistencySolver(e), time, start.q, start.v) if names else None
    if smooth is None:
        return "", ""
    given, vibration = (
        np.max(np.abs(v) / e.position_scales) for v in (start.v, start.v - smooth.v)
    )
    return _describe_start(names if vibration < _MAX_VIBRATION_SHARE * given else [], "a velocity")


def _describe_start(names: list[str], change: str) -> tuple[str, str]:
    listed = list_first(names, _MAX_NAMES)
    return listed, f"{listed} start{'s' * (len(names) == 1)} with {change}"


def _has_moving_drivers(e: EquationsOfMotion, trajectory: Trajectory, q: Array) -> bool:
    """Return True if constraints depend on time during the run."""
    solver, still = ConsistencySolver(e), np.zeros(e.n)
    levels = [
        solver.constraint_levels(np.array([t, t]), q, still)[0]
        for t in np.linspace(trajectory.start, trajectory.end, _DRIVER_SAMPLES)
    ]
    return bool(np.max(np.ptp(levels, axis=0), initial=0.0) > _ROUNDING * e.length)


def _without_impacts(
    equations: EquationsOfMotion, trajectory: Trajectory, peaks: list[_EarlyPeak]
) -> list[_EarlyPeak]:
    """Return the peaks at which no body is in contact with a surface that it has hit."""
    gaps = compile_surface_gaps(equations) if peaks and contacts_of(equations) else ()
    for gap in gaps:
        if peaks and _is_hit(gap, trajectory):
            first, times = trajectory.intervals[0], np.array([x.time for x in peaks])
            distances = gap.evaluate(times, first.branch, trajectory.positions_at(times))
            peaks = [x for x, d in zip(peaks, distances, strict=True) if not d < 0.0]
    return peaks


def _is_hit(gap: SurfaceGapTerm, trajectory: Trajectory) -> bool:
    """Return True if a gap opens wider than it is deep, or closes at the start with a speed."""
    distances = np.concatenate(
        [gap.evaluate(x.t, x.branch, x.state.q) for x in trajectory.intervals]
    )
    if np.max(distances) > -np.min(distances):
        return True
    first = trajectory.intervals[0]
    q, v = first.state.q[0], first.state.v[0]
    speed = float(np.abs(v) @ gap.lengths)
    if not speed:
        return False
    change = _DIFFERENCE * gap.length / speed * v
    ends = np.stack([q - change, q + change])
    before, after = gap.evaluate(first.t[[0, 0]], first.branch, ends)
    return bool(before - after > _MIN_SPEED_SHARE * _DIFFERENCE * gap.length)


def _vibration_in_peak(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    observe: Callable[..., Array],
    peak: _EarlyPeak,
) -> float:
    """Return the contribution of vibrations to a peak, or 0 if it is small without later peaks."""
    (at,), states = trajectory.at(np.array([peak.time]))
    state = State(*(x[0] for x in states))
    smooth = _find_smooth(equations, trajectory, at, state)
    for _ in range(_CONTACT_ITERATIONS if smooth and contacts_of(equations) else 0):
        smooth = smooth and _find_smooth(equations, trajectory, at, state._replace(q=smooth.q))
    values = _observe_state(equations, trajectory, observe, at, smooth)
    share = (peak.value - values[peak.column]) * np.sign(peak.value)
    excess = min(share, abs(peak.value) - peak.later)
    return float(share) if excess > _MIN_EXCESS * abs(peak.value) else 0.0


def _repeats(e: EquationsOfMotion, trajectory: Trajectory) -> bool:
    """Return True if the mechanism goes on to leave its start and to come back to it."""
    rigid = [k for x in e.parts if not x.is_state for k in range(x.rigid.start, x.rigid.stop)]
    duration = trajectory.end - trajectory.start
    times = np.linspace(trajectory.start, trajectory.end, _REPETITION_SAMPLES)
    q = trajectory.positions_at(times, rigid) / e.position_scales[rigid]
    distances = np.max(np.abs(q - q[0]), axis=1, initial=0.0)
    late = distances[times > trajectory.start + _LATE_SHARE_OF_MOTION * duration]
    largest = np.max(distances)
    has_returned = np.min(late) < _MAX_DISTANCE_OF_RETURN * largest
    return bool(has_returned and np.max(late) > _MIN_LATE_AMPLITUDE * largest)


def _find_smooth(
    equations: EquationsOfMotion, trajectory: Trajectory, time: Array, state: State
) -> State | None:
    """Return the state without vibrations near a state of a run, or None."""
    interval = trajectory.intervals[int(trajectory.interval_index(time[:1])[0])]
    solver = ConsistencySolver(interval.active_equations(equations))
    return find_smooth_state(solver, time, state.q, state.v)


def _observe_moving(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    observe: Callable[..., Array],
    time: Array,
    rest: State | None,
    v: Array,
) -> Array:
    """Return the columns (k,) at an equilibrium with velocities; not a number without it."""
    first = trajectory.intervals[0]
    solver = ConsistencySolver(first.active_equations(equations))
    try:
        state = None if rest is None else solver.start_state(time, rest.q, v)
    except (BeamdaeError, SingularMatrixError):
        state = None
    return _observe_state(equations, trajectory, observe, time, state)


def _observe_state(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    observe: Callable[..., Array],
    time: Array,
    state: State | None,
) -> Array:
    """Return the columns (k,) at a state of the parts that are active at a time, or NaN."""
    if state is None:
        return np.full(len(equations.observed_headers), np.nan)
    interval = trajectory.intervals[int(trajectory.interval_index(time[:1])[0])]
    q, v, a, lam = (x[None] for x in state)
    if interval.configuration is not None:
        lam = interval.configuration.expand_multipliers(lam, equations.m)
    (values,) = observe(time[None], q, v, a, lam)
    return np.asarray(values)


def _recommend_rotation(
    e: EquationsOfMotion, trajectory: Trajectory, time: Array, start: State
) -> str:
    """Return the advice to start with the lasting rotation of the whole mechanism, or ""."""
    # Imported here because few runs need it.
    from beamdae.equations.starts.steady_rotation import RotatingCoordinates

    frame = RotatingCoordinates.from_equations(e)
    duration = trajectory.end - trajectory.start
    times = trajectory.start + duration * np.array(_ROTATION_SAMPLES)
    _, later = trajectory.at(times)
    shift = [frame.translation_vector(axis) for axis in (0, 1)]

    def fit(q: Array, v: Array) -> tuple[Array, float]:
        """Return the speed and the velocity of the origin, and the largest error."""
        shapes = np.stack([frame.generator @ q + frame.angle_vector, *shift], axis=1)
        rates = np.linalg.lstsq(shapes, v)[0]
        return rates, float(np.max(np.abs(shapes @ rates - v)))

    rates, error = fit(start.q, start.v)
    speeds = [fit(q, v)[0][0] for q, v in zip(later.q, later.v, strict=True)]
    is_rigid = error <= _RIGID_ROTATION_TOLERANCE * np.max(np.abs(start.v))
    is_lasting = np.max(np.abs(speeds - rates[0])) <= _MAX_SPEED_CHANGE * abs(rates[0])
    if not rates[0] or not is_rigid or not is_lasting:
        return ""
    center = np.array([-rates[2], rates[1]]) / rates[0]
    center[np.abs(center) <= _ROUNDING * e.length] = 0.0
    rotation = Rotation(float(rates[0]), (float(center[0]), float(center[1])))
    if _find_start(e, time, rotation) is None:
        return ""
    place = ", ({:.6g}, {:.6g})".format(*rotation.center) if any(rotation.center) else ""
    return f"use start=bd.rotation({rotation.speed:.6g}{place})"


def _find_early_peaks(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    observe: Callable[..., Array],
    early_share: float,
    late_share: float,
) -> list[_EarlyPeak]:
    """Return the largest magnitudes of forces and stresses that are early and exceed later ones."""
    start, duration = trajectory.start, trajectory.end - trajectory.start
    early = []
    for k, header in enumerate(equations.observed_headers):
        if header in extremes and Header.of(header).unit in _UNITS:
            x = extremes[header]
            sides = (x.max, x.max_time), (x.min, x.min_time)
            value, time = max(sides, key=lambda side: abs(side[0]))
            if start < time <= start + early_share * duration:
                early.append((k, value, time))
    if not early:
        return []
    magnitudes = _later_magnitudes(trajectory, start + late_share * duration, observe)
    peaks = [_EarlyPeak(k, value, time, float(magnitudes[k])) for k, value, time in early]
    return [x for x in peaks if abs(x.value) - x.later > _MIN_EXCESS * abs(x.value)]


def _describe(peaks: list[_EarlyPeak], e: EquationsOfMotion, cause: str, remedy: str) -> str:
    """Return the sentence about the peak with the largest excess."""
    headers = e.observed_headers
    worst = max(peaks, key=lambda x: x.excess)
    name = remove_unit(headers[worst.column])
    others = [remove_unit(headers[x.column]) for x in peaks if x.column != worst.column]
    unit = Header.of(headers[worst.column]).unit
    return (
        f"{name_with_others(name, list(dict.fromkeys(others)))}: its value of largest magnitude, "
        f"{worst.value:.4g} {unit} at t = {worst.time:.3g} s, belongs to a vibration that begins "
        f"because {cause} (largest magnitude later: {worst.later:.4g} {unit}); {remedy}."
    )


def _later_magnitudes(trajectory: Trajectory, begin: float, observe: Callable[..., Array]) -> Array:
    """Return the largest magnitudes (k,) of the observed columns from `begin` on."""
    magnitudes = []
    for interval in trajectory.intervals:
        step, rows = interval.nodes_per_step, interval.times[:: interval.nodes_per_step]
        first = int(np.searchsorted(rows[:, 0], begin))
        for k in range(first, len(rows), _MAX_ROWS_AT_ONCE):
            block = slice(k, k + _MAX_ROWS_AT_ONCE)
            values = observe(rows[block], *(x[::step][block] for x in interval.rows))
            magnitudes.append(np.abs(values).max(axis=0))
    return np.asarray(np.max(magnitudes, axis=0))


def _find_start(equations: EquationsOfMotion, time: Array, request: str | Rotation) -> State | None:
    """Return the state at the requested start of a run, or None if there is none."""
    # Imported here because few runs need such a start.
    from beamdae.equations.starts.initial_conditions import apply_initial_conditions

    try:
        started = apply_initial_conditions(equations, request, float(time[0]))
        return ConsistencySolver(started).start_state(time, started.q0, started.v0)
    except (BeamdaeError, SingularMatrixError):
        return None


def _is_near(
    equations: EquationsOfMotion, trajectory: Trajectory, q: Array, rest: Array, is_driven: bool
) -> bool:
    """Return True if positions are near the equilibrium.

    Displacements are compared with the motion of the run, with penetrations of contacts, which are
    no motion of interest, and, with drivers, with the mechanism.
    """
    times = np.linspace(trajectory.start, trajectory.end, _AMPLITUDE_SAMPLES)
    amplitudes = 0.5 * np.ptp(trajectory.positions_at(times), axis=0)
    distance, amplitude = (
        np.max(equations.without_states(x) / equations.position_scales, initial=0.0)
        for x in (np.abs(rest - q), amplitudes)
    )
    time = trajectory.intervals[0].times[0]
    gaps = compile_surface_gaps(equations) if contacts_of(equations) else ()
    depths = [-float(x.evaluate(time[:1], time[1], rest[None])[0]) for x in gaps]
    limits = (
        _MAX_DISPLACEMENT * amplitude,
        _MAX_DISPLACEMENT_OF_DRIVEN * is_driven,
        _MAX_PENETRATIONS * max(depths, default=0.0) / equations.length,
    )
    return bool(distance <= max(limits))
