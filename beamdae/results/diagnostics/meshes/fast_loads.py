"""Errors by elements that are too long for the waves of loads and drivers that change fast.

A law that jumps, or rises within less time than waves take through an element, excites waves that
the elements do not resolve. Motions without these waves look smooth: they do not show that waves
are missing. Therefore, the linear response to the changes of the laws is computed with the elements
of the model and with shorter ones, and the extremes are compared:

    M x'' + C x' + K x + G^T lam = f(t) - f(0),    G x = -(g(t) - g(0))

at the state before the first fast change. Modal equations are integrated exactly for forces that
are linear between the times of a grid. Largest stress magnitudes follow from the section forces of
this response, which are linear in the motion.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from itertools import takewhile
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.dispersion import axial_wave_error, bending_wave_errors, section_values
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.equations_of_motion import EquationsOfMotion, State, format_headers
from beamdae.equations.measures import ObservedRows
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.rank import RANK_TOLERANCE
from beamdae.errors import BeamdaeError, format_error, list_first, name_with_others
from beamdae.parts.laws import Law
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM
from beamdae.results.columns import Header, remove_unit
from beamdae.results.diagnostics.meshes.moving_loads import measured_quantity
from beamdae.results.diagnostics.meshes.sampled_vibrations import (
    LARGE_ERROR,
    MAX_TURN,
    turning_coordinates,
)
from beamdae.results.diagnostics.resolution.missed_peaks import StepExtremes, select_large_columns
from beamdae.results.section_forces.balance import elastic_section_forces
from beamdae.results.trajectory import Trajectory
from beamdae.symbolic.statements import Quantity

Array = np.ndarray

# Relative error of the frequency of axial and bending waves from which on a change is fast.
_MIN_WAVE_ERROR = 3e-3
# Error of an extreme relative to half the range of the column from which on a run has a warning.
# In 136 runs of rods, cantilevers, frames and shaken beams under pulses, ramps, steps and tables,
# with 1 to 16 elements, 45 of 49 errors above 5 % are found, and all 48 estimates above it are of
# errors above 4 %. The estimate is 0.6 to 2 times the error, and up to 4 times with one element.
# In 394 runs of straight and bent cantilevers with tip masses, all estimates are less than 3 times
# the error, also of largest stresses.
_MAX_ERROR = 0.05
_UNITS = ("m", "rad", "-", "Pa", "N", "N m")
# Columns whose half range is smaller, relative to the largest one of their kind, are left out.
_MIN_SHARE = 1e-2
# Half ranges of positions up to which they are rounding errors, as in a steady rotation, relative
# to the length of the mechanism or to 1 rad.
_ROUNDING = 1e-10
_HALVINGS = 2  # of the compared elements
_MAX_ITERATIONS = 8  # of Newton's method for the state of shorter elements
_NEWTON_TOLERANCE = 1e-4  # relative to the first residual
_MAX_COORDINATES = 700
_MAX_SAMPLED_TIMES = 2000
_MAX_SLOW_SAMPLES = 200  # of functions that accept no arrays
_FAST_SHARE = 0.05  # of the largest rate, in the time of the fast change
_CONSTANT_SHARE = 1e-6  # largest change of a constant law, relative to its range
# Least number of steps of the fast change, and number of times of the response.
_FINE_STEPS, _COARSE_TIMES = 100, 400
_PERIODS = 1.2  # duration of the response, in periods of a clamped beam
_CANTILEVER = 3.516  # angular frequency over sqrt(EI / (rhoA L^4))
_DIFFERENCE = 1e-5  # change of a coordinate, relative to its scale, for differences
_MAX_NAMES = 3  # of beams
_RECOMMENDED_ERROR = 0.02
# Fronts of waves that follow jumps converge slowly.
_MIN_ORDER, _MAX_REFINEMENT = 0.5, 16.0
_SHORT_TIME = 1e-9  # relative to the duration; distance between two times
_MIN_STEP = 1e-12  # relative to the end time; differences over shorter steps are rounding
_TURN_SAMPLES = 50
_MIN_TIMES = 20  # of a response
_TINY = 1e-300  # prevents a division by zero


class _Change(NamedTuple):
    """Fast change of a law.

    Attributes
    ----------
    part
        Name of the part.
    start, end
        Times between which the law changes fast [s].
    rise_time
        Range of the law over its largest rate [s]; 0 if it jumps.
    """

    part: str
    start: float
    end: float
    rise_time: float


class _Response(NamedTuple):
    """Extremes of columns in a linear response: smallest and largest changes, (k,) each."""

    low: Array
    high: Array


def fast_load_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    extremes: Mapping[str, StepExtremes],
    is_periodic: bool = False,
) -> Iterator[str]:
    """Yield a warning if a law changes so fast that the elements of beams do not resolve the waves.

    Runs are examined until an event switches parts, and responses until a beam turns by more than a
    small angle. Mechanisms with first-order states or with many coordinates are not examined.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    extremes
        Extremes of the observed columns, by header.
    is_periodic
        True for a periodic motion. It contains no response to the start, so that only changes of
        laws that are constant before them count.
    """
    intervals = tuple(takewhile(lambda x: not x.inactive, trajectory.intervals))
    trajectory, mechanism = Trajectory(intervals), equations.mechanism
    if mechanism is None or not intervals or len(equations.states) or equations.controllers:
        return
    beams = beams_of(mechanism)
    if not beams:
        return
    change = _find_fastest_change(equations, trajectory, beams, is_periodic)
    if change is None:
        return
    times = _time_grid(equations, trajectory, change, beams)
    end = min(_time_of_turn(equations, trajectory, beam, times) for beam in beams)
    times = times[times <= end]
    if end < change.end or len(times) < _MIN_TIMES:
        return
    half_ranges = _select_columns(equations, extremes)
    refined = _refine(equations) if half_ranges else []
    if len(refined) <= _HALVINGS:
        return
    is_start = change.start <= trajectory.start == 0.0
    before = time_on_branch(equations.breakpoints, float(times[0]))
    if not is_start:
        before[1] = times[0] - _SHORT_TIME * (times[-1] - times[0])
    try:
        # The finest and the coarsest model suffice for most runs.
        columns = list(half_ranges)
        q, sizes = _positions_at(trajectory, change.start), np.array(list(half_ranges.values()))
        balanced = _balance(refined, q, before, _slowest_rate(beams))
        responses: dict[int, _Response] = {}

        def measure(level: int) -> Array:
            for k in (level, _HALVINGS):
                if k not in responses:
                    model, state = refined[k][2], balanced[k]
                    responses[k] = _respond(model, state, times, before, columns, is_start)
            coarse, fine = responses[level], responses[_HALVINGS]
            differences = np.maximum(abs(coarse.low - fine.low), abs(coarse.high - fine.high))
            return np.asarray(differences / sizes)

        errors = measure(0)
        if np.max(errors) > _MAX_ERROR:
            of_columns = dict(zip(columns, errors.tolist(), strict=True))
            yield _describe(change, beams, of_columns, measure(1))
    except (la.LinAlgError, BeamdaeError, ValueError):
        return


def _find_fastest_change(
    equations: EquationsOfMotion, trajectory: Trajectory, beams: list[Beam], is_periodic: bool
) -> _Change | None:
    """Return the change of a law with the shortest rise time; None if elements resolve all."""
    assert equations.mechanism is not None
    is_balanced = equations.start is not None and equations.start.description == EQUILIBRIUM
    is_first = trajectory.start == 0.0 and not (is_balanced or is_periodic)
    changes = []
    for part in equations.mechanism.parts.values():
        for law in part.laws:
            is_sudden = part.is_load and is_first
            change = _measure_change(part.name, law, is_sudden, is_periodic, trajectory)
            if change is not None:
                changes.append(change)
    fastest = min(changes, key=lambda x: x.rise_time, default=None)
    if fastest is None:
        return None
    if fastest.rise_time > 0.0:
        rate = 2.0 / fastest.rise_time
        errors = [
            max(axial_wave_error(x, rate), float(bending_wave_errors(x, np.array([rate]))[0]))
            for x in beams
        ]
        if max(errors) < _MIN_WAVE_ERROR:
            return None
    return fastest


def _measure_change(
    part: str, law: Law, is_sudden: bool, is_periodic: bool, trajectory: Trajectory
) -> _Change | None:
    """Return the fastest change of a law in a run, or None if it is constant.

    If `is_sudden` is True, the law is zero before the run. If `is_periodic` is True, it must be
    constant at the start for longer than it rises.
    """
    times: list[Array] = []
    values: list[Array] = []
    jumps: list[tuple[float, float]] = []
    stride = sum(len(x.t) for x in trajectory.intervals) // _MAX_SAMPLED_TIMES + 1
    for interval in trajectory.intervals:
        t = np.append(interval.t[:-1:stride], interval.t[-1])
        try:
            y = _evaluate(law, interval.branch, t)
        except BeamdaeError:  # depends on sensors or inputs
            return None
        before = values[-1][-1] if values else (0.0 if is_sudden else y[0])
        jumps.append((float(t[0]), abs(float(y[0]) - before)))
        times.append(t)
        values.append(y)
    t, y = np.concatenate(times), np.concatenate(values)
    if not np.all(np.isfinite(y)):  # depends on sensors or inputs
        return None
    span = float(max(np.max(y), 0.0) - min(np.min(y), 0.0)) if is_sudden else float(np.ptp(y))
    if span == 0.0 or float(np.ptp(y)) == 0.0:
        return None
    jump_time, jump = max(jumps, key=lambda x: x[1])
    if jump > _MAX_ERROR * span:
        return _Change(part, jump_time, jump_time, 0.0)
    steps = np.diff(t)
    is_step = steps > _MIN_STEP * trajectory.end
    rates = np.abs(np.diff(y)[is_step]) / steps[is_step]
    largest = float(np.max(rates, initial=0.0))
    if largest == 0.0:
        return None
    if is_periodic:
        departure = t[np.argmax(np.abs(y - y[0]) > _CONSTANT_SHARE * span)]
        if departure - t[0] < span / largest:
            return None
    fast = np.flatnonzero(rates > _FAST_SHARE * largest)
    starts, ends = t[:-1][is_step], t[1:][is_step]
    return _Change(part, float(starts[fast[0]]), float(ends[fast[-1]]), span / largest)


def _evaluate(law: Law, branch: float, times: Array) -> Array:
    """Return the values at ascending times of the piece of a law that is valid at `branch`."""
    piece = law.pieces[bisect_right(law.breakpoints, branch)]
    try:
        # Most functions of numbers accept arrays.
        values = np.asarray(piece(times), float)
    except Exception:
        values = np.zeros(0, object)
    if values.shape in ((), times.shape):
        return np.broadcast_to(values, times.shape)
    single = Law((piece,))
    few = np.linspace(times[0], times[-1], min(len(times), _MAX_SLOW_SAMPLES))
    return np.interp(times, few, [single.at(x) for x in few.tolist()])


def _select_columns(
    equations: EquationsOfMotion, extremes: Mapping[str, StepExtremes]
) -> dict[str, float]:
    """Return half the ranges of columns of positions, strains and stresses, by header."""
    headers = [
        header
        for o in equations.observables
        if not (o.has_accelerations or o.rows.stop > o.rows.start)
        for header in o.headers
        if header in extremes and Header.of(header).unit in _UNITS
    ]
    columns = select_large_columns(headers, extremes, equations.length, _MIN_SHARE)
    limits = {"m": _ROUNDING * equations.length, "rad": _ROUNDING}
    return {x: size for x, size in columns.items() if size > limits.get(Header.of(x).unit, 0.0)}


def _refine(
    equations: EquationsOfMotion,
) -> list[tuple[Array, sp.csc_array, EquationsOfMotion]]:
    """Return maps s + P q of the coordinates to models with halved elements, and their equations.

    The list ends before a model with too many coordinates or with parts that cannot be copied.
    """
    from beamdae.beams.prolongation import halve_elements, prolong_coordinates
    from beamdae.beams.remeshing import choose_base_meshes, replace_beams

    mechanism = equations.mechanism
    assert mechanism is not None
    n = equations.n
    models = [(np.zeros(n), sp.csc_array(sp.eye_array(n)), equations)]
    try:
        bases = choose_base_meshes(mechanism, 1, AS_DRAWN)
        for _ in range(_HALVINGS):
            pairs = {}
            start, prolongation, coarse = models[-1]
            assert coarse.mechanism is not None
            for beam in beams_of(coarse.mechanism):
                base = bases[beam.name]
                if not (base.fixed_by or base.has_custom_kinematics):
                    pairs[beam.name] = (beam, beam.with_mesh(halve_elements(beam.mesh)))
            if not pairs or 2 * coarse.n > _MAX_COORDINATES:
                break
            others = {name: pair[1] for name, pair in pairs.items()}
            fine = equations_of_motion(
                replace_beams(coarse.mechanism, others, "simulate"), AS_DRAWN
            )
            matrix, offset = prolong_coordinates(coarse.q_names, fine.q_names, pairs)
            models.append((offset + matrix @ start, sp.csc_array(matrix @ prolongation), fine))
    except BeamdaeError:
        pass
    return models


def _positions_at(trajectory: Trajectory, time: float) -> Array:
    _, state = trajectory.at(np.array([max(time, trajectory.start)]))
    return np.asarray(state.q[0])


def _balance(
    refined: list[tuple[Array, sp.csc_array, EquationsOfMotion]], q: Array, time: Array, rate: float
) -> list[Array]:
    """Return positions of all models at which they accelerate like the first one at `q` (n,).

    `time` is (t, branch) before the change. In long bent elements, axial strains are zero only at
    the points of the quadrature. Forces of the prolonged strains would change the stiffness of
    shorter elements. Therefore, these are in equilibrium with the inertial forces of the first
    model, up to motions slower than `rate` [rad/s], which change little.
    """
    states, acceleration = [q], np.zeros(0)
    for start, prolongation, model in refined:
        solver = ConsistencySolver(model)
        state = start + prolongation @ q
        basis, _ = _split_motions(solver, time, state)
        if model is refined[0][2]:
            mass = solver.linearize_forces(time, solver.rest_state(q))[2]
            force = basis.T @ solver.force(time, q, np.zeros(model.n))
            acceleration = -basis @ la.solve(basis.T @ (mass @ basis), force)
            continue
        sizes: list[float] = []
        for _ in range(_MAX_ITERATIONS):
            rest = solver.rest_state(state)
            stiffness, _, mass = solver.linearize_forces(time, rest)
            force = solver.force(time, state, rest.v) + mass @ (prolongation @ acceleration)
            residual = basis.T @ force
            sizes.append(float(np.linalg.norm(residual)))
            if sizes[-1] <= _NEWTON_TOLERANCE * sizes[0]:
                break
            matrix = basis.T @ ((stiffness + rate**2 * mass) @ basis)
            state = state - basis @ la.solve(matrix, residual)
        states.append(state)
    return states


def _split_motions(solver: ConsistencySolver, time: Array, q: Array) -> tuple[Array, Array]:
    """Return a basis (n, k) of the free motions, and the motions (n, m) of gaps of constraints."""
    e = solver.equations
    scales = e.position_scales
    if not e.m:
        return scales[:, None] * np.eye(e.n), np.zeros((e.n, 0))
    scaled = solver.constraint_matrix(time, q).toarray() * scales
    left, singular, right = la.svd(scaled, full_matrices=True)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0]))
    driven = scales[:, None] * (right[:rank].T / singular[:rank]) @ left[:, :rank].T
    return scales[:, None] * right[rank:].T, driven


def _time_grid(
    equations: EquationsOfMotion, trajectory: Trajectory, change: _Change, beams: list[Beam]
) -> Array:
    """Return ascending times of the response: of the fast change, and of one bending vibration."""
    longest = 2.0 * math.pi / _slowest_rate(beams)
    begin = max(change.start, trajectory.start)
    duration = max(_PERIODS * longest, 3.0 * (change.end - begin))
    end = min(begin + duration, trajectory.end)
    inside = [x for x in equations.breakpoints if begin < x < end]
    grids = [np.linspace(begin, end, _COARSE_TIMES), np.array(inside)]
    if change.end > begin:
        # Divide the first steps equally: each length of a step takes an exponential of each mode.
        step = (end - begin) / (_COARSE_TIMES - 1)
        divided = math.ceil(min(change.end - begin, end - begin) / step)
        fine = divided * math.ceil(_FINE_STEPS / divided)
        grids.append(np.linspace(begin, begin + divided * step, fine + 1))
    times = np.unique(np.concatenate(grids))
    return times[np.append(True, np.diff(times) > _SHORT_TIME * (end - begin))]


def _slowest_rate(beams: list[Beam]) -> float:
    """Return the lowest angular frequency of the beams as cantilevers [rad/s]."""
    rates = []
    for beam in beams:
        bending, mass = section_values(beam, "EI", "rhoA")
        rates.append(_CANTILEVER * math.sqrt(float(np.min(bending / mass))) / beam.length**2)
    return min(rates)


def _time_of_turn(
    equations: EquationsOfMotion, trajectory: Trajectory, beam: Beam, times: Array
) -> float:
    """Return the last time before the frame, or all sections, turn by more than a small angle."""
    few = times[:: len(times) // _TURN_SAMPLES + 1]
    angles = trajectory.positions_at(few, turning_coordinates(equations, beam))
    turns = np.min(np.abs(angles - angles[0]), axis=1) > MAX_TURN
    return float(few[np.argmax(turns) - 1] if turns.any() else times[-1])


def _respond(
    equations: EquationsOfMotion,
    q: Array,
    times: Array,
    before: Array,
    columns: list[str],
    is_start: bool,
) -> _Response:
    """Return the extremes of the changes of columns in the linear response.

    Parameters
    ----------
    equations
        The equations of motion.
    q
        Positions before the change, (n,).
    times
        Ascending times (k,) [s].
    before
        (t, branch) before the change.
    columns
        Headers of the columns.
    is_start
        Whether the response begins at rest at the start of the run, where forces that are not in
        equilibrium accelerate the mechanism, too.
    """
    e, solver = equations, ConsistencySolver(equations)
    rest = solver.rest_state(q)
    first = time_on_branch(e.breakpoints, float(times[0]))
    stiffness, damping, mass = (x.toarray() for x in solver.linearize_forces(first, rest))
    basis, driven = _split_motions(solver, first, q)
    if not basis.shape[1]:
        raise ValueError("no free motion")
    reduced = basis.T @ mass @ basis
    of_stiffness = basis.T @ stiffness @ basis
    squares, vectors = la.eigh(0.5 * (of_stiffness + of_stiffness.T), 0.5 * (reduced + reduced.T))
    modes = basis @ vectors
    rates = np.sum(modes * (damping @ modes), axis=0)
    # Values at both ends of each interval of the grid.
    base_force = np.zeros(e.n) if is_start else solver.force(before, q, rest.v)
    base_gap = solver.constraint_levels(before, q, rest.v)[0]
    forces, gaps = np.empty((2, len(times) - 1, e.n)), np.empty((2, len(times) - 1, 3, e.m))
    jumps = set(e.breakpoints)
    for k in range(len(times) - 1):
        branch = 0.5 * (times[k] + times[k + 1])
        for side in (0, 1):
            if side == 0 and k > 0 and times[k] not in jumps:
                forces[0, k], gaps[0, k] = forces[1, k - 1], gaps[1, k - 1]
                continue
            # Both are results of one evaluation.
            time = np.array([times[k + side], branch])
            forces[side, k] = base_force - solver.force(time, q, rest.v)
            gaps[side, k] = solver.constraint_levels(time, q, rest.v)
    gaps[:, :, 0] -= base_gap
    motion = -gaps @ driven.T
    loads = forces @ modes
    for level, matrix in enumerate((stiffness, damping, mass)):
        loads -= motion[:, :, level] @ (matrix.T @ modes)
    amplitudes = _integrate_modes(np.maximum(squares, 0.0), rates, np.diff(times), loads)
    travels = np.concatenate([np.zeros((1, e.m)), gaps[1, :, 0]])
    factors = np.hstack([amplitudes, -travels])
    changes = _observe_changes(e, first, q, np.hstack([modes, driven]), factors, columns)
    return _Response(changes.min(axis=0), changes.max(axis=0))


def _observe_changes(
    equations: EquationsOfMotion,
    time: Array,
    q: Array,
    shapes: Array,
    factors: Array,
    columns: list[str],
) -> Array:
    """Return the changes (k, columns) of columns by motions that are sums of shapes.

    Parameters
    ----------
    equations, time, q
        The equations of motion, (t, branch), and the positions (n,) from which changes count.
    shapes
        Small motions, (n, m).
    factors
        Factors of the shapes, (k, m).
    columns
        Headers of the columns. They change in proportion to the factors, but largest stresses,
        whose derivatives jump, as the section forces require that change in proportion.
    """
    e = equations
    largest = np.max(np.abs(shapes) / e.position_scales[:, None], axis=0)
    sizes = _DIFFERENCE / np.maximum(largest, _TINY)
    steps = (sizes * shapes).T
    states = q + np.concatenate([steps, -steps, np.zeros((1, e.n))])
    still = np.zeros_like(states)
    rows = State(states, still, still, np.zeros((len(states), e.m)))

    def combine(values: Array) -> Array:
        """Return the changes (k, ...) of values at the states (2 m + 1, ...)."""
        differences = values[: len(steps)] - values[len(steps) : -1]
        return np.tensordot(factors / (2.0 * sizes), differences, axes=1)

    values = ObservedRows(e)(np.tile(time, (len(states), 1)), *rows)
    changes = combine(values[:, [e.observed_headers.index(x) for x in columns]])
    for headers, quantity, beam, s in _list_magnitudes(e):
        selected = [k for k, header in enumerate(columns) if header in headers]
        if selected:
            forces = np.moveaxis(elastic_section_forces(beam, e, rows, np.array(s)), 1, 0)
            # At rest, and at the times.
            forces = forces[-1] + np.concatenate([np.zeros_like(forces[:1]), combine(forces)])
            by_section = Beam.values_of_section_forces(quantity, np.moveaxis(forces, 1, 0), s)
            peaks = np.max(by_section[0], axis=1)
            changes[:, selected] = (peaks[1:] - peaks[0])[:, None]
    return changes


def _list_magnitudes(
    equations: EquationsOfMotion,
) -> Iterator[tuple[list[str], Quantity, Beam, tuple[float, ...]]]:
    """Yield headers, quantity, beam and arc lengths [m] of each observed largest stress."""
    assert equations.mechanism is not None
    for name, observed in equations.mechanism.observables.items():
        quantity, _ = measured_quantity(observed)
        sections = Beam.sections_of_strains(quantity)
        if quantity.is_magnitude and sections is not None:
            yield format_headers(name, observed.columns), quantity, *sections


def _integrate_modes(squares: Array, rates: Array, steps: Array, loads: Array) -> Array:
    """Return solutions (k + 1, modes) of x'' + c x' + w^2 x = p at rest at the start.

    Parameters
    ----------
    squares, rates
        w^2 and c, (modes,).
    steps
        Lengths of the steps (k,) [s].
    loads
        p at both ends of each step, (2, k, modes), linear between.
    """
    cache: dict[float, Array] = {}
    state = np.zeros((len(squares), 2))
    solution = np.zeros((len(steps) + 1, len(squares)))
    for k, step in enumerate(steps.tolist()):
        key = float(f"{step:.9g}")
        if key not in cache:
            # Time and velocities relative to the step.
            matrix = np.zeros((len(squares), 4, 4))
            matrix[:, 0, 1] = matrix[:, 1, 2] = matrix[:, 2, 3] = 1.0
            matrix[:, 1, 0], matrix[:, 1, 1] = -squares * step**2, -rates * step
            cache[key] = la.expm(matrix)
        transition = cache[key]
        start, change = loads[0, k] * step**2, (loads[1, k] - loads[0, k]) * step**2
        full = np.stack([state[:, 0], state[:, 1] * step, start, change], axis=1)
        full = np.einsum("mij,mj->mi", transition, full)
        state = np.stack([full[:, 0], full[:, 1] / step], axis=1)
        solution[k + 1] = state[:, 0]
    return solution


def _describe(
    change: _Change, beams: list[Beam], errors: Mapping[str, float], refined: Array
) -> str:
    """Return the warning; `refined` are the errors with halved elements."""
    names = sorted((x for x in errors if errors[x] > _MAX_ERROR), key=lambda x: -errors[x])
    first, *others = map(remove_unit, names)
    largest = errors[names[0]]
    size = format_error(largest, LARGE_ERROR, 1)
    # By extrapolation with the observed order of convergence.
    order = max(math.log2(largest / max(float(np.max(refined)), _TINY)), _MIN_ORDER)
    refinement = min((largest / _RECOMMENDED_ERROR) ** (1.0 / order), _MAX_REFINEMENT)
    count = math.ceil(refinement * max(x.mesh.elements for x in beams))
    remedy = f"use about {count} elements, or a slower law"
    if refinement == _MAX_REFINEMENT:
        remedy = f"use more than {count} elements, or a slower law"
    when = f"rises within {change.rise_time:.2g} s"
    if change.rise_time == 0.0:
        when = f"jumps at t = {change.start:.3g} s"
    return (
        f"{change.part}: this law {when}, faster than waves pass the elements of "
        f"{list_first([x.name for x in beams], _MAX_NAMES)}, and the largest or smallest value of "
        f"{name_with_others(first, others)} is wrong by {size} of half the range; {remedy}."
    )
