"""Warnings about modes that grow, but not in a run: vibrations that it lacks, unstable paths.

The equations, linearized about states of a run, have modes that grow as exp(s t). Steps that do not
resolve such a vibration damp it, and motions that nothing excites do not begin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np

from beamdae import deferred
from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.equations.starts.rank import scaled_null_space
from beamdae.errors import BeamdaeError
from beamdae.model_checks.load_derivatives import RunState, differentiate_loads, read_state
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_MAX_COORDINATES = 300  # of dense eigenvalue problems
# Raised for singular positions, massless points, and values that are not finite
_NOT_LINEARIZED = (BeamdaeError, ValueError)
# Exponents of growth: from an imperfection to a deflection in a run, and in the part of the run in
# which the mode grows.
_GROWTH, _PART_GROWTH = np.log(1e3), 1.0
# Parts of a run, as fractions of it; the last one is that of loads that increase until the end.
_PARTS = ((0.0, 0.25), (0.25, 0.5), (0.5, 0.75), (0.75, 1.0), (0.9375, 1.0))
# States of a part: its end, and multiples of the golden ratio, which are no periods of a load
_FRACTIONS = 1.0 - (np.arange(8) * 0.5 * (np.sqrt(5.0) - 1.0)) % 1.0
_SAMPLES = 1024  # of displacements
# Share of displacements that is a rounding error, and displacements in natural sizes that are none
_EXCITED_SHARE, _ROUNDING = 1e-6, 1e-4
# Velocity in a mode, relative to that of its vibration, of loads that move it slowly
_SLOWNESS = 0.1
_STEPS_PER_PERIOD = 20  # that resolve a vibration
_MIN_LOAD = 1.0  # in EI / L^2; beams buckle from pi^2 / 4 on


def _is_examined(equations: EquationsOfMotion, trajectory: Trajectory) -> bool:
    has_duration = trajectory.end > trajectory.start
    return equations.mechanism is not None and equations.n <= _MAX_COORDINATES and has_duration


def growing_mode_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, largest_force: float
) -> Iterator[str]:
    """Yield a warning if a vibration or motion grows that the run does not contain.

    Such a mode grows at all examined states of a part of the run. Vibrations grow by forces without
    a potential, such as friction that decreases with the speed; growing motions are those of
    compressed beams without sampled controllers, which could hold them.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    largest_force
        Largest entry of the forces and the reactions in the run [N or N m].
    """
    if not _is_examined(equations, trajectory):
        return
    duration, is_pressed = trajectory.end - trajectory.start, _is_pressed(equations, largest_force)
    # Most runs have no growing mode, and are not sampled.
    sample = cache(
        lambda: trajectory.at(np.linspace(trajectory.start, trajectory.end, _SAMPLES))[1]
    )
    for begin, end in _PARTS:
        min_rate = max(_GROWTH / duration, _PART_GROWTH / (duration * (end - begin)))
        times = trajectory.start + duration * (begin + (end - begin) * _FRACTIONS)
        warning = ""
        with np.errstate(all="ignore"), suppress(*_NOT_LINEARIZED):
            warning = _examine_part(equations, trajectory, times, min_rate, is_pressed, sample)
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
    is_pressed: bool,
    sample: Callable[[], State],
) -> str:
    """Return a warning about a mode that grows in all states at `times`, the last one first."""
    warnings: dict[bool, str] = {}
    for k, t in enumerate(times.tolist()):
        at = read_state(equations, trajectory, t)
        loads = differentiate_loads(at)
        if not loads and not (is_pressed and _may_diverge(at, min_rate)):
            return ""
        analysis = deferred.module("analysis.linear_dynamics.growing_modes")
        run = analysis.LinearizedState(at, loads)
        modes = run.find_growing(min_rate)
        missed = _find_missed(at, modes, run.mass, sample()) if len(modes.values) else {}
        if k == 0:
            warnings = {
                is_vibration: _describe_lost(run, modes.values[mode])
                if is_vibration
                else _describe_path(equations, modes, mode, t)
                for is_vibration, mode in missed.items()
                if is_vibration or is_pressed
            }
        warnings = {key: x for key, x in warnings.items() if x and key in missed}
        if not warnings:
            return ""
    return next(iter(warnings.values()))


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


def _find_missed(at: RunState, modes: Any, mass: Any, states: State) -> dict[bool, int]:
    """Return the slowest vibration (True) and a motion (False) in which states have no share.

    If the run contains a growing vibration, this one changes all others.
    """
    displacements = states.q - states.q[0]
    momenta = displacements @ mass.toarray(), states.v @ mass.toarray()
    scales = _ROUNDING * at.equations.position_scales
    largest = np.max(np.sum(momenta[0] * displacements, axis=1), initial=scales @ (mass @ scales))
    missed: dict[bool, int] = {}
    for k in np.argsort(modes.values.imag).tolist():
        shape, speed = modes.motions[:, k], abs(modes.values[k])
        shape = shape / np.sqrt((shape.conj() @ (mass @ shape)).real)
        displacement, velocity = (np.max(np.abs(x @ shape)) for x in momenta)
        is_vibration = bool(modes.values[k].imag > 0.0)
        is_still = displacement <= _EXCITED_SHARE * np.sqrt(largest)
        if is_still or (is_vibration and velocity <= _SLOWNESS * speed * displacement):
            missed.setdefault(is_vibration, k)
        elif is_vibration:
            return {key: x for key, x in missed.items() if not key}
    return missed


def _is_pressed(equations: EquationsOfMotion, largest_force: float) -> bool:
    """Return True if a force may buckle a beam, and no sampled controller can hold it."""
    beams = beams_of(equations.mechanism)
    if not beams or equations.controllers:
        return False
    stiffness = min(float(x.section.at(0.5 * x.length).EI) for x in beams)
    return largest_force * sum(x.length for x in beams) ** 2 > _MIN_LOAD * stiffness


def _describe_lost(run: Any, value: complex) -> str:
    """Return the warning, with a sufficient step; "" if no load is the cause."""
    cause, frequency = run.find_cause(value.real), value.imag / (2.0 * np.pi)
    damping = ", or set damping= of the sections" if beams_of(run.lin.equations.mechanism) else ""
    return cause and (
        f"{cause}: a vibration at {frequency:.3g} Hz grows as exp({value.real:.3g} t), but the "
        "results lack it, because steps damp it or nothing excites it; use "
        f"Radau(max_step={1.0 / (_STEPS_PER_PERIOD * frequency):.1g}) and a small load{damping}."
    )


def _describe_path(equations: EquationsOfMotion, modes: Any, k: int, t: float) -> str:
    largest = int(np.argmax(np.abs(modes.motions[:, k]) / equations.position_scales))
    part = next(x.name for x in equations.parts if x.rows.start <= largest < x.rows.stop)
    return (
        f"{part}: up to t = {t:.4g} s, the run stays on an unstable path, which disturbances would "
        f"leave as exp({modes.values[k].real:.3g} t); add an imperfection (bd.imperfect) or a "
        "small load."
    )
