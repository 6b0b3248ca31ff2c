"""Initial conditions: positions and velocities by name, static equilibrium or rotation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, Start
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver, velocity_size
from beamdae.equations.starts.dependent_constraints import require_independent_constraints
from beamdae.equations.starts.reduced_equations import select_independent_constraints
from beamdae.equations.starts.relaxation import relax_to_equilibrium
from beamdae.equations.starts.steady_rotation import find_steady_rotation, rotating_state
from beamdae.errors import BeamdaeError, list_first, short_repr, suggest, warn_user
from beamdae.linear.blas_threads import single_threaded
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM, require_start
from beamdae.parts.rotation import Rotation

Array = np.ndarray

_RATE_SUFFIX = "_dot"
_VELOCITY_TOLERANCE = 1e-8  # permitted relative rate of a gap, relative to `velocity_size`
# A speed that differs less from that of the drivers, relative to it, was rounded to six digits.
_MAX_SPEED_ROUNDING = 5e-6


def apply_initial_conditions(
    equations: EquationsOfMotion, start: Any, t: float = 0.0
) -> EquationsOfMotion:
    """Return the equations of motion with other initial conditions.

    Parameters
    ----------
    equations
        Equations of motion that start as drawn.
    start
        "as drawn"; "equilibrium" for rest under the loads at time `t`; a steady `Rotation`; or
        positions and velocities by name ("part.coordinate", "part.coordinate_dot"). Named values
        are imposed; all others change as little as the joints require.
    t
        Start time [s].

    Raises
    ------
    BeamdaeError
        If `start` is invalid or contains an unknown name, the joints or drivers do not allow the
        values, or no equilibrium or steady rotation is found.
    """
    start = require_start("start", start)
    if start == AS_DRAWN:
        return equations
    with single_threaded:
        time = time_on_branch(equations.breakpoints, t)
        # Redundant constraints make the closing problem singular.
        independent = select_independent_constraints(equations.initially_active, time)
        if start == EQUILIBRIUM:
            v = np.zeros(equations.n)
            closed_q = ConsistencySolver(independent).close_positions(time, independent.q0)
            q, _ = relax_to_equilibrium(StaticEquations(independent, time), independent.q0)
            request = Start(EQUILIBRIUM, equations.q0, v, False, closed_q, EQUILIBRIUM)
        elif isinstance(start, Rotation):
            solver = ConsistencySolver(independent)
            # Checked first: about another center or at another speed, no steady state may exist.
            closed_q = solver.state(time, independent.q0, np.zeros(independent.n)).q
            rotation = _require_rotation(solver, time, start, closed_q)
            q, v, *_ = find_steady_rotation(
                independent, time, rotation, closed_q, frozen_forces=True
            )
            _require_rotation(solver, time, rotation, q)
            description = f"rotation at {start.speed:g} rad/s about {start.center}"
            request = Start(description, equations.q0, v, False, closed_q, start)
        else:
            positions, velocities = _split_by_kind(equations, start)
            requested_q, requested_v = np.array(equations.q0), np.array(equations.v0)
            requested_q[list(positions)] = list(positions.values())
            requested_v[list(velocities)] = list(velocities.values())
            solver, prescribed = ConsistencySolver(independent), list(velocities)
            q = solver.close_positions(time, independent.q0, positions)
            require_independent_constraints(solver, time, q)
            # Bodies move rigidly if possible; otherwise, the change has the least kinetic energy.
            rigid_v = solver.rigid_velocities(time, q, requested_v, prescribed)
            v = solver.project_velocities(time, q, rigid_v, prescribed)
            errors = np.concatenate(
                [
                    solver.constraint_levels(time, q, v)[1] / independent.constraint_scales,
                    (v - rigid_v)[prescribed] / independent.position_scales[prescribed],
                ]
            )
            error = np.max(np.abs(errors), initial=0.0)
            if not error <= _VELOCITY_TOLERANCE * velocity_size(independent, rigid_v):
                names = (
                    f"{equations.q_names[k]}{_RATE_SUFFIX} = {x:g}" for k, x in velocities.items()
                )
                raise BeamdaeError(
                    f"start: the joints do not allow {', '.join(names)}; specify fewer or "
                    "different velocities."
                )
            v[prescribed] = requested_v[prescribed]
            description = ", ".join(f"{name} = {value:g}" for name, value in start.items())
            rigid = {k for x in equations.parts for k in range(x.rigid.start, x.rigid.stop)}
            repeated = start if rigid.issuperset((*positions, *velocities)) else None
            request = Start(
                description or AS_DRAWN, requested_q, requested_v, bool(positions), None, repeated
            )
    sentences = equations.build_warnings
    moving = [x.name for x in equations.parts if not x.is_state and np.any(equations.v0[x.rows])]
    if moving and (start == EQUILIBRIUM or isinstance(start, Rotation)):
        sentence = (
            f"start: the given velocity of {list_first(moving)} is not used, because "
            f"the run starts in {request.description}; remove it, or use start= with velocities by "
            "name."
        )
        warn_user(sentence)
        sentences += (sentence,)
    return replace(equations, q0=q, v0=v, start=request, build_warnings=sentences)


def _require_rotation(
    solver: ConsistencySolver, time: Array, rotation: Rotation, q: Array
) -> Rotation:
    """Return a rotation that joints and drivers allow, at their speed if that was rounded."""
    e = solver.equations

    def rates(speed: float) -> Array:
        v = rotating_state(e, Rotation(speed, rotation.center), q, np.zeros(e.m)).v
        return solver.constraint_levels(time, q, v)[1]

    size = velocity_size(e, rotating_state(e, rotation, q, np.zeros(e.m)).v)
    tolerance = _VELOCITY_TOLERANCE * size * e.constraint_scales
    # The rates of the constraints are linear functions of the speed.
    at_rest = rates(0.0)
    slope = rates(1.0) - at_rest
    driven = None
    if np.any(np.abs(slope) > tolerance):
        driven = -float(slope @ at_rest / (slope @ slope))
        if np.any(np.abs(at_rest + driven * slope) > tolerance * max(1.0, abs(driven))):
            driven = None
    if driven and abs(driven - rotation.speed) <= _MAX_SPEED_ROUNDING * abs(driven):
        return replace(rotation, speed=driven)
    errors = np.abs(at_rest + rotation.speed * slope)
    if np.all(errors <= tolerance):
        return rotation
    worst = int(np.argmax(errors / e.constraint_scales))
    remedy = (
        "it turns all parts as one body, about the center of their Revolute; for other mechanisms, "
        "such as slider-cranks, begin at rest with bd.run_up as the law of the driver, or give "
        "velocities by name with start={...}"
    )
    if driven is not None and abs(driven) > _VELOCITY_TOLERANCE * size:
        remedy = f"use the speed of the drivers, {driven:.10g} rad/s"
    raise BeamdaeError(
        f"start: {e.lam_names[worst]} does not allow a rotation at {rotation.speed:.10g} rad/s "
        f"about {rotation.center} (the velocities differ by {errors[worst]:.3g} m/s or "
        f"rad/s); {remedy}."
    )


def _split_by_kind(
    e: EquationsOfMotion, values: Mapping[str, float]
) -> tuple[dict[int, float], ...]:
    """Return prescribed positions and velocities, each by index of the coordinate."""
    index = {name: k for k, name in enumerate(e.q_names)}
    rates = {name + _RATE_SUFFIX: k for name, k in index.items()}
    for name in values:
        if name not in index and name not in rates:
            near = suggest(name, (*index, *rates))
            part = f"{str(name).partition('.')[0]}."
            known = [x for x in index if x.startswith(part)] or list(index)
            raise BeamdaeError(
                f"start: there is no coordinate {short_repr(name)}{near}; "
                f"use names such as {list_first(known)}, or {known[0] + _RATE_SUFFIX} for a rate."
            )
    positions = {index[name]: value for name, value in values.items() if name in index}
    velocities = {rates[x]: value for x, value in values.items() if x in rates and x not in index}
    return positions, velocities
