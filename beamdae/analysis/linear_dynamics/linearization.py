"""Linearization of a mechanism about a state: at rest, in steady rotation or in motion.

    M x'' + C x' + K x + H mu = 0,    J x + V x' = 0

x and mu are increments of the coordinates and the multipliers. H is G^T + dF/dlam, because friction
depends on reactions. Constraints on positions have J = G and V = 0. Constraints on velocities,
A v + b = 0, have J = d(A v + b)/dq, V = A, and A in place of G.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.analysis.eigenproblems.slow_motions import MasslessError
from beamdae.analysis.eigenproblems.turning import find_turning
from beamdae.analysis.statics.load_scaling import active_stage, build_loading
from beamdae.beams.remeshing import resolve_modes
from beamdae.equations.commands import limit_warnings
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import Convert, Tangent, compute_tangent, tangent_of
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.initial_conditions import apply_initial_conditions
from beamdae.equations.starts.reduced_equations import select_independent_constraints
from beamdae.equations.starts.steady_rotation import (
    STIFFNESS_ROUNDING,
    Rotation,
    center_warning,
    find_steady_rotation,
    rotating_tangent,
)
from beamdae.equations.watched_terms import list_arguments_outside
from beamdae.errors import (
    BeamdaeError,
    plain_text,
    short_repr,
    suggest,
)
from beamdae.linear.factorizations import factorize_saddle_point
from beamdae.model_checks.validity_ranges import DAMPING, friction_warnings, strain_warnings
from beamdae.model_functions import Model
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM, Mechanism, require_start
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.start_changes import compare_start, drawing_warnings
from beamdae.results.trajectory import Instant
from beamdae.simulation import as_equations

Array = np.ndarray

_RPM = np.pi / 30.0  # rad/s
TangentFunction = Callable[..., Tangent]

REFERENCE = "reference"
# Net forces above rounding and above this fraction of the largest force mean that the state is not
# an equilibrium.
_UNBALANCED_FORCE_RATIO = 1e-6
# If forces are unbalanced, zero squared frequencies are computed with errors below this fraction of
# the largest acceleration in natural sizes.
_ZERO_SQUARE_RATIO = 1e-6
# Step, in natural sizes, of the finite differences of the mass matrix.
_MASS_DIFFERENCE_STEP = 1e-3
_NO_LIMIT = "linearize about a state with a command between its limits, or omit the limits."


@dataclass(frozen=True)
class Linearization:
    """Mechanism linearized about a state.

    Attributes
    ----------
    equations
        Equations of the active parts with independent constraints.
    full_equations
        Equations of the whole model, with the observables.
    about
        Description of the state.
    time, state
        (t, branch), and the state (q, v, a, lam).
    tangent
        Matrices of the linearized equations.
    warnings
        Warnings that name the coordinate with the largest acceleration if the state is at rest but
        not an equilibrium, that the state is the end of an equilibrium path or a run that ended
        early, that a rotor has its bearing away from the center of rotation, and of commands at
        their limits.
    zero_square
        Squared frequencies up to this magnitude [1/s^2] are treated as zero.
    tangent_at
        Function of a state and a conversion of the equations that returns their matrices, or None
        in motion.
    rotation
        Steady rotation, or None. If set, coordinates refer to the rotating frame.
    companions
        Refined linearizations, which measurements of errors compute once.
    """

    equations: EquationsOfMotion
    full_equations: EquationsOfMotion
    about: str
    time: Array
    state: State
    tangent: Tangent
    warnings: tuple[str, ...] = ()
    zero_square: float = 0.0
    tangent_at: TangentFunction | None = field(default=None, compare=False, repr=False)
    rotation: Rotation | None = None
    companions: dict[frozenset[str], Any] = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def linearized_equations(self) -> LinearizedEquations:
        """Equations for the eigenvalue solvers."""
        has_differences = self.rotation is not None or self.zero_square > 0.0
        lin = LinearizedEquations(self.equations, self.tangent, self.zero_square, has_differences)
        if self.tangent_at is None:
            return lin
        return lin.introduce_forces(self.time, self.state, self.tangent_at)


def model_of_modes(model: Any, about: Any) -> Any:
    """Return a model whose beams resolve modes about a state that is not a result.

    Models that are not mechanisms, or model functions that return them, are not changed.
    """
    if isinstance(model, Model):
        model = model()
    if isinstance(model, Mechanism) and not isinstance(about, (Instant, Equilibrium)):
        model = resolve_modes(model, about)
    return model


def linearize_about(name: str, model: Any, about: Any = REFERENCE, t: float = 0.0) -> Linearization:
    """Linearize a model about a state.

    Parameters
    ----------
    name
        Name of the calling function, for error messages.
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
    about
        See `modes`.
    t
        Time [s] at which laws are evaluated. Ignored if `about` is an instant of a run or an
        `Equilibrium`.

    Returns
    -------
    Linearization
        State, and matrices of the linearized equations.

    Raises
    ------
    BeamdaeError
        If `about` is invalid, no such state exists, or a coordinate has no inertia.
    """
    about, full_equations = plain_text(about), as_equations(name, model, AS_DRAWN)
    if isinstance(about, Instant):
        lin = linearize_motion(full_equations, about)
    elif isinstance(about, Rotation):
        lin = _linearize_rotation(full_equations, about, t)
    else:
        lin = _linearize_rest(name, full_equations, about, t)
    q, v = lin.state[:2]
    # The slope of a table is zero where its value is held.
    outside = list_arguments_outside(lin.equations, lin.time, q[None], v[None], includes_held=True)
    limits = limit_warnings(
        lin.equations,
        lin.time,
        q,
        v,
        f"so the linear model contains no feedback through it; {_NO_LIMIT}",
        f"so the linear model contains half of the feedback through it; {_NO_LIMIT}",
    )
    whole, inactive = lin.full_equations, frozenset[str]()
    if whole.configurations is not None:
        now = about.configuration if isinstance(about, Instant) else None
        inactive = whole.configurations.initially_inactive if now is None else now.inactive
        whole = whole.without_loads_of(inactive)
    warnings = (*lin.equations.build_warnings, *lin.warnings, *outside, *limits)
    if not np.any(v):
        warnings += (*friction_warnings(whole, DAMPING, inactive),)
    return replace(lin, full_equations=whole, warnings=warnings)


def searched_start(name: str, about: Any, accuracy: Any) -> Any:
    """Return the start of refined models that are linearized about a state.

    Raises
    ------
    BeamdaeError
        If an accuracy is required, but the state belongs to a run or path with another mesh.
    """
    if accuracy is not None and isinstance(about, (Equilibrium, Instant)):
        raise BeamdaeError(
            f"{name}: accuracy requires a state that refined models search for, got "
            f"{short_repr(about)}; use 'equilibrium', positions by name or bd.rotation(...)."
        )
    return about if isinstance(about, Mapping) else AS_DRAWN


def _linearize_rotation(
    full_equations: EquationsOfMotion, rotation: Rotation, t: float
) -> Linearization:
    e, time, tangent_at, _ = frame_of(full_equations, rotation, t)
    state, speed = find_steady_rotation(e, time, rotation), rotation.speed
    description = f"rotation at {speed:g} rad/s about {rotation.center}"
    center = center_warning(full_equations, rotation)
    unit = f"speeds are in rad/s ({speed:g} rpm are {speed * _RPM:.4g} rad/s)"
    warnings = (
        *drawing_warnings(e, time),
        *([center] if center else []),
        *strain_warnings(e, state.q[None], unit),
    )
    tangent = tangent_at(state)
    return Linearization(
        e, full_equations, description, time, state, tangent, warnings, 0.0, tangent_at, rotation
    )


def _linearize_rest(
    name: str, full_equations: EquationsOfMotion, about: Any, t: float
) -> Linearization:
    word = about if isinstance(about, str) else ""
    if isinstance(about, Equilibrium):
        end = about.to_checkpoint()
        full_equations = end.start_equations(full_equations)
        if about.numbers is not None:
            full_equations = end.start_equations(about.end_equations)
        description = EQUILIBRIUM
        if about.loads or about.over:
            description = f"{EQUILIBRIUM} at {about.quantity} {about.factor:g}"
    elif isinstance(about, Mapping) or word == EQUILIBRIUM:
        require_start("about", about)
        full_equations = apply_initial_conditions(full_equations, about, t)
        assert full_equations.start is not None
        description = word or f"rest at {full_equations.start.description}"
    elif word in (REFERENCE, AS_DRAWN):
        description = REFERENCE
    else:
        hint = suggest(word, (REFERENCE, EQUILIBRIUM)) if word else ""
        raise BeamdaeError(
            f"{name}: about must be 'reference', 'equilibrium', positions by "
            "name, bd.rotation(...), solution.at(t) or a result of bd.equilibrium, "
            f"got {short_repr(about)}{hint}."
        )
    lin = linearize_at_rest(frame_of(full_equations, about, t), full_equations, description)
    note = ""
    if isinstance(about, Equilibrium):
        note = about.end_warning
    elif t == 0.0:  # Later, drivers have left their positions in the drawing.
        requested = full_equations
        if requested.start is None:
            # Given velocities have no effect on a state at rest.
            requested = replace(requested, v0=np.zeros(requested.n))
        note = compare_start(requested, lin.state).warning
    turning = find_turning(
        lin.equations,
        lin.time,
        lin.state.q,
        lambda: lin.linearized_equations,
        "the linearized state",
        lambda speed: (
            f"use about=bd.rotation({speed:.10g}) for a steady rotation "
            f"(--about rotation={speed:.10g}), or solution.at(t) for another motion"
        ),
    )
    return replace(lin, warnings=(*filter(None, (note,)), *lin.warnings, *turning))


def active_equations(
    full_equations: EquationsOfMotion, instant: Instant | None, t: float
) -> tuple[EquationsOfMotion, Array]:
    """Return the equations of active parts without redundant constraints, and (t, branch)."""
    e = full_equations
    now = None if instant is None else instant.configuration
    if e.configurations is None or now is None:
        active = e.initially_active
    else:
        active = e.configurations.configuration_without(e, now.inactive, now.frozen_gaps).equations
        active = replace(active, q0=e.q0, v0=e.v0)
    time = time_on_branch(active.breakpoints, t) if instant is None else instant.time
    return select_independent_constraints(active, time), time


def linearize_motion(full_equations: EquationsOfMotion, instant: Instant) -> Linearization:
    """Linearize about an instant of a run; position and velocity are frozen."""
    if len(instant.state.q) != full_equations.n:
        raise BeamdaeError(
            f"about: the number of coordinates is {len(instant.state.q)} in the solution but "
            f"{full_equations.n} in this model; pass a solution of this model."
        )
    equations, time = active_equations(full_equations, instant, instant.t)
    state = ConsistencySolver(equations).state(time, instant.state.q, instant.state.v)
    description = f"the frozen motion at t = {instant.t:g} s"
    tangent = compute_tangent(equations, time, state)
    warnings: tuple[str, ...] = ()
    if instant.doubt:
        warnings = (
            "this state may be wrong because it is the end of a failed run "
            f"({instant.doubt}); repeat the run, or select an earlier time.",
        )
    return Linearization(equations, full_equations, description, time, state, tangent, warnings)


class Frame(NamedTuple):
    """Equations about whose states of rest or steady rotation a model is linearized.

    Attributes
    ----------
    equations
        Equations of motion with independent constraints.
    time
        (t, branch), at which laws are evaluated; drivers keep the values of this time.
    tangent_at
        Function of a state and a conversion of the equations that returns their matrices.
    rotation
        Steady rotation in which the state is at rest, or None.
    """

    equations: EquationsOfMotion
    time: Array
    tangent_at: TangentFunction
    rotation: Rotation | None = None


def frame_of(full_equations: EquationsOfMotion, about: Any, t: float) -> Frame:
    """Return the equations of a model for the state `about`, see `modes`."""
    if isinstance(about, Equilibrium):
        model, stage = full_equations.mechanism, active_stage(about.factors[-1])
        loads = None if model is None else [list(names) for names in about.loads]
        loading = build_loading(model or full_equations, full_equations, loads, about.t)
        system, factor = loading.systems[stage], about.factors[-1, stage] if about.loads else 1.0
        equations = replace(system.equations, q0=full_equations.q0, v0=full_equations.v0)
        return Frame(equations, system.loaded.time, partial(system.motion_tangent, factor))
    equations, time = active_equations(full_equations, None, t)
    if isinstance(about, Rotation):
        return Frame(equations, time, partial(rotating_tangent, equations, time, about), about)
    return Frame(equations, time, partial(tangent_of, equations, time))


def linearize_at_rest(frame: Frame, full_equations: EquationsOfMotion, about: str) -> Linearization:
    """Linearize at rest at the start positions of a frame, corrected to close the joints.

    Raises
    ------
    BeamdaeError
        If joints cannot be closed, or the mass matrix is singular or invalid.
    """
    e, time, tangent_at, _ = frame
    ConsistencySolver(e).require_inertia()
    state = _release(e, tangent_at, rest_state(frame))
    rest = state._replace(a=np.zeros(e.n))
    tangent = tangent_at(rest)
    lin = Linearization(e, full_equations, about, time, rest, tangent, tangent_at=tangent_at)
    if not _is_unbalanced(e, tangent, state):
        return lin
    inertial_stiffness = tangent_at(state).stiffness - tangent.stiffness
    change = _covariant_change(e, tangent_at, state, inertial_stiffness)
    tangent_at = partial(_subtract_stiffness, tangent_at, change)
    acceleration = np.abs(state.a) / e.position_scales
    worst = int(np.argmax(acceleration))
    warning = (
        f"{e.q_names[worst]}: the coordinate accelerates at {state.a[worst]:.3g} "
        f"{e.coordinates[worst].unit}/s^2 when released, so this state is not an "
        "equilibrium; use about='equilibrium' or bd.Mechanism(start='equilibrium') unless "
        "the frequencies are meant to follow from the second derivatives of the potential at "
        "this state."
    )
    return replace(
        lin,
        state=state,
        tangent=tangent_at(state),
        warnings=(warning,),
        zero_square=_ZERO_SQUARE_RATIO * float(acceleration[worst]),
        tangent_at=tangent_at,
    )


def rest_state(frame: Frame) -> State:
    """Return the start positions of a frame, corrected to close the joints, at rest."""
    e = frame.equations
    solver = ConsistencySolver(e)
    return solver.rest_state(solver.state(frame.time, e.q0, np.zeros(e.n)).q)


def unbalances(change: Array, frame: Frame) -> bool:
    """Return True if a change of the residual (n + m,) sets a frame at rest in motion."""
    rest = rest_state(frame)
    tangent = frame.tangent_at(rest)._replace(residual=change)
    state = _release(frame.equations, lambda _: tangent, rest)
    return _is_unbalanced(frame.equations, tangent, state)


def _subtract_stiffness(
    tangent_at: TangentFunction, change: sp.csc_array, state: State, convert: Convert | None = None
) -> Tangent:
    tangent = tangent_at(state, convert)
    return tangent._replace(stiffness=sp.csc_array(tangent.stiffness - change))


def solve_for_accelerations(e: EquationsOfMotion, tangent: Tangent) -> Callable[[Array], Array]:
    """Return the map from forces and constraints (n + m,) to accelerations and multipliers.

    First-order states have no inertia; a unit mass is added for each of them.

    Raises
    ------
    BeamdaeError
        If another coordinate has no inertia.
    """
    states = sp.diags_array(np.isin(np.arange(e.n), e.states).astype(float))
    mass, rows = sp.csc_array(tangent.mass + states), tangent.acceleration_jacobian(e)
    solve = factorize_saddle_point(mass, tangent.reactions, rows)
    if solve is None:
        matrix = sp.block_array([[mass, tangent.reactions], [rows, None]]) if e.m else mass
        motion = np.linalg.svd(np.nan_to_num(matrix.toarray()))[2][-1, : e.n]
        raise MasslessError(e.q_names[int(np.argmax(np.abs(motion)))])
    return solve


def _release(e: EquationsOfMotion, tangent_at: TangentFunction, rest: State) -> State:
    """Return the state released from rest: a and lam balance the forces at zero velocity."""
    tangent = tangent_at(rest)
    solve = solve_for_accelerations(e, tangent)
    force = tangent.residual[: e.n].copy()
    force[e.states] = 0.0
    solution = solve(np.concatenate([-force, np.zeros(e.m)]))
    return rest._replace(a=solution[: e.n], lam=solution[e.n :])


def _is_unbalanced(e: EquationsOfMotion, tangent: Tangent, state: State) -> bool:
    """Return True if the state is not an equilibrium.

    That is, an inertial force exceeds both rounding errors and 1e-6 of the largest force. `tangent`
    is that at zero acceleration.
    """
    force = tangent.residual[: e.n]
    inertia = np.abs(tangent.mass @ state.a)
    reactions = np.abs(tangent.reactions @ state.lam)
    largest_force = max(np.max(reactions, initial=0.0), np.max(np.abs(force), initial=0.0))
    # Joints transmit rounding errors of stiff beams to bodies without stiffness, so that the
    # largest one, as the work of a motion by the natural size, applies to all coordinates.
    scales = e.position_scales
    rounding = STIFFNESS_ROUNDING * np.max(scales * (abs(tangent.stiffness) @ scales), initial=0.0)
    is_large = inertia > _UNBALANCED_FORCE_RATIO * largest_force
    return bool(np.any(is_large & (scales * inertia > rounding)))


def _covariant_change(
    e: EquationsOfMotion,
    tangent_at: TangentFunction,
    state: State,
    inertial_stiffness: sp.csc_array,
) -> sp.csc_array:
    """Return the part of the stiffness at rest that depends on the choice of coordinates.

    If a is not zero, the derivative K of F at constant a depends on the choice of coordinates. The
    covariant derivative in the metric of the mass matrix does not:

        K - (N - N^T + dM) / 2,    N = d(M a)/dq at constant a,    dM = dM/dq[a]

    If the forces have a potential V, it is the Hessian of V on the manifold of admissible
    positions. `inertial_stiffness` is N.
    """
    step = _MASS_DIFFERENCE_STEP / float(np.max(np.abs(state.a) / e.position_scales))
    masses = [
        tangent_at(state._replace(q=state.q + k * step * state.a)).mass for k in (-2, -1, 1, 2)
    ]
    # Fourth-order central difference.
    mass_rate = (masses[0] - 8.0 * masses[1] + 8.0 * masses[2] - masses[3]) / (12.0 * step)
    asymmetry = inertial_stiffness - inertial_stiffness.T
    return sp.csc_array(0.5 * (asymmetry + mass_rate))
