"""Warnings about vibrations that grow in the model, but that the steps of a method damp.

Forces without a potential let vibrations grow: friction that decreases with the speed, follower
forces, controllers, and formulas with negative damping. A mode with the eigenvalue s of the
equations linearized about a state of the run grows as exp(Re(s) t), but a step h multiplies it by
R(s h), which is near zero if the step does not resolve the vibration. The run then remains smooth,
so that the control of the steps does not notice the error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import groupby, pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae import deferred
from beamdae.beams.beam import beams_of
from beamdae.equations.assembly.building import select_input_laws
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.sums import term_data
from beamdae.equations.friction_sliding import SlidingTerm, compile_sliding
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.rank import scaled_null_space
from beamdae.errors import BeamdaeError
from beamdae.results.trajectory import Interval, Trajectory
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.kernel_groups import group_by_kernel
from beamdae.symbolic.sparse_operators import build_selection

Array = np.ndarray
Amplify = Callable[[Array], Array]

# Exponent of the growth in the model: a factor of 5e8 makes rounding errors visible.
# In wipers with falling friction (4 to 16 elements), squeal that steps damp has 46 to 290.
_MIN_GROWTH = 20.0
# Exponent of the growth by the steps, relative to that in the model: of runs with a warning, and
# with the recommended step.
_MAX_RATIO, _RECOMMENDED_RATIO = 0.5, 0.9
# Exponent of the growth of a slower mode that steps resolve, from which on the run contains its
# vibration. The equations linearized about single states then do not describe further modes: in
# wipers whose steps resolve the lowest axial mode (exponent 9), forces change by less than 8 % with
# steps that resolve more modes.
_MAX_RESOLVED_GROWTH = 5.0
# Smallest share of the growth rate that the power of forces without a potential explains. Modes of
# mechanisms that move also grow at instants at which their inertia decreases.
_MIN_POWER_SHARE = 0.5
# Modes that are examined: phase |s| h of the slowest one, and their number
_MIN_PHASE, _MAX_MODES = 0.01, 40
_MAX_COORDINATES = 500  # of dense eigenvalue problems
_MAX_ROWS, _ROWS_AT_ONCE = 1000, 256  # steps of an interval at which loads are differentiated
_MAX_STRETCHES, _SAMPLES = 2, 8  # of each part, and states of each stretch
_MAX_FREQUENCY_RATIO = 1.25  # of the same mode at two states
_GROUPS_PER_E = 20.0  # groups of steps whose lengths differ by a factor of e
_MAX_HALVINGS = 16  # of steps, in the search for a sufficient one
# Sliding speed / regularization velocity from which on friction is 99.9 % of its full value
_MIN_SLIDING_RATIO = 3.8
_SKEW_SHARE = 1e-3  # weight of circulatory forces in the choice of states beside negative damping
_MAX_SHIFTS, _SHIFT_RATIO = 20, 10.0  # of the spectrum, until the shifted stiffness is positive
_INERTIA_TOLERANCE = 1e-14
# Of stiffness, damping and mass in the saddle-point matrix
_UNIT_COEFFICIENTS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_ROUNDING = 1e-9
_TINY = 1e-300  # prevents logarithms of zero


class _Load(NamedTuple):
    """One copy of a force without inertia.

    Attributes
    ----------
    part
        Name of the part.
    kernel
        Kernel of the force.
    columns
        Indices (k,) of the global coordinates on which the force depends.
    to_local
        Map (size, k) from these coordinates to the local ones.
    numbers
        Numbers of the copy.
    multipliers
        Indices of the multipliers on which the force depends.
    """

    part: str
    kernel: ForceKernel
    columns: Array
    to_local: Array
    numbers: Array
    multipliers: Array

    def differentiate(self, times: Array, state: State) -> tuple[Array, Array]:
        """Return dF/dq and dF/dv (rows, k, k) at rows of (t, branch) and of states."""
        local = (x[:, self.columns] @ self.to_local.T for x in (state.q, state.v))
        size, lam = len(self.to_local), state.lam[:, self.multipliers]
        values = self.kernel.motion_derivatives(times, *local, lam, self.numbers)
        by_motion = np.swapaxes(values.reshape(len(times), 2, size, size), 2, 3)
        stiffness, damping = np.moveaxis(self.to_local.T @ by_motion @ self.to_local, 1, 0)
        return stiffness, damping

    def growth_rates(self, time: Array, state: State, values: Array, motions: Array) -> Array:
        """Return the contributions to the growth rates of modes, times twice their energy / |s|^2.

        `motions` (n, k) are the modes with the eigenvalues s = `values` (k,). Symmetric stiffness
        supplies no power.
        """
        at = time[None], State(*(x[None] for x in state))
        stiffness, damping = (x[0] for x in self.differentiate(*at))
        x = motions[self.columns]
        forces = 0.5 * (stiffness - stiffness.T) @ x + values * (damping @ x)
        return -0.5 * np.sum((values * x).conj() * forces, axis=0).real / np.abs(values) ** 2


class _Linearized(NamedTuple):
    """Derivatives of the forces, and constraints, at a state; without the stiffness of reactions.

    Attributes
    ----------
    stiffness, damping, mass
        dF/dq, dF/dv and dF/da, (n, n) each; the mass of first-order states is one.
    jacobian
        Gradients of the constraints, (m, n).
    friction
        dF/dlam, (n, m).
    """

    stiffness: sp.csr_array
    damping: sp.csr_array
    mass: sp.csr_array
    jacobian: sp.csc_array
    friction: sp.csr_array


class _Stretch(NamedTuple):
    """Consecutive steps in which a part may supply energy to vibrations.

    `loads` are the forces of the part, `rows` are the steps of the interval, and `supply` weights
    them.
    """

    part: str
    loads: tuple[_Load, ...]
    interval: Interval
    rows: Array
    supply: Array


class _Steps(NamedTuple):
    """Lengths of groups of steps (k,) [s] and numbers of their steps (k,)."""

    lengths: Array
    counts: Array


class _Suppressed(NamedTuple):
    """Mode that grows because of a part.

    Attributes
    ----------
    part
        Name of the part that supplies the energy.
    value
        Eigenvalue at one state [1/s].
    begin, end
        Times between which the mode grows [s].
    values, steps
        Eigenvalues [1/s], and the steps for which they are constant.
    """

    part: str
    value: complex
    begin: float
    end: float
    values: tuple[complex, ...]
    steps: tuple[_Steps, ...]

    @property
    def growth(self) -> float:
        """Exponent of the growth in the model."""
        pairs = zip(self.values, self.steps, strict=True)
        return sum(x.real * float(steps.lengths @ steps.counts) for x, steps in pairs)

    def growth_by_steps(self, amplify: Amplify, max_step: float = np.inf) -> float:
        """Return the exponent of the growth with steps of at most `max_step` [s]."""
        total = 0.0
        for value, steps in zip(self.values, self.steps, strict=True):
            lengths = np.minimum(steps.lengths, max_step)
            exponents = np.log(np.maximum(np.abs(amplify(value * lengths)), _TINY))
            total += float(steps.counts * steps.lengths / lengths @ exponents)
        return total


def suppressed_growth_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, integrator: Mapping[str, Any]
) -> Iterator[str]:
    """Yield one warning per part that lets vibrations grow which the steps of the run damp.

    Equations of a `ConstrainedSystem`, and those with more than 500 coordinates, are not examined.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    integrator
        Settings of the run.
    """
    amplify = _select_amplification(integrator)
    if amplify is None or equations.mechanism is None or equations.n > _MAX_COORDINATES:
        return
    stretches: dict[str, list[_Stretch]] = {}
    for interval in trajectory.intervals:
        if len(interval.t) > 1:
            for stretch in _list_stretches(equations, interval):
                stretches.setdefault(stretch.part, []).append(stretch)
    for of_part in stretches.values():
        order = sorted(of_part, key=lambda x: -float(np.sum(x.supply)))
        for stretch in order[:_MAX_STRETCHES]:
            try:
                mode = _examine(equations, stretch, amplify)
            except (BeamdaeError, np.linalg.LinAlgError):
                continue  # singular positions have their own warnings
            if mode is not None:
                yield _describe(mode, amplify, bool(beams_of(equations.mechanism)))
                break


def _select_amplification(integrator: Mapping[str, Any]) -> Amplify | None:
    """Return the factor by which a step multiplies a mode, a function of s h; None if unknown."""
    method = integrator.get("method", integrator.get("integrator"))
    if method == "Radau":
        return _amplify_by_radau
    if method == "Ida":
        return partial(_amplify_by_bdf, max_order=integrator["max_order"])
    if method == "GeneralizedAlpha":
        family = deferred.module("integrators.alpha.family")
        parameters = family.family_parameters(integrator["family"], integrator["rho_inf"])
        return partial(_amplify_by_alpha, parameters=parameters)
    return None


def _amplify_by_radau(z: Array) -> Array:
    """Return the factor of a step of Radau IIA with three stages, (3, 2)-Pade of exp(z)."""
    return (1.0 + 0.4 * z + z**2 / 20.0) / (1.0 - 0.6 * z + 0.15 * z**2 - z**3 / 60.0)


def _amplify_by_bdf(z: Array, max_order: int) -> Array:
    """Return the largest factor of a step of BDF of orders up to `max_order`."""
    factors = np.zeros(len(z))
    for order in range(1, max_order + 1):
        # sum((1 - 1/r)^j / j) = z for the factor r
        series = np.polynomial.Polynomial([0.0, *(1.0 / np.arange(1, order + 1))])
        in_inverse = series(np.polynomial.Polynomial([1.0, -1.0])).coef.astype(complex)
        for k, value in enumerate(z):
            roots = np.polynomial.polynomial.polyroots(in_inverse - value * np.eye(order + 1)[0])
            factors[k] = max(factors[k], 1.0 / np.min(np.abs(roots)))
    return factors


def _amplify_by_alpha(z: Array, parameters: Sequence[float]) -> Array:
    """Return the spectral radius of a step of the generalized-alpha family, see `AlphaParameters`.

    The vector is (x, h v, h^2 a) of an oscillator x'' = 2 Re(s) x' - |s|^2 x.
    """
    alpha_m, alpha_f, gamma, beta, _ = parameters
    of_v, of_x = 2.0 * z.real, -(np.abs(z) ** 2)
    one, zero = np.ones(len(z)), np.zeros(len(z))
    predicted_x = np.stack([one, one, (0.5 - beta) * one], axis=1)
    predicted_v = np.stack([zero, one, (1.0 - gamma) * one], axis=1)
    force = (1.0 - alpha_f) * (of_v[:, None] * predicted_v + of_x[:, None] * predicted_x)
    force += np.stack([alpha_f * of_x, alpha_f * of_v, -alpha_m * one], axis=1)
    divisor = 1.0 - alpha_m - (1.0 - alpha_f) * (of_v * gamma + of_x * beta)
    acceleration = force / divisor[:, None]
    step = np.stack(
        [
            predicted_x + beta * acceleration,
            predicted_v + gamma * acceleration,
            acceleration,
        ],
        axis=1,
    )
    return np.max(np.abs(np.linalg.eigvals(step)), axis=1)


def _list_loads(e: EquationsOfMotion) -> Iterator[_Load]:
    """Yield the forces without inertia that act on the motion."""
    assert e.mechanism is not None
    laws = select_input_laws(e.mechanism.inputs)
    states = {x.name for x in e.parts if x.is_state}
    forces = [x.with_laws(laws) for part in e.statements for x in part.forces]
    for group, term in zip(group_by_kernel(forces), e.structure.forces, strict=True):
        if term.rotation is not None or term.kernel.has_accelerations:
            continue
        size, numbers = term.kernel.local.size, term_data(e, term)
        selected = np.zeros(0, int) if term.rows is None else term.rows.indices
        multipliers = selected.reshape(term.count, -1)
        names = [forces[k].part for k in group.members for _ in range(forces[k].count)]
        for k, name in enumerate(names):
            operator = term.operator[k * size : (k + 1) * size]
            columns = np.unique(operator.indices)
            if name not in states and len(columns):
                to_local = operator[:, columns].toarray()
                yield _Load(name, term.kernel, columns, to_local, numbers[:, k], multipliers[k])


def _list_stretches(equations: EquationsOfMotion, interval: Interval) -> Iterator[_Stretch]:
    """Yield the steps of an interval in which parts may supply energy to vibrations."""
    active = interval.active_equations(equations)
    rows = np.arange(0, len(interval.t), len(interval.t) // _MAX_ROWS + 1)
    times, state = _select_states(interval, rows)
    supplies: dict[str, Array] = {}
    loads: dict[str, list[_Load]] = {}
    for load in _list_loads(active):
        supply = np.concatenate(
            [
                _measure_supply(active, load, times[block], State(*(x[block] for x in state)))
                for block in (
                    slice(k, k + _ROWS_AT_ONCE) for k in range(0, len(rows), _ROWS_AT_ONCE)
                )
            ]
        )
        if supply.any():
            supplies[load.part] = np.maximum(supply, supplies.get(load.part, 0.0))
            loads.setdefault(load.part, []).append(load)
    if not supplies:
        return
    sliding = {x.name: x for x in compile_sliding(equations) if x.name in supplies}
    duration = np.gradient(interval.t[rows]) if len(rows) > 1 else np.zeros(len(rows))
    for part, supply in supplies.items():
        direction = np.sign(supply)
        if part in sliding:
            all_parts = State(*(x[rows] for x in interval.state))
            direction *= _find_direction(sliding[part], times, all_parts)
        for label, members in groupby(range(len(rows)), direction.__getitem__):
            places = list(members)
            if label and len(places) > 1:
                of_part = tuple(loads[part])
                yield _Stretch(part, of_part, interval, rows[places], (supply * duration)[places])


def _select_states(interval: Interval, rows: Array) -> tuple[Array, State]:
    """Return rows of (t, branch), and the states with the active multipliers, at steps."""
    state = State(*(x[rows] for x in interval.state))
    if interval.configuration is not None:
        state = state._replace(lam=interval.configuration.select_multipliers(state.lam))
    return interval.times[:: interval.nodes_per_step][rows], state


def _find_direction(term: SlidingTerm, times: Array, state: State) -> Array:
    """Return the sign of the sliding velocity; 0 if a part sticks, or has no normal force."""
    slip, force = term.evaluate_with_forces(times, state)
    is_sliding = (force > term.law.min_force) & (np.abs(slip) > _MIN_SLIDING_RATIO * term.law.speed)
    return np.where(is_sliding, np.sign(slip), 0.0)


def _measure_supply(e: EquationsOfMotion, load: _Load, times: Array, state: State) -> Array:
    """Return a measure (rows,) of the power that a load can supply to vibrations; 0 for none."""
    stiffness, damping = load.differentiate(times, state)
    scales = e.position_scales[load.columns]
    stiffness, damping = (scales[:, None] * x * scales for x in (stiffness, damping))
    is_finite = np.isfinite(stiffness).all(axis=(1, 2)) & np.isfinite(damping).all(axis=(1, 2))
    stiffness[~is_finite], damping[~is_finite] = 0.0, 0.0
    largest = np.max(np.abs(stiffness), axis=(1, 2)), np.max(np.abs(damping), axis=(1, 2))
    skew = np.max(np.abs(stiffness - np.swapaxes(stiffness, 1, 2)), axis=(1, 2))
    least = -np.linalg.eigvalsh(damping + np.swapaxes(damping, 1, 2))[:, 0]
    supply = np.where(least > _ROUNDING * largest[1], least, 0.0)
    if supply.any():
        return supply + _SKEW_SHARE * np.max(supply) * (skew > _ROUNDING * largest[0])
    return np.where(skew > _ROUNDING * largest[0], skew, 0.0)


def _examine(
    equations: EquationsOfMotion, stretch: _Stretch, amplify: Amplify
) -> _Suppressed | None:
    """Return the slowest mode that grows in a stretch, but not with its steps; None without one.

    The result is also None if the steps resolve a slower mode that grows: the motion is then not
    smooth, and friction limits the growth of all modes.
    """
    interval, rows = stretch.interval, stretch.rows
    begin, end = interval.t[rows[0]], interval.t[rows[-1]]
    active = interval.active_equations(equations)
    cumulative = np.cumsum(stretch.supply) / np.sum(stretch.supply)
    shares = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    places = np.unique(np.minimum(np.searchsorted(cumulative, shares), len(rows) - 1))
    edges = [begin, *interval.t[rows[(places[1:] + places[:-1]) // 2]], end]
    steps = [_group_steps(interval, *x) for x in pairwise(edges)]
    slowest = _MIN_PHASE / max(float(np.max(x.lengths, initial=0.0)) for x in steps)
    middle = len(places) // 2
    order = [middle, *(k for k in range(len(places)) if k != middle)]
    modes: dict[int, tuple[complex, ...]] = {}
    for k in order:
        modes[k] = _find_growing(active, stretch, int(rows[places[k]]), slowest)
        fastest = max((x.real for x in modes[k]), default=0.0)
        if k == middle and fastest * (end - begin) < _MIN_GROWTH:
            return None
    resolved = 0.0
    for value in sorted(modes[middle], key=lambda x: x.imag):
        mode = _follow(stretch.part, value, edges, steps, modes)
        if mode.growth_by_steps(amplify) >= _MAX_RATIO * mode.growth:
            resolved = max(resolved, mode.growth)
        elif mode.growth > _MIN_GROWTH:
            return mode if resolved < _MAX_RESOLVED_GROWTH else None
    return None


def _follow(
    part: str,
    value: complex,
    edges: Sequence[float],
    steps: Sequence[_Steps],
    modes: Mapping[int, Sequence[complex]],
) -> _Suppressed:
    """Return the mode with this eigenvalue at one state, as far as it grows at others."""
    places = []
    for k, here in modes.items():
        ratios = [max(x.imag / value.imag, value.imag / x.imag) for x in here]
        if ratios and min(ratios) < _MAX_FREQUENCY_RATIO:
            places.append((k, here[int(np.argmin(ratios))]))
    return _Suppressed(
        part,
        value,
        min(edges[k] for k, _ in places),
        max(edges[k + 1] for k, _ in places),
        tuple(x for _, x in places),
        tuple(steps[k] for k, _ in places),
    )


def _group_steps(interval: Interval, begin: float, end: float) -> _Steps:
    """Return the steps of an interval between two times [s], grouped by their lengths."""
    times = interval.grid.t
    inside = times[(times > begin) & (times < end)]
    lengths = np.diff(np.concatenate([[begin], inside, [end]]))
    lengths = lengths[lengths > 0.0]
    groups = np.round(_GROUPS_PER_E * np.log(lengths))
    _, places, counts = np.unique(groups, return_inverse=True, return_counts=True)
    return _Steps(np.bincount(places, lengths) / counts, counts)


def _find_growing(
    e: EquationsOfMotion, stretch: _Stretch, row: int, slowest: float
) -> tuple[complex, ...]:
    """Return the eigenvalues [1/s] of the modes at a step that grow because of the part."""
    times, states_at = _select_states(stretch.interval, np.array([row]))
    time, state = times[0], State(*(x[0] for x in states_at))
    linearized = _linearize(e, time, state)
    shapes, reactions = _find_basis(e, linearized, slowest)
    if not shapes.size:
        return ()
    count, states = shapes.shape[1], np.asarray(e.states, int)
    to_states = np.eye(e.n)[:, states]
    by_motion = np.hstack(
        [
            linearized.stiffness @ shapes + linearized.friction @ reactions,
            linearized.damping @ shapes,
            linearized.stiffness @ to_states,
        ]
    )
    mass = shapes.T @ (linearized.mass @ shapes)
    matrix = np.zeros((2 * count + len(states),) * 2)
    matrix[:count, count : 2 * count] = np.eye(count)
    matrix[count : 2 * count] = -la.solve(mass, shapes.T @ by_motion)
    matrix[2 * count :] = -by_motion[states]
    values, vectors = la.eig(matrix)
    is_growing = (values.real > 0.0) & (values.imag > values.real)
    values, vectors = values[is_growing], vectors[:, is_growing]
    motions = shapes @ vectors[:count] + to_states @ vectors[2 * count :]
    kinetic = np.sum(vectors[:count].conj() * (mass @ vectors[:count]), axis=0).real
    rates = np.zeros(len(values))
    for load in stretch.loads:
        rates += load.growth_rates(time, state, values, motions) / kinetic
    is_caused = rates > _MIN_POWER_SHARE * values.real
    return tuple(values[is_caused].tolist())


def _linearize(e: EquationsOfMotion, time: Array, state: State) -> _Linearized:
    """Return the matrices at a state, as those of the start, whose kernels are compiled already."""
    solver = ConsistencySolver(e)
    pattern, matrices = solver.sums.saddle_pattern, []
    for coefficients in _UNIT_COEFFICIENTS:
        values = solver.saddle_matrix(time, *state[:3], coefficients, state.lam)
        matrices.append(
            sp.csr_array((values, pattern.indices, pattern.indptr), pattern.shape[::-1])
        )
    stiffness, damping, mass = (x.T[: e.n, : e.n] for x in matrices)
    jacobian = solver.constraint_matrix(time, state.q)
    friction = matrices[0].T[: e.n, e.n :] - jacobian.T
    return _Linearized(stiffness, damping, mass, jacobian, friction)


def _find_basis(
    e: EquationsOfMotion, linearized: _Linearized, slowest: float
) -> tuple[Array, Array]:
    """Return shapes (n, k) of the slowest undamped modes above an angular frequency [rad/s].

    The second result are the multipliers (m, k) of their vibrations. If loads make the symmetric
    part of the stiffness indefinite, the modes are those of a stiffer mechanism.

    Raises
    ------
    numpy.linalg.LinAlgError
        If matrices are not finite, or all motions have no inertia.
    """
    jacobian = linearized.jacobian
    fixed = sp.vstack([jacobian, build_selection(list(e.states), e.n)])
    basis = scaled_null_space(sp.csc_array(fixed), e.position_scales)
    mass, stiffness = (
        0.5 * basis.T @ ((x + x.T) @ basis) for x in (linearized.mass, linearized.stiffness)
    )
    if not (np.isfinite(mass).all() and np.isfinite(stiffness).all()):
        raise np.linalg.LinAlgError
    shift = slowest**2
    for _ in range(_MAX_SHIFTS):
        with suppress(np.linalg.LinAlgError):
            inverses, vectors = la.eigh(mass, stiffness + shift * mass)
            break
        shift *= _SHIFT_RATIO
    else:
        raise np.linalg.LinAlgError
    # Coordinates without inertia have the eigenvalue 0 of the inverse problem.
    has_inertia = inverses > _INERTIA_TOLERANCE * np.max(inverses, initial=0.0)
    squares = 1.0 / np.where(has_inertia, inverses, 1.0) - shift
    is_fast = has_inertia & ((squares > slowest**2) | (shift > slowest**2))
    (order,) = np.nonzero(is_fast)
    order = order[::-1][:_MAX_MODES]
    shapes = basis @ (vectors[:, order] / np.sqrt(inverses[order]))
    reactions = np.zeros((e.m, len(order)))
    if len(order) and any(x.rows is not None for x in e.forces):
        loads = linearized.mass @ shapes * squares[order] - linearized.stiffness @ shapes
        reactions = la.lstsq(jacobian.toarray().T, loads)[0]
    return shapes, reactions


def _describe(x: _Suppressed, amplify: Amplify, has_beams: bool) -> str:
    """Return the warning, with a step of `Radau` that is sufficient."""
    step = max_step = float(max(np.max(y.lengths) for y in x.steps))
    for _ in range(_MAX_HALVINGS):
        max_step *= 0.5
        if x.growth_by_steps(_amplify_by_radau, max_step) > _RECOMMENDED_RATIO * x.growth:
            break
    remedy = f"max_step={max_step:.1g}"
    if amplify is not _amplify_by_radau:
        remedy = f"Radau({remedy})"
    if has_beams:
        remedy += ", or set damping= of the sections"
    return (
        f"{x.part}: it lets a vibration at {x.value.imag / (2.0 * np.pi):.3g} Hz grow as "
        f"exp({x.value.real:.3g} t) from t = {x.begin:.4g} to {x.end:.4g} s, but steps of up to "
        f"{step:.2g} s damp it, so that the results lack this vibration; use {remedy}."
    )
