"""Warnings about modes that grow: unstable loops, vibrations that a run lacks, unstable paths.

The equations, linearized about states of a run, have modes that grow as exp(s t). In the run, such
a mode is an unstable loop, is damped by steps that do not resolve it, or is excited by nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from beamdae import deferred
from beamdae.beams.beam import beams_of
from beamdae.equations.commands import compile_commands
from beamdae.equations.controller_reads import evaluate_reads
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.equations.starts.rank import scaled_null_space
from beamdae.errors import BeamdaeError
from beamdae.model_checks.load_derivatives import RunState, differentiate_loads, read_state
from beamdae.results.rest import is_motionless
from beamdae.results.trajectory import Trajectory

Array = np.ndarray
Amplify = Callable[[Array], Array]

_MAX_COORDINATES = 300  # of dense eigenvalue problems
# Raised for singular positions, massless points, and values that are not finite
_NOT_LINEARIZED = (BeamdaeError, ValueError)
# Exponents of growth: that of a loop in a run, which a plot shows, that from an imperfection to a
# deflection in a run, and that in the part of the run in which the mode grows.
_LOOP_GROWTH, _GROWTH, _PART_GROWTH = np.log(5.0), np.log(1e3), 1.0
# Parts of a run, as fractions of it; the last one is that of loads that increase until the end.
_PARTS = ((0.0, 0.25), (0.25, 0.5), (0.5, 0.75), (0.75, 1.0), (0.9375, 1.0))
# States of a part: its end, and multiples of the golden ratio, which are no periods of a load
_FRACTIONS = 1.0 - (np.arange(8) * 0.5 * (np.sqrt(5.0) - 1.0)) % 1.0
_SAMPLES = 1024  # of signals of loops, and of displacements
# Range in the last quarter of the run, relative to the whole run, of signals that do not settle
_MIN_LAST_RANGE = 0.3
# Growth by the steps relative to that of the mode: of modes that are damped, and that are resolved
_MAX_DAMPED, _MIN_RESOLVED = 0.5, 0.9
_ROUNDING = 1e-9  # of ranges of signals
_EXCITED_SHARE = 1e-6  # of displacements that are rounding errors
_MIN_LOAD = 1.0  # in EI / L^2; beams buckle from pi^2 / 4 on


def unstable_loop_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning if signals of a control loop do not settle, and a mode of the loop grows."""
    warning = ""
    if _is_examined(equations, trajectory) and not is_motionless(equations, trajectory):
        with np.errstate(all="ignore"), suppress(*_NOT_LINEARIZED):
            warning = _describe_unstable_loop(equations, trajectory)
    if warning:
        yield warning


def _is_examined(equations: EquationsOfMotion, trajectory: Trajectory) -> bool:
    has_duration = trajectory.end > trajectory.start
    return equations.mechanism is not None and equations.n <= _MAX_COORDINATES and has_duration


def _describe_unstable_loop(equations: EquationsOfMotion, trajectory: Trajectory) -> str:
    loads = {
        part.name
        for part, _, forces in equations.statements
        if any(x.signal.rows for force in forces for x in force.signals)
    }
    if not (loads or equations.controllers):
        return ""
    growths = {name: _find_growth(x) for name, x in _list_signals(equations, trajectory)}
    name = max(growths, key=growths.__getitem__, default="")
    if not growths.get(name) or (at := _find_state_within_limits(equations, trajectory)) is None:
        return ""
    analysis = deferred.module("analysis.linear_dynamics.growing_modes")
    min_rate = _LOOP_GROWTH / (trajectory.end - trajectory.start)
    value = analysis.find_loop_mode(at, trajectory, loads, min_rate)
    if value is None:
        return ""
    vibration = f" with {value.imag / (2.0 * np.pi):.3g} Hz" if value.imag else ""
    return (
        f"{name} does not settle, because its loop is unstable: a mode grows as "
        f"exp({value.real:.3g} t){vibration}; check the signs and sizes of its gains, and delays."
    )


def _list_signals(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[tuple[str, Array]]:
    """Yield names, and values (k, n) at `_SAMPLES` times, of commands and states of loops."""
    at = trajectory.at(np.linspace(trajectory.start, trajectory.end, _SAMPLES))
    for command in compile_commands(equations):
        values = command.evaluate(*at)
        values[:, 0] = np.clip(values[:, 0], command.low, command.high)
        yield command.name, values
    for term in equations.controllers:
        drives = term.controller.drives
        held = at[1].q[:, term.rows][:, : len(drives)]
        name = f"{term.controller.name}: {drives[0].name}"
        yield name, np.hstack([held, evaluate_reads(term, equations.p, *at)])
    sampled = {x.controller.name for x in equations.controllers}
    for part in equations.parts:
        if part.is_state and part.name not in sampled:
            yield part.name, at[1].q[:, part.rows]


def _find_growth(values: Array) -> float:
    """Return the largest ratio of ranges of the last and the first quarter; 0 if all settle."""
    whole = np.ptp(values, axis=0)
    first, last = (
        np.ptp(x, axis=0) for x in (values[: _SAMPLES // 4], values[3 * _SAMPLES // 4 :])
    )
    moves_on = (whole > 0.0) & (last > _MIN_LAST_RANGE * whole)
    return float(
        np.max(last[moves_on] / np.maximum(first, _ROUNDING * whole)[moves_on], initial=0.0)
    )


def _find_state_within_limits(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> RunState | None:
    """Return the first state, at rest or moving, with commands between their limits, or None."""
    times = np.unique(np.concatenate([x.t for x in trajectory.intervals]))
    at, state = trajectory.at(times)
    for share in (0.0, 1.0):
        moving = state._replace(v=share * state.v)
        is_within = np.ones(len(times), bool)
        for command in compile_commands(equations):
            values = command.evaluate(at, moving)[:, 0]
            is_within &= (values > command.low) & (values < command.high)
        if is_within.any():
            found = read_state(equations, trajectory, float(times[np.argmax(is_within)]))
            q, v, a, lam = found.state
            return found._replace(state=State(q, share * v, share * a, lam))
    return None


def growing_mode_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    integrator: Mapping[str, Any],
    largest_force: float,
) -> Iterator[str]:
    """Yield a warning if steps damp a growing vibration, or nothing excites a growing motion.

    Such a mode grows at all examined states of a part of the run. Vibrations grow by forces without
    a potential, such as friction that decreases with the speed; growing motions are those of
    compressed beams without sampled controllers, which could hold them.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    integrator
        Settings of the run.
    largest_force
        Largest entry of the forces and the reactions in the run [N or N m].
    """
    if not _is_examined(equations, trajectory):
        return
    duration = trajectory.end - trajectory.start
    amplify, is_pressed = _select_amplification(integrator), _is_pressed(equations, largest_force)
    for begin, end in _PARTS:
        min_rate = max(_GROWTH / duration, _PART_GROWTH / (duration * (end - begin)))
        times = trajectory.start + duration * (begin + (end - begin) * _FRACTIONS)
        warning = ""
        with np.errstate(all="ignore"), suppress(*_NOT_LINEARIZED):
            warning = _examine_part(equations, trajectory, times, min_rate, amplify, is_pressed)
        if warning:
            yield warning
            return


def unstable_start_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning if the equilibrium in which a run starts is unstable.

    Equilibria that sampled controllers may hold are not examined.
    """
    if equations.controllers or not _is_examined(equations, trajectory):
        return
    values, at = np.zeros(0), read_state(equations, trajectory, trajectory.start)
    min_rate = _GROWTH / (trajectory.end - trajectory.start)
    analysis = deferred.module("analysis.linear_dynamics.growing_modes")
    with suppress(*_NOT_LINEARIZED):
        values = analysis.LinearizedState(at, {}).find_growing(min_rate).values
    if len(values):
        yield (
            "start: the equilibrium is unstable, and the smallest disturbance leaves it as "
            f"exp({np.max(values.real):.3g} t); start from other positions, or add an imperfection "
            "(bd.imperfect) or a small load."
        )


def _examine_part(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    times: Array,
    min_rate: float,
    amplify: Amplify | None,
    is_pressed: bool,
) -> str:
    """Return a warning about a mode that grows in all states at `times`, the last one first."""
    lost = path = ""
    displacements: Array | None = None
    for k, t in enumerate(times.tolist()):
        at = read_state(equations, trajectory, t)
        loads = differentiate_loads(at)
        if not loads and not (is_pressed and _may_diverge(at, min_rate)):
            return ""
        analysis = deferred.module("analysis.linear_dynamics.growing_modes")
        run, step = analysis.LinearizedState(at, loads), _find_step(trajectory, t)
        modes = run.find_growing(min_rate)
        vibration = _find_damped(modes.values, step, amplify) if amplify else None
        if is_pressed and displacements is None:
            q = trajectory.positions_at(np.linspace(trajectory.start, times[0], _SAMPLES))
            displacements = q - q[0]
        still = None if displacements is None else _find_still(modes, run.mass, displacements)
        if k == 0:
            lost = "" if vibration is None else _describe_lost(run, vibration, step)
            path = "" if still is None else _describe_path(equations, modes, still, t)
        lost = "" if vibration is None else lost
        path = "" if still is None else path
        if not (lost or path):
            return ""
    return lost or path


def _may_diverge(at: RunState, rate: float) -> bool:
    """Return True if motions of forces with a potential may grow faster than a rate [1/s]."""
    e, tangent = at.equations, compute_tangent(at.equations, at.time, at.state)
    basis = scaled_null_space(tangent.acceleration_jacobian(e), e.position_scales)
    total = tangent.stiffness + rate * tangent.damping + rate**2 * tangent.mass
    projected = basis.T @ (total @ basis)
    try:
        np.linalg.cholesky(projected + projected.T)
    except np.linalg.LinAlgError:
        return True
    return False


def _find_damped(values: Array, step: float, amplify: Amplify) -> complex | None:
    """Return the eigenvalue of the slowest vibration if steps [s] damp all of them, or None."""
    vibrations = values[values.imag > 0.0]
    if not (step > 0.0 and len(vibrations)):
        return None
    growth = np.log(np.abs(amplify(vibrations * step)))
    if np.any(growth > _MAX_DAMPED * vibrations.real * step):
        # A resolved vibration that grows changes the motion, and with it all other modes.
        return None
    return complex(vibrations[np.argmin(vibrations.imag)])


def _find_still(modes: Any, mass: Any, displacements: Array) -> int | None:
    """Return the index of a growing motion in which displacements have no share, or None."""
    (directions,) = np.nonzero(modes.values.imag == 0.0)
    if not len(directions):
        return None
    momentum = displacements @ mass.toarray()
    size = np.sqrt(np.max(np.sum(momentum * displacements, axis=1)))
    for k in directions.tolist():
        motion = modes.motions[:, k].real
        share = np.max(np.abs(momentum @ motion)) / np.sqrt(motion @ (mass @ motion))
        if share <= _EXCITED_SHARE * size:
            return int(k)
    return None


def _find_step(trajectory: Trajectory, t: float) -> float:
    """Return the length of the step that ends at or after a time [s]."""
    index = int(trajectory.interval_index(np.array([t]))[0])
    ends = np.unique(trajectory.intervals[index].grid.t)
    k = int(np.clip(np.searchsorted(ends, t), 1, len(ends) - 1))
    return float(ends[k] - ends[k - 1])


def _is_pressed(equations: EquationsOfMotion, largest_force: float) -> bool:
    """Return True if a force may buckle a beam, and no sampled controller can hold it."""
    beams = beams_of(equations.mechanism)
    if not beams or equations.controllers:
        return False
    stiffness = min(float(x.section.at(0.5 * x.length).EI) for x in beams)
    return largest_force * sum(x.length for x in beams) ** 2 > _MIN_LOAD * stiffness


def _describe_lost(run: Any, value: complex, step: float) -> str:
    """Return the warning, with a sufficient step of `Radau`; "" if no load is the cause."""
    cause, max_step = run.find_cause(value.real), np.array([step])
    while np.log(abs(_amplify_by_radau(value * max_step))) < _MIN_RESOLVED * value.real * max_step:
        max_step *= 0.5
    damping = ", or set damping= of the sections" if beams_of(run.lin.equations.mechanism) else ""
    return cause and (
        f"{cause}: a vibration at {value.imag / (2.0 * np.pi):.3g} Hz grows as "
        f"exp({value.real:.3g} t), but steps of {step:.2g} s damp it, so the results lack it; use "
        f"Radau(max_step={max_step[0]:.1g}){damping}."
    )


def _describe_path(equations: EquationsOfMotion, modes: Any, k: int, t: float) -> str:
    largest = int(np.argmax(np.abs(modes.motions[:, k]) / equations.position_scales))
    part = next(x.name for x in equations.parts if x.rows.start <= largest < x.rows.stop)
    return (
        f"{part}: up to t = {t:.4g} s, the run stays on an unstable path, which disturbances would "
        f"leave as exp({modes.values[k].real:.3g} t); add an imperfection (bd.imperfect) or a "
        "small load."
    )


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
    step = [predicted_x + beta * acceleration, predicted_v + gamma * acceleration, acceleration]
    return np.max(np.abs(np.linalg.eigvals(np.stack(step, axis=1))), axis=1)
