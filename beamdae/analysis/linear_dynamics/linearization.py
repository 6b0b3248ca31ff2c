"""A mechanism linearized about a state: as drawn, at rest, turning steadily, or on its way.

    M x'' + C x' + K x + H mu = 0,    J x + V x' = 0

with x what is added to the coordinates and mu to the multipliers. Constraints on positions have
V = 0, H = G^T + dF/dlam (friction follows reactions), J = G; those on velocities, A v + b = 0, have
V = A and J = d(A v + b)/dq.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.linear_dynamics.steady_rotation import Rotation, find_steady_rotation
from beamdae.analysis.statics.load_scaling import build_loading
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import Tangent, compute_tangent
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.initial_conditions import apply_initial_conditions
from beamdae.equations.starts.reduced_equations import remove_redundant_constraints
from beamdae.errors import BeamdaeError, short_repr
from beamdae.linear.saddle_point import factorize_saddle_point
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM, require_start
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.trajectory import Instant
from beamdae.simulation import as_equations

Array = np.ndarray
TangentAt = Callable[[State], Tangent]

# Forces that do not balance, beside those there are, and beside what rounding leaves of stiffness.
_UNBALANCED, _ROUNDING = 1e-6, 1e-13
# Beside accelerations where forces do not balance: what elements leave of a frequency that is zero.
_STILL = 1e-6
# Of the natural sizes of coordinates: the step over which the mass matrix is differentiated.
_STEP = 1e-3


def linearize_at_rest(
    e: EquationsOfMotion, time: Array, tangent: TangentAt
) -> tuple[State, Tangent, tuple[str, ...], float]:
    """State, matrices, warnings, and squares of frequencies [1/s^2] up to which they are zero.

    At the start of `e`, with the reactions there, drivers held; `tangent` is that of `e`, or under
    a share of its loads.
    """
    starter = ConsistencySolver(e)
    starter.require_inertia()
    state = _release(e, tangent, starter.rest_state(starter.state(time, e.q0, np.zeros(e.n)).q))
    found, rest = tangent(state), state._replace(a=np.zeros(e.n))
    if not _is_unbalanced(e, found, state, tangent(rest).residual[: e.n]):
        return rest, tangent(rest), (), 0.0
    found = found._replace(stiffness=_covariant_stiffness(e, tangent, state, found))
    share = np.abs(state.a) / e.position_scales
    worst = int(np.argmax(share))
    sentence = (
        f"{e.q_names[worst]}: it accelerates by {state.a[worst]:.3g} where it is let go, this "
        "state is no equilibrium; frequencies are those of the second derivatives of the potential "
        "there, about='equilibrium' finds where it rests."
    )
    return state, found, (sentence,), _STILL * float(share[worst])


def _release(e: EquationsOfMotion, tangent: TangentAt, rest: State) -> State:
    """Accelerations and reactions at rest: M a + F + G^T lam = 0, J a = 0."""
    found = tangent(rest)
    solve = factorize_saddle_point(found.mass, found.reactions, found.acceleration_jacobian(e))
    if solve is None:
        raise BeamdaeError("modes: something can move without inertia, give it a mass or a joint.")
    solved = solve(np.concatenate([-found.residual[: e.n], np.zeros(e.m)]))
    return rest._replace(a=solved[: e.n], lam=solved[e.n :])


def _is_unbalanced(e: EquationsOfMotion, found: Tangent, state: State, force: Array) -> bool:
    """Whether the accelerations are more than what rounding leaves of an equilibrium.

    `force` is F + G^T lam without inertia.
    """
    needed = np.abs(found.mass @ state.a)
    reactions = np.abs(found.reactions @ state.lam)
    there = max(np.max(reactions, initial=0.0), np.max(np.abs(force), initial=0.0))
    rounding = _ROUNDING * (abs(found.stiffness) @ e.position_scales)
    return bool(np.any(needed > np.maximum(_UNBALANCED * there, rounding)))


def _covariant_stiffness(
    e: EquationsOfMotion, tangent: TangentAt, state: State, found: Tangent
) -> sp.csc_array:
    """The stiffness that does not depend on the coordinates, at rest but not in equilibrium.

    The derivative of F at constant a depends on the coordinates it is taken in, as long as a is not
    zero. The covariant one in the metric of the mass matrix does not:

        K - (N - N^T + dM) / 2,    N = d(M a)/dq at constant a,    dM = dM/dq[a]

    of a potential V it is the Hessian of V on the manifold of the positions joints allow.
    """
    still = tangent(state._replace(a=np.zeros(e.n)))
    by_inertia = found.stiffness - still.stiffness
    step = _STEP / float(np.max(np.abs(state.a) / e.position_scales))
    masses = [tangent(state._replace(q=state.q + k * step * state.a)).mass for k in (-2, -1, 1, 2)]
    changed = (masses[0] - 8.0 * masses[1] + 8.0 * masses[2] - masses[3]) / (12.0 * step)
    return sp.csc_array(found.stiffness - 0.5 * (by_inertia - by_inertia.T + changed))


REFERENCE = "reference"
# What Newton's method leaves of a load factor of one.
_WHOLE = 1e-9


@dataclass(frozen=True)
class Linearization:
    """A mechanism linearized about a state.

    Attributes
    ----------
    equations
        Of its active parts and independent constraints.
    whole
        Of all of it, with what is observed.
    about
        The state in words.
    time, state
        (t, branch), and coordinates, velocities, accelerations and multipliers there.
    tangent
        The matrices.
    warnings
        What the result has to be read with.
    still
        Squares of frequencies [1/s^2] up to this are zero.
    turning
        How it turns, if it does: coordinates are then those of an observer who turns as well.
    """

    equations: EquationsOfMotion
    whole: EquationsOfMotion
    about: str
    time: Array
    state: State
    tangent: Tangent
    warnings: tuple[str, ...] = ()
    still: float = 0.0
    turning: Rotation | None = None

    @property
    def nonholonomic(self) -> Array:
        """Which constraints hold velocities alone, as truth values."""
        found = np.zeros(self.equations.m, bool)
        found[self.equations.nonholonomic_rows] = True
        return found


def linearize_about(name: str, model: Any, about: Any = REFERENCE, t: float = 0.0) -> Linearization:
    """Linearize a model.

    Parameters
    ----------
    name
        What was given the model, in errors.
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
    about
        See `modes`.
    t
        Time [s] at which laws are read, of states at rest and of rotations.

    Raises
    ------
    BeamdaeError
        If there is no such state.
    """
    if isinstance(about, Instant):
        return _linearize_motion(as_equations(name, model, AS_DRAWN), about)
    if isinstance(about, Rotation):
        whole = as_equations(name, model, AS_DRAWN)
        own, time = _active_equations(whole, None, t)
        state, found = find_steady_rotation(own, time, about)
        told = f"rotation at {about.speed:g} rad/s about {about.center}"
        return Linearization(own, whole, told, time, state, found, turning=about)
    if isinstance(about, Equilibrium):
        return _linearize_path_end(name, model, about)
    if isinstance(about, str) and about in (REFERENCE, AS_DRAWN):
        return _linearize_rest(as_equations(name, model, AS_DRAWN), REFERENCE, t)
    if not (isinstance(about, (str, Mapping))):
        raise BeamdaeError(
            f"about: it must be 'reference', 'equilibrium', positions by name, bd.rotation(...), "
            f"solution.at(t) or what bd.equilibrium gives, got {short_repr(about)}."
        )
    require_start("about", about)
    whole = apply_initial_conditions(as_equations(name, model, AS_DRAWN), about, t)
    told = EQUILIBRIUM if about == EQUILIBRIUM else f"rest at {whole.start.told}"  # type: ignore[union-attr]
    return _linearize_rest(whole, told, t)


def _active_equations(
    whole: EquationsOfMotion, instant: Instant | None, t: float
) -> tuple[EquationsOfMotion, Array]:
    """The active parts without dependent constraints, and (t, branch)."""
    own = whole
    known = whole.configurations
    if known is not None:
        now = None if instant is None else instant.configuration
        own = (
            known.configuration_without(whole, now.inactive, now.frozen_gaps)
            if now
            else known.initial_configuration(whole)
        ).equations
    own = replace(own, q0=whole.q0, v0=whole.v0)
    after = min((b for b in own.breakpoints if b > t), default=t + 1.0)
    time = np.array([t, 0.5 * (t + after)]) if instant is None else instant.time
    spared = remove_redundant_constraints(own, time) if own.redundant else None
    return (own if spared is None else spared.equations), time


def _linearize_motion(whole: EquationsOfMotion, instant: Instant) -> Linearization:
    if len(instant.state.q) != whole.n:
        raise BeamdaeError("about: the solution is not one of this model.")
    own, time = _active_equations(whole, instant, instant.t)
    state = ConsistencySolver(own).state(time, instant.state.q, instant.state.v)
    told = f"the motion at t = {instant.t:g} s, as if it stayed there"
    return Linearization(own, whole, told, time, state, compute_tangent(own, time, state))


def _linearize_rest(whole: EquationsOfMotion, told: str, t: float) -> Linearization:
    """About rest at the start of `whole`, drivers held."""
    own, time = _active_equations(whole, None, t)
    found = linearize_at_rest(own, time, lambda state: compute_tangent(own, time, state))
    return Linearization(own, whole, told, time, *found)


def _linearize_path_end(name: str, model: Any, path: Equilibrium) -> Linearization:
    """About the end of a path of equilibria, under the loads there."""
    whole = path.starting().starting(as_equations(name, model, AS_DRAWN))
    loading = build_loading(model, whole, [list(stage) for stage in path.loads] or None, path.t)
    factors = path.factors[-1].tolist() or [1.0]
    parts = (k for k, factor in enumerate(factors) if abs(factor - 1.0) > _WHOLE)
    stage = next(parts, len(factors) - 1)
    system = loading.systems[stage]
    own, time = replace(system.equations, q0=whole.q0, v0=whole.v0), system.under.time
    found = linearize_at_rest(
        own, time, lambda state: system.tangent_of_motion(state, factors[stage])
    )
    told = f"equilibrium at load factor {path.factor:g}" if path.loads else EQUILIBRIUM
    return Linearization(own, whole, told, time, *found)
