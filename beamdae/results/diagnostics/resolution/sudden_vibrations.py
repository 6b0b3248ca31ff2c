"""Warnings about fast vibrations after sudden loads that adaptive steps damp or delay.

A load that jumps, an impact and a start out of equilibrium excite vibrations of all natural modes.
Steps chosen for positions pass over the fast ones, whose positions are small, but of which rates
and reactions contain shares that decrease slowly with the frequency. A jump of the velocities by
dv and of the accelerations by da excites a mode x with x^T M x = 1 to the amplitude

    A = |x^T M da / w^2 + i x^T M dv / w|

A step h multiplies it by R(i w h) instead of exp(i w h). Errors are the products of A and the
largest difference from 1 of the products of R(i w h) / exp(i w h), up to the time to which the
damping of sections and controllers lets the vibration last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.rank import scaled_null_space
from beamdae.equations.starts.smooth_motion import find_smooth_state
from beamdae.errors import BeamdaeError, format_error, name_with_others
from beamdae.parts.mechanism import EQUILIBRIUM
from beamdae.results.columns import remove_unit
from beamdae.results.diagnostics.resolution.missed_peaks import (
    StepExtremes,
    mark_noise,
    select_large_columns,
)
from beamdae.results.diagnostics.suspected_errors import SuspectedError
from beamdae.results.trajectory import Interval, Trajectory
from beamdae.symbolic.sparse_operators import build_selection

Array = np.ndarray

# Error relative to half the range from which on a run has a warning. In 96 runs of cantilevers with
# 2 to 16 elements, undamped or with damping of 1e-7 to 1e-5 s, under loads that jump, releases and
# moving masses, 38 of 42 errors above 2 % are found, and all 41 runs above it have errors of more
# than 2 %. Errors above it are 0.5 to 1.3 times the estimate, and a third of it for axial forces in
# a bent beam. Axial forces by the deflection of a straight beam, and the small moment beside the
# hinge of a pendulum (15 and 55 % off), are underestimated.
_MAX_ERROR = 0.03
_RECOMMENDED_ERROR = 0.01
_LARGE_ERROR = 1.0
_MIN_SHARE = 1e-2  # of the largest half range of the same kind of columns
_MAX_COORDINATES = 500  # of dense eigenvalue problems
_MAX_JUMPS = 3  # the largest jumps of a run are examined
# Jumps relative to the largest velocity and acceleration after them, which are rounding errors.
_MIN_JUMP = 1e-9
_MAX_COMPARED_ROWS = 1000
_MIN_STEPS = 5  # between jumps
_MAX_CHANGE = 2.0  # of a vibration by steps, relative to its amplitude
_MODES_AT_ONCE = 8  # modes whose changes are computed before errors are compared with their limits
# w h of the slowest modes that are examined: phase errors of slower ones are below 3e-9 in a step.
_MIN_PHASE_OF_RADAU, _MIN_PHASE_OF_BDF = 0.1, 2e-3
_MAX_GROUPS = 1000  # of consecutive steps with one length
_MAX_HALVINGS = 16  # of steps, in the search for a sufficient one
_INERTIA_TOLERANCE = 1e-14
# Growth of modes that are left out, as an exponent over the interval: the vibration about rest is
# unstable, as friction laws of users and follower forces make it, and does not describe the run.
_MAX_GROWTH = 1.0
_DIFFERENCE = 1e-5  # change of a coordinate, relative to its scale, for differences
_BDF_ORDER = 2  # of `Ida` with fast modes that are lightly damped
_DAMPING_SAMPLES = 16  # states of a run at which the damping of vibrations is computed
# Change of the stiffness of a mode by which its shape still describes the vibration at another
# position. After large rotations, it strains exact beams, whose damping would be far too large.
_MAX_STIFFNESS_RATIO = 1.5
# Smallest ratio of frequencies, and of the momentum, of the same mode at two positions.
_MIN_RATE_RATIO, _MIN_COSINE = 0.5, 0.7
_TINY = 1e-300  # prevents a division by zero


class _Modes(NamedTuple):
    """Natural modes under the constraints.

    Attributes
    ----------
    rates
        Angular frequencies (k,) [rad/s].
    shapes
        Shapes (n, k) with x^T M x = 1.
    impulses
        M x (n, k).
    reactions
        Multipliers (m, k) of a vibration with the amplitude 1.
    """

    rates: Array
    shapes: Array
    impulses: Array
    reactions: Array


class _Jump(NamedTuple):
    """Vibrations after a jump.

    Attributes
    ----------
    time
        Time of the jump [s].
    steps, counts
        Lengths of the groups of steps [s] and numbers of their steps, (groups,).
    rates
        Angular frequencies of the modes, (k,) [rad/s].
    decays
        Exponents (groups, k) by which the modes have decayed at the ends of the groups [-].
    columns
        Amplitudes of the columns (k, columns).
    """

    time: float
    steps: Array
    counts: Array
    rates: Array
    decays: Array
    columns: Array


def sudden_vibration_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    observe: Callable[..., Array],
    integrator: Mapping[str, Any],
) -> Iterator[SuspectedError]:
    """Yield a warning if steps do not resolve vibrations that sudden loads or impacts excite.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    extremes
        Extremes of the observed columns, by header.
    observe
        Function that returns the observed columns at rows of (t, branch) and of q, v, a, lam.
    integrator
        Settings of the run. `Radau`, and `Ida` of order 2, are examined.
    """
    method, amplify, min_phase = integrator.get("method"), amplify_by_radau, _MIN_PHASE_OF_RADAU
    if method == "Ida" and integrator["max_order"] <= _BDF_ORDER:
        amplify, min_phase = _amplify_by_bdf, _MIN_PHASE_OF_BDF
    elif method != "Radau":
        return
    is_small = equations.n <= _MAX_COORDINATES and bool(beams_of(equations.mechanism))
    half_ranges = _select_columns(equations, extremes, integrator) if is_small else {}
    if not half_ranges:
        return
    numbers = [equations.observed_headers.index(x) for x in half_ranges]
    sizes = np.array(list(half_ranges.values()))
    examined = []
    for interval, v, dv, da in _list_jumps(equations, trajectory):
        try:
            excited = _excite(equations, interval, v, dv, da, min_phase, observe, numbers)
            if excited is None:
                continue
            jump, modes = excited
            errors = _find_large_errors(jump, amplify, _MAX_ERROR * sizes)
            if errors is not None:
                later = _accumulate_later_decays(equations, interval, modes, jump)
                # Vibrations that grow later, as by friction, do not remain those of the jump.
                remains = later[-1] > -_MAX_GROWTH
                jump = jump._replace(
                    decays=np.maximum(jump.decays, later), columns=jump.columns * remains[:, None]
                )
                errors = _find_large_errors(jump, amplify, _MAX_ERROR * sizes)
        except (BeamdaeError, np.linalg.LinAlgError):
            continue  # unstable or singular positions have their own warnings
        if errors is not None:
            examined.append((jump, errors / sizes))
    if examined:
        jump, errors = max(examined, key=lambda x: float(np.max(x[1])))
        yield _describe(jump, errors, list(half_ranges), sizes, method == "Radau")


def _select_columns(
    equations: EquationsOfMotion,
    extremes: Mapping[str, StepExtremes],
    integrator: Mapping[str, Any],
) -> dict[str, float]:
    """Return half the ranges of columns that are not small or noise, by header."""
    if not extremes:
        return {}
    half_ranges = select_large_columns(list(extremes), extremes, equations.length, _MIN_SHARE)
    if not half_ranges:
        return {}
    headers, length = list(half_ranges), equations.length
    values = np.array([[extremes[x].min, extremes[x].max] for x in headers]).T
    sizes = np.array(list(half_ranges.values()))
    is_noise = mark_noise(headers, values, sizes, length, integrator.get("rtol") or 0.0)
    return {x: half_ranges[x] for x, noise in zip(headers, is_noise, strict=True) if not noise}


def _list_jumps(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> list[tuple[Interval, Array, Array, Array]]:
    """Return the intervals after the largest jumps, smooth velocities, and jumps of (v, a).

    At a start as drawn or in equilibrium, the jumps begin at rest. A start with other positions,
    such as the end of another run, or with velocities of deformations is none. Jumps do not contain
    the motion that elastic parts follow without vibrations, such as that of a driver.
    """
    jumps, sizes = [], []
    v = a = np.zeros(equations.n)
    scales = equations.position_scales
    is_continued = equations.start is not None and equations.start[0] != EQUILIBRIUM
    # Periodic motions begin with velocities of deformations.
    is_elastic = np.ones(equations.n, bool)
    for part in equations.parts:
        is_elastic[part.rigid] = False
    is_continued |= bool(np.any(equations.v0[is_elastic]))
    for number, interval in enumerate(trajectory.intervals):
        first, last = (State(*(x[k] for x in interval.state)) for k in (0, -1))
        is_jump = number > 0 or not is_continued
        if is_jump and len(interval.t) > _MIN_STEPS:
            step = float(np.median(np.diff(interval.t)))
            dv, da = first.v - v, first.a - a
            if _jumps(dv, interval.state.v, scales) or _jumps(da, interval.state.a, scales):
                jumps.append(number)
                change = np.abs(da) + np.abs(dv) / step
                sizes.append(float(np.max(change / scales)))
        v, a = last.v, last.a
    order = np.argsort(-np.array(sizes), kind="stable")[:_MAX_JUMPS]
    return [
        (trajectory.intervals[number], *_measure_jump(equations, trajectory, number))
        for number in (jumps[k] for k in order.tolist())
    ]


def _measure_jump(
    equations: EquationsOfMotion, trajectory: Trajectory, number: int
) -> tuple[Array, Array, Array]:
    """Return velocities of the smooth motion, and jumps of (v, a) of vibrations, (n,) each."""
    interval = trajectory.intervals[number]
    v, a = _vibration(equations, interval, 0)
    smooth = interval.state.v[0] - v
    if number:
        v_before, a_before = _vibration(equations, trajectory.intervals[number - 1], -1)
        v, a = v - v_before, a - a_before
    return smooth, v, a


def _vibration(equations: EquationsOfMotion, interval: Interval, row: int) -> tuple[Array, Array]:
    """Return velocities and accelerations (n,) without those of the smooth motion."""
    time = interval.times[:: interval.nodes_per_step][row]
    state = State(*(x[row] for x in interval.state))
    solver = ConsistencySolver(interval.active_equations(equations))
    smooth = find_smooth_state(solver, time, state.q, state.v)
    if smooth is None:
        return state.v, state.a
    return state.v - smooth.v, state.a - smooth.a


def _jumps(change: Array, values: Array, scales: Array) -> bool:
    """Return True if a change (n,) is larger than rounding of the values (rows, n) after it."""
    values = values[:: len(values) // _MAX_COMPARED_ROWS + 1]
    return bool(np.max(np.abs(change) / scales) > _MIN_JUMP * np.max(np.abs(values) / scales))


def _excite(
    equations: EquationsOfMotion,
    interval: Interval,
    v: Array,
    dv: Array,
    da: Array,
    min_phase: float,
    observe: Callable[..., Array],
    numbers: list[int],
) -> tuple[_Jump, _Modes] | None:
    """Return the vibrations after a jump and their modes, or None if steps resolve all modes."""
    active = interval.active_equations(equations)
    steps, counts = _group_steps(interval)
    time = interval.times[0]
    slowest = min_phase / float(np.max(steps))
    solver, state = ConsistencySolver(active), State(*(x[0] for x in interval.state))
    modes = _find_modes(solver, time, state.q, slowest)
    if modes is None:
        return None
    by_force, by_impulse = modes.impulses.T @ da, modes.impulses.T @ dv
    # A contact that begins to touch has damping, and friction, only where its vibration ends.
    end = state._replace(q=state.q + modes.shapes @ (by_force / modes.rates**2), v=v)
    decays = _decay_rates(solver, time, end, modes)
    is_lasting = decays * float(counts @ steps) > -_MAX_GROWTH
    if not is_lasting.any():
        return None
    modes = _Modes(*(x[..., is_lasting] for x in modes))
    vibrating = modes
    if interval.configuration is not None:
        reactions = interval.configuration.expand_multipliers(modes.reactions.T, equations.m)
        modes = modes._replace(reactions=reactions.T)
    by_force, by_impulse, decays = (x[is_lasting] for x in (by_force, by_impulse, decays))
    amplitudes = np.hypot(by_force / modes.rates**2, by_impulse / modes.rates)
    columns = amplitudes[:, None] * _observe_modes(equations, time, state, modes, observe)
    decays = np.outer(np.cumsum(counts * steps), decays)
    jump = _Jump(float(time[0]), steps, counts, modes.rates, decays, columns[:, numbers])
    return jump, vibrating


def _group_steps(interval: Interval) -> tuple[Array, Array]:
    """Return mean lengths of groups of consecutive steps [s], and numbers of their steps."""
    nodes = interval.t
    if interval.record is not None:
        nodes = interval.record.nodes[:: interval.record.nodes_per_step]
    lengths = np.diff(nodes)
    lengths = lengths[lengths > 0.0]
    starts = np.arange(0, len(lengths), len(lengths) // _MAX_GROUPS + 1)
    counts = np.diff(np.append(starts, len(lengths)))
    return np.add.reduceat(lengths, starts) / counts, counts


def _find_modes(solver: ConsistencySolver, time: Array, q: Array, slowest: float) -> _Modes | None:
    """Return the modes above an angular frequency [rad/s], about rest at a position.

    The result is None if there are none, or if matrices are not finite.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a motion diverges at a larger rate.
    """
    e = solver.equations
    matrices = solver.linearize_forces(time, solver.rest_state(q))
    stiffness, _, mass = (x.toarray() for x in matrices)
    jacobian = solver.constraint_matrix(time, q)
    if not all(np.isfinite(x).all() for x in (stiffness, mass, jacobian.data)):
        return None
    fixed = sp.vstack([jacobian, build_selection(list(e.states), e.n)])
    basis = scaled_null_space(fixed, e.position_scales)
    reduced, of_stiffness = (0.5 * basis.T @ (x + x.T) @ basis for x in (mass, stiffness))
    # Coordinates without inertia have the eigenvalue 0 of the inverse problem.
    shifted = of_stiffness + slowest**2 * reduced
    if not len(shifted) or not np.isfinite(shifted).all():
        return None
    inverses, vectors = la.eigh(reduced, shifted)
    is_fast = (inverses < 0.5 / slowest**2) & (
        inverses > _INERTIA_TOLERANCE * np.max(inverses, initial=0.0)
    )
    if not is_fast.any():
        return None
    vectors = vectors[:, is_fast] / np.sqrt(inverses[is_fast])
    rates = np.sqrt(1.0 / inverses[is_fast] - slowest**2)
    shapes = basis @ vectors
    impulses = mass @ shapes
    loads = impulses * rates**2 - stiffness @ shapes
    reactions = la.lstsq(jacobian.toarray().T, loads)[0] if e.m else np.zeros((0, len(rates)))
    return _Modes(rates, shapes, impulses, reactions)


def _accumulate_later_decays(
    equations: EquationsOfMotion, interval: Interval, modes: _Modes, jump: _Jump
) -> Array:
    """Return the exponents (groups, k) of the decay by the damping at states of the run.

    Controllers that are saturated at the start have no damping there. Between two states, the
    smaller one of their decay rates is assumed.
    """
    solver = ConsistencySolver(interval.active_equations(equations))
    times = interval.times[:: interval.nodes_per_step]
    rows = np.unique(np.linspace(0, len(times) - 1, _DAMPING_SAMPLES).astype(int))
    rates = np.array(
        [
            _decay_rates_elsewhere(solver, times[k], State(*(x[k] for x in interval.state)), modes)
            for k in rows.tolist()
        ]
    )
    samples = times[rows, 0] - times[0, 0]
    slower = np.minimum(rates[:-1], rates[1:]) * np.diff(samples)[:, None]
    exponents = np.vstack([np.zeros(rates.shape[1]), np.cumsum(slower, axis=0)])
    ends = np.cumsum(jump.counts * jump.steps)
    return np.stack([np.interp(ends, samples, x) for x in exponents.T], axis=1)


def _decay_rates(solver: ConsistencySolver, time: Array, state: State, modes: _Modes) -> Array:
    """Return the decay rates (k,) [1/s] of modes by the damping at a state."""
    stiffness, damping, _ = (x.toarray() for x in solver.linearize_with_states(time, state))
    of_shapes = np.sum(modes.shapes * (stiffness @ modes.shapes), axis=0)
    decays = 0.5 * np.sum(modes.shapes * (damping @ modes.shapes), axis=0)
    decays[of_shapes > _MAX_STIFFNESS_RATIO * modes.rates**2] = 0.0
    return decays + _decays_by_states(
        stiffness, damping, list(solver.equations.states), modes.shapes, modes.rates
    )


def _decay_rates_elsewhere(
    solver: ConsistencySolver, time: Array, state: State, modes: _Modes
) -> Array:
    """Return the decay rates (k,) [1/s] of vibrations at a state far from that of their modes.

    Those whose shape would be stiffer there decay like the mode of this state that has most of
    their momentum. Without such a mode, they do not decay.
    """
    decays = _decay_rates(solver, time, state, modes)
    unknown = np.flatnonzero(decays == 0.0)
    if not len(unknown):
        return decays
    here = _find_modes(solver, time, state.q, _MIN_RATE_RATIO * float(modes.rates[unknown].min()))
    if here is not None:
        shares = np.abs(modes.impulses.T[unknown] @ here.shapes)
        alike = np.argmax(shares, axis=1)
        is_known = np.max(shares, axis=1) > _MIN_COSINE
        decays[unknown] = np.where(is_known, _decay_rates(solver, time, state, here)[alike], 0.0)
    return decays


def _decays_by_states(
    stiffness: Array, damping: Array, states: list[int], shapes: Array, rates: Array
) -> Array:
    """Return the decay rates (k,) [1/s] that first-order states cause, such as those of filters.

    In a vibration with the angular frequency w, states respond to the mode x and exert a force on
    it, x^T D x with the dynamic stiffness D; its decay rate is Im(x^T D x) / (2 w). The derivative
    filter of a PID turns stiffness into damping, for example.
    """
    if not states:
        return np.zeros(len(rates))
    block = np.ix_(states, states)
    dynamic = stiffness[block] + 1j * rates[:, None, None] * damping[block]
    inputs, outputs = (
        x @ shapes + 1j * rates * (y @ shapes)
        for x, y in (
            (stiffness[states], damping[states]),
            (stiffness[:, states].T, damping[:, states].T),
        )
    )
    responses = np.linalg.solve(dynamic, inputs.T[:, :, None])[:, :, 0]
    forces = -np.sum(outputs.T * responses, axis=1)
    return np.maximum(forces.imag / (2.0 * rates), 0.0)


def _observe_modes(
    equations: EquationsOfMotion,
    time: Array,
    state: State,
    modes: _Modes,
    observe: Callable[..., Array],
) -> Array:
    """Return the amplitudes of columns (k, columns) in vibrations of the modes."""
    rates, shapes = modes.rates, modes.shapes
    sizes = np.max(np.abs(shapes) / equations.position_scales[:, None], axis=0)
    scales = _DIFFERENCE / np.maximum(sizes, _TINY)
    still = np.zeros_like(shapes)
    at_turn = State(shapes, still, -shapes * rates**2, modes.reactions)
    at_middle = State(still, shapes * rates, still, np.zeros_like(modes.reactions))
    times = np.tile(time, (len(rates), 1))

    def difference(change: State) -> Array:
        values = [
            observe(
                times, *(x + sign * (scales * dx).T for x, dx in zip(state, change, strict=True))
            )
            for sign in (1.0, -1.0)
        ]
        return np.asarray((values[0] - values[1]) / (2.0 * scales[:, None]))

    return np.hypot(difference(at_turn), difference(at_middle))


def _estimate_errors(
    jump: _Jump, amplify: Callable[[Array], Array], max_step: float = np.inf
) -> Array:
    """Return the errors of columns (columns,) with steps of at most `max_step` [s]."""
    return _add_up(_estimate_changes(jump, amplify, max_step)[:, None] * jump.columns)


def _find_large_errors(
    jump: _Jump, amplify: Callable[[Array], Array], limits: Array
) -> Array | None:
    """Return `_estimate_errors`, or None if no error (columns,) exceeds its limit.

    The modes with the largest amplitudes come first: they often suffice, because steps change
    the vibrations of the other modes by at most twice their amplitude.
    """
    order = np.argsort(-np.max(jump.columns / limits, axis=1, initial=0.0), kind="stable")
    changes = np.full(len(order), _MAX_CHANGE)
    errors = _add_up(changes[:, None] * jump.columns)
    for first in range(0, len(order), _MODES_AT_ONCE):
        if not np.any(errors > limits):
            return None
        modes = order[first : first + _MODES_AT_ONCE]
        some = jump._replace(rates=jump.rates[modes], decays=jump.decays[:, modes])
        changes[modes] = _estimate_changes(some, amplify)
        errors = _add_up(changes[:, None] * jump.columns)
    return errors if np.any(errors > limits) else None


def _estimate_changes(
    jump: _Jump, amplify: Callable[[Array], Array], max_step: float = np.inf
) -> Array:
    """Return the largest changes (k,) of vibrations of the modes, relative to their amplitudes."""
    steps = np.minimum(jump.steps, max_step)
    counts = jump.counts * (jump.steps / steps)
    phases = 1j * np.outer(steps, jump.rates)
    # Errors of rounding must not let vibrations grow.
    changes = np.log(amplify(phases)) - phases
    changes.real = np.minimum(changes.real, 0.0)
    products = np.exp(np.cumsum(counts[:, None] * changes, axis=0))
    return np.asarray(np.max(np.exp(-jump.decays) * np.abs(products - 1.0), axis=0))


def _add_up(amplitudes: Array) -> Array:
    """Return the amplitudes of columns (columns,) in vibrations of all modes (k, columns).

    Vibrations with unrelated phases add up to a value between the root of the sum of squares and
    the sum, of which the geometric mean is taken.
    """
    total, squares = np.sum(amplitudes, axis=0), np.sum(amplitudes**2, axis=0)
    return np.asarray(np.sqrt(total * np.sqrt(squares)))


def amplify_by_radau(z: Array) -> Array:
    """Return the factor of a step of Radau IIA with three stages, (3, 2)-Pade of exp(z)."""
    return (1.0 + 0.4 * z + z**2 / 20.0) / (1.0 - 0.6 * z + 0.15 * z**2 - z**3 / 60.0)


def _amplify_by_bdf(z: Array) -> Array:
    """Return the principal factor of a step of BDF of order 2."""
    return (2.0 + np.sqrt(1.0 + 2.0 * z)) / (3.0 - 2.0 * z)


def _describe(
    jump: _Jump, errors: Array, headers: list[str], sizes: Array, is_radau: bool
) -> SuspectedError:
    """Return the warning about errors of columns, with a step of `Radau` that is sufficient."""
    order = [k for k in np.argsort(-errors).tolist() if errors[k] > _MAX_ERROR]
    names = [headers[k] for k in order]
    first, *others = map(remove_unit, names)
    largest = float(errors[order[0]])
    size = format_error(largest, _LARGE_ERROR)
    step = max_step = float(np.max(jump.steps))
    for _ in range(_MAX_HALVINGS):
        max_step *= 0.5
        if np.max(_estimate_errors(jump, amplify_by_radau, max_step) / sizes) < _RECOMMENDED_ERROR:
            break
    remedy = f"max_step={max_step:.1g}" if is_radau else f"Radau(max_step={max_step:.1g})"
    return SuspectedError(
        f"{name_with_others(first, others)}: steps of up to {step:.2g} s do not resolve fast "
        f"vibrations that begin suddenly at t = {jump.time:.4g} s, and the error is {size} of "
        f"half its range; use {remedy}, or set damping= of the sections.",
        tuple(names),
        {"max_step": max_step} if is_radau else {},
    )
