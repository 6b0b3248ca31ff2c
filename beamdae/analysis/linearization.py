"""A mechanism linearized about a state: as drawn, at rest, turning steadily, or on its way.

    M x'' + C x' + K x + H mu = 0,    J x + V x' = 0

with x what is added to the coordinates and mu to the multipliers. Constraints on positions have
V = 0, H = G^T + dF/dlam (friction follows reactions), J = G; those on velocities, A v + b = 0, have
V = A and J = d(A v + b)/dq.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.rotation import Rotation
from beamdae.analysis.saddle import saddle
from beamdae.analysis.steady import steady
from beamdae.equations.consistent_start import Starter
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State
from beamdae.equations.given_start import started
from beamdae.equations.reduced import reduced
from beamdae.equations.tangents import Tangent, tangent
from beamdae.errors import BeamdaeError, shown
from beamdae.parts.starts import AS_DRAWN, EQUILIBRIUM, require_start
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.instant import Instant
from beamdae.simulation import as_equations

Array = np.ndarray

REFERENCE = "reference"
# Forces that do not balance, beside those there are, and beside what rounding leaves of stiffness.
_UNBALANCED, _ROUNDING = 1e-6, 1e-13
# Beside accelerations where forces do not balance: what elements leave of a frequency that is zero.
_STILL = 1e-6
# What Newton's method leaves of a load factor of one.
_WHOLE = 1e-9
# Of the natural sizes of coordinates: the step over which the mass matrix is differentiated.
_STEP = 1e-3


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
    turning
        How it turns, if it does: coordinates are then those of an observer who turns as well.
    warnings
        What the result has to be read with.
    still
        Squares of frequencies [1/s^2] up to this are zero.
    """

    equations: EquationsOfMotion
    whole: EquationsOfMotion
    about: str
    time: Array
    state: State
    tangent: Tangent
    turning: Rotation | None = None
    warnings: tuple[str, ...] = ()
    still: float = 0.0

    @property
    def nonholonomic(self) -> Array:
        """Which constraints hold velocities alone, as truth values."""
        found = np.zeros(self.equations.m, bool)
        found[self.equations.nonholonomic_rows] = True
        return found


def linearization(model: Any, about: Any = REFERENCE, t: float = 0.0) -> Linearization:
    """Linearize a model.

    Parameters
    ----------
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
    name = "about"
    if isinstance(about, Instant):
        return _on_the_way(as_equations(model, AS_DRAWN), about)
    if isinstance(about, Rotation):
        whole = as_equations(model, AS_DRAWN)
        own, time = _active(whole, None, t)
        state, found = steady(own, time, about)
        told = f"rotation at {about.speed:g} rad/s about {about.center}"
        return Linearization(own, whole, told, time, state, found, about)
    if isinstance(about, Equilibrium):
        return _at_rest(_resting(as_equations(model, AS_DRAWN), about), EQUILIBRIUM, about.t)
    if isinstance(about, str) and about in (REFERENCE, AS_DRAWN):
        return _at_rest(as_equations(model, AS_DRAWN), REFERENCE, t)
    if not (isinstance(about, (str, Mapping))):
        raise BeamdaeError(
            f"{name}: it must be 'reference', 'equilibrium', positions by name, an Equilibrium, "
            f"bd.rotation(...) or solution.at(t), got {shown(about)}."
        )
    require_start(name, about)
    whole = started(as_equations(model, AS_DRAWN), about, t)
    told = EQUILIBRIUM if about == EQUILIBRIUM else f"rest at {whole.start.told}"  # type: ignore[union-attr]
    return _at_rest(whole, told, t)


def _active(
    whole: EquationsOfMotion, instant: Instant | None, t: float
) -> tuple[EquationsOfMotion, Array]:
    """The active parts without dependent constraints, and (t, branch)."""
    own = whole
    known = whole.configurations
    if known is not None:
        now = None if instant is None else instant.configuration
        own = (known.of(whole, now.inactive, now.found) if now else known.begin(whole)).equations
    own = replace(own, q0=whole.q0, v0=whole.v0)
    after = min((b for b in own.breakpoints if b > t), default=t + 1.0)
    time = np.array([t, 0.5 * (t + after)]) if instant is None else instant.time
    spared = reduced(own, time) if own.redundant else None
    return (own if spared is None else spared.equations), time


def _on_the_way(whole: EquationsOfMotion, instant: Instant) -> Linearization:
    if len(instant.state.q) != whole.n:
        raise BeamdaeError("about: the solution is not one of this model.")
    own, time = _active(whole, instant, instant.t)
    state = Starter(own).state(time, instant.state.q, instant.state.v)
    told = f"the motion at t = {instant.t:g} s, as if it stayed there"
    return Linearization(own, whole, told, time, state, tangent(own, time, state))


def _resting(whole: EquationsOfMotion, found: Equilibrium) -> EquationsOfMotion:
    """The equations with the end of a path as their start."""
    factors = found.factors[-1]
    off = np.abs(factors - 1.0)
    if np.max(off, initial=0.0) > _WHOLE:
        raise BeamdaeError(
            f"about: this equilibrium is one at the load factor {factors[np.argmax(off)]:.6g}, a "
            "model moves under the whole of its loads; state them as large as they are there."
        )
    return found.starting().starting(whole)


def _at_rest(whole: EquationsOfMotion, told: str, t: float) -> Linearization:
    """About rest at the start of `whole`, with the reactions there, drivers held."""
    own, time = _active(whole, None, t)
    starter = Starter(own)
    starter.require_inertia()
    q = starter.state(time, own.q0, np.zeros(own.n)).q
    state = _released(own, time, q)
    found = tangent(own, time, state)
    force = tangent(own, time, state._replace(a=np.zeros(own.n))).residual[: own.n]
    if not _is_unbalanced(own, found, state, force):
        state = state._replace(a=np.zeros(own.n))
        return Linearization(own, whole, told, time, state, tangent(own, time, state))
    found = found._replace(stiffness=_covariant(own, time, state, found))
    share = np.abs(state.a) / own.position_scales
    worst = int(np.argmax(share))
    sentence = (
        f"{own.q_names[worst]}: it accelerates by {state.a[worst]:.3g} where it is let go, this "
        "state is no equilibrium; frequencies are those of the second derivatives of the potential "
        "there, about='equilibrium' finds where it rests."
    )
    still = _STILL * float(share[worst])
    return Linearization(own, whole, told, time, state, found, None, (sentence,), still)


def _released(e: EquationsOfMotion, time: Array, q: Array) -> State:
    """Accelerations and reactions at rest: M a + F + G^T lam = 0, J a = 0."""
    rest = Starter(e).at_rest(q)
    found = tangent(e, time, rest)
    solve = saddle(found.mass, found.reactions, found.held_accelerations(e))
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


def _covariant(e: EquationsOfMotion, time: Array, state: State, found: Tangent) -> sp.csc_array:
    """The stiffness that does not depend on the coordinates, at rest but not in equilibrium.

    The derivative of F at constant a depends on the coordinates it is taken in, as long as a is not
    zero. The covariant one in the metric of the mass matrix does not:

        K - (N - N^T + dM) / 2,    N = d(M a)/dq at constant a,    dM = dM/dq[a]

    of a potential V it is the Hessian of V on the manifold of the positions joints allow.
    """
    still = tangent(e, time, state._replace(a=np.zeros(e.n)))
    by_inertia = found.stiffness - still.stiffness
    step = _STEP / float(np.max(np.abs(state.a) / e.position_scales))
    masses = [
        tangent(e, time, state._replace(q=state.q + k * step * state.a)).mass
        for k in (-2, -1, 1, 2)
    ]
    changed = (masses[0] - 8.0 * masses[1] + 8.0 * masses[2] - masses[3]) / (12.0 * step)
    return sp.csc_array(found.stiffness - 0.5 * (by_inertia - by_inertia.T + changed))
