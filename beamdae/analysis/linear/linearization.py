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

from beamdae.analysis.linear.rest import at_rest
from beamdae.analysis.linear.rotation import Rotation
from beamdae.analysis.linear.steady_rotation import steady
from beamdae.analysis.statics.load_scaling import loading_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State
from beamdae.equations.starts.consistent_start import Starter
from beamdae.equations.starts.given_start import started
from beamdae.equations.starts.reduced_equations import reduced
from beamdae.equations.tangents import Tangent, tangent
from beamdae.errors import BeamdaeError, short_repr
from beamdae.parts.initial_state import AS_DRAWN, EQUILIBRIUM, require_start
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.instant import Instant
from beamdae.simulation import as_equations

Array = np.ndarray

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


def linearization(name: str, model: Any, about: Any = REFERENCE, t: float = 0.0) -> Linearization:
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
        return _on_the_way(as_equations(name, model, AS_DRAWN), about)
    if isinstance(about, Rotation):
        whole = as_equations(name, model, AS_DRAWN)
        own, time = _active(whole, None, t)
        state, found = steady(own, time, about)
        told = f"rotation at {about.speed:g} rad/s about {about.center}"
        return Linearization(own, whole, told, time, state, found, turning=about)
    if isinstance(about, Equilibrium):
        return _on_the_path(name, model, about)
    if isinstance(about, str) and about in (REFERENCE, AS_DRAWN):
        return _at_rest(as_equations(name, model, AS_DRAWN), REFERENCE, t)
    if not (isinstance(about, (str, Mapping))):
        raise BeamdaeError(
            f"about: it must be 'reference', 'equilibrium', positions by name, bd.rotation(...), "
            f"solution.at(t) or what bd.equilibrium gives, got {short_repr(about)}."
        )
    require_start("about", about)
    whole = started(as_equations(name, model, AS_DRAWN), about, t)
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


def _at_rest(whole: EquationsOfMotion, told: str, t: float) -> Linearization:
    """About rest at the start of `whole`, drivers held."""
    own, time = _active(whole, None, t)
    found = at_rest(own, time, lambda state: tangent(own, time, state))
    return Linearization(own, whole, told, time, *found)


def _on_the_path(name: str, model: Any, path: Equilibrium) -> Linearization:
    """About the end of a path of equilibria, under the loads there."""
    whole = path.starting().starting(as_equations(name, model, AS_DRAWN))
    loading = loading_of(model, whole, [list(stage) for stage in path.loads] or None, path.t)
    factors = path.factors[-1].tolist() or [1.0]
    parts = (k for k, factor in enumerate(factors) if abs(factor - 1.0) > _WHOLE)
    stage = next(parts, len(factors) - 1)
    system = loading.systems[stage]
    own, time = replace(system.equations, q0=whole.q0, v0=whole.v0), system.under.time
    found = at_rest(own, time, lambda state: system.tangent_of_motion(state, factors[stage]))
    told = f"equilibrium at load factor {path.factor:g}" if path.loads else EQUILIBRIUM
    return Linearization(own, whole, told, time, *found)
