"""Which loads of a mechanism a factor scales, and its static equations under such a factor."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.first_order import State
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.formulations.tangents import Tangent, compute_tangent
from beamdae.equations.starts.initial_conditions import time_on_branch
from beamdae.equations.starts.reduced_equations import Reduced, reduced
from beamdae.errors import BeamdaeError, require_sequence, short_repr, suggest
from beamdae.parts.initial_state import AS_DRAWN
from beamdae.parts.mechanism import Mechanism
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray
Stages = tuple[tuple[str, ...], ...]

GRAVITY = "gravity"
_LOADS_DESCRIPTION = "names of loads (or 'gravity'), or lists of such names, one a stage"


def resolve_load_stages(mechanism: Mechanism, loads: Any) -> Stages:
    """Names of the loads that are brought up together, one stage after the other.

    Raises
    ------
    BeamdaeError
        If a name is unknown, comes twice, or is that of a part that does more than push.
    """
    if loads is None:
        active = [x for x in mechanism.parts.values() if x.name not in mechanism.inactive]
        found = tuple(part.name for part in active if part.is_load)
        if _is_heavy(mechanism):
            found = (*found, GRAVITY)
        return (found,) if found else ()
    given = require_sequence("equilibrium", "loads", loads, _LOADS_DESCRIPTION)
    if all(isinstance(name, str) for name in given):
        given = [given] if given else []
    stages = tuple(
        tuple(require_sequence("equilibrium", "loads", stage, _LOADS_DESCRIPTION))
        for stage in given
    )
    names = [name for stage in stages for name in stage]
    for name in names:
        _require_load(mechanism, name)
        if names.count(name) > 1:
            raise BeamdaeError(f"equilibrium: loads must name {short_repr(name)} once.")
    if not all(stages):
        raise BeamdaeError("equilibrium: loads must not hold a stage without loads.")
    return stages


def _is_heavy(mechanism: Mechanism) -> bool:
    return mechanism.gravity_laws is not None or bool(np.any(mechanism.gravity))


def _require_load(mechanism: Mechanism, name: Any) -> None:
    if not isinstance(name, str):
        raise BeamdaeError(
            f"equilibrium: loads must be {_LOADS_DESCRIPTION}, got {short_repr(name)}."
        )
    if name == GRAVITY and _is_heavy(mechanism):
        return
    if name == GRAVITY and name not in mechanism.parts:
        raise BeamdaeError("equilibrium: loads name 'gravity', of which the mechanism has none.")
    if name not in mechanism.parts:
        known = (*mechanism.parts, GRAVITY)
        raise BeamdaeError(f"equilibrium: loads, no part {short_repr(name)}{suggest(name, known)}.")
    part = mechanism.parts[name]
    if len(part.coordinates) or part.constraints():
        raise BeamdaeError(
            f"equilibrium: loads must name parts that state forces alone, {name} is a "
            f"{type(part).__name__}."
        )


@dataclass(frozen=True)
class LoadedEquations:
    """Static equations under a load factor mu: (1 - mu) of those without a load, mu of those with.

    Unknowns are x = (q, lam).

    Attributes
    ----------
    without, under
        The static equations without the loads that mu scales and with all of them. The same where
        nothing is scaled.
    """

    without: StaticEquations
    under: StaticEquations

    @property
    def equations(self) -> EquationsOfMotion:
        """The equations of motion under the whole load."""
        return self.under.equations

    @property
    def is_scaled(self) -> bool:
        """Whether there is a load to scale."""
        return self.without is not self.under

    @cached_property
    def _where(self) -> tuple[sp.csc_array, Array, Array]:
        """Pattern of the tangent, and where in it are the entries of both."""
        one, other = self.without.pattern, self.under.pattern
        both = sp.csc_array(one + other)
        both.sort_indices()
        size = one.shape[0]
        keys = column_indices(both).astype(np.int64) * size + both.indices
        where = [
            np.searchsorted(keys, column_indices(x).astype(np.int64) * size + x.indices)
            for x in (one, other)
        ]
        return both, where[0], where[1]

    @property
    def pattern(self) -> sp.csc_array:
        """CSC pattern of the tangent."""
        return self._where[0]

    def residual(self, x: Array, mu: float) -> tuple[Array, Array]:
        """The residual (n + m,) and its derivative by mu."""
        n = self.equations.n
        under = self.under.residual(x[:n], x[n:])
        if not self.is_scaled:
            return under, np.zeros_like(under)
        without = self.without.residual(x[:n], x[n:])
        # Where a load is small to a large factor what it does not change is left as it is.
        change = under - without
        return without + mu * change, change

    def tangent(self, x: Array, mu: float) -> Array:
        """Non-zeros of the derivative of the residual by x on `pattern`."""
        n = self.equations.n
        both, at_without, at_under = self._where
        found = np.zeros(both.nnz)
        found[at_under] = self.under.tangent(x[:n], x[n:])
        if self.is_scaled:
            without = np.zeros(both.nnz)
            without[at_without] = self.without.tangent(x[:n], x[n:])
            found = without + mu * (found - without)
        return found

    def tangent_of_motion(self, state: State, mu: float) -> Tangent:
        """The matrices of the equations of motion under the factor."""
        under = compute_tangent(self.equations, self.under.time, state)
        if not self.is_scaled:
            return under
        without = compute_tangent(self.without.equations, self.without.time, state)
        shares = {
            name: (1.0 - mu) * getattr(without, name) + mu * getattr(under, name)
            for name in ("damping", "stiffness", "reactions", "residual")
        }
        return under._replace(**shares)

    def matrix(self, nonzeros: Array) -> sp.csc_array:
        """The tangent of these non-zeros."""
        own = (nonzeros, self.pattern.indices, self.pattern.indptr)
        return sp.csc_array(own, shape=self.pattern.shape)

    def at(self, mu: float) -> FixedFactorEquations:
        """The static equations under a factor that stays."""
        return FixedFactorEquations(self, mu)


@dataclass(frozen=True)
class FixedFactorEquations:
    """Static equations under a load factor that stays, see `equations.relaxation`."""

    system: LoadedEquations
    mu: float

    @property
    def equations(self) -> EquationsOfMotion:
        """The equations of motion, whose inertia they share."""
        return self.system.equations

    @property
    def time(self) -> Array:
        """(t, branch)."""
        return self.system.under.time

    def residual(self, q: Array, lam: Array) -> Array:
        """(F + G^T lam, g)."""
        return self.system.residual(np.append(q, lam), self.mu)[0]

    def matrix(self, q: Array, lam: Array) -> sp.csc_array:
        """Its tangent."""
        return self.system.matrix(self.system.tangent(np.append(q, lam), self.mu))


@dataclass(frozen=True)
class Loading:
    """A mechanism whose loads are brought up in stages.

    Attributes
    ----------
    whole
        Equations of all parts, with what is observed.
    stages
        Names of the loads of each, none where nothing is scaled.
    systems
        The static equations of each stage; one where nothing is scaled.
    held
        Which multipliers of the whole those of the stages are.
    spared
        What was left out of constraints that follow from others, if anything.
    """

    whole: EquationsOfMotion
    stages: Stages
    systems: tuple[LoadedEquations, ...]
    held: Array
    spared: Reduced | None

    def reactions(self, q: Array, lam: Array) -> Array:
        """Multipliers of all constraints, of rows of positions and of those of the stages."""
        if self.spared is not None:
            times = np.tile(self.systems[0].under.time, (len(q), 1))
            return self.spared.reactions(times, q, lam)
        found = np.zeros((len(lam), self.whole.m))
        found[:, self.held] = lam
        return found


def build_loading(model: Any, whole: EquationsOfMotion, loads: Any, t: float) -> Loading:
    """The equations of every stage of loading; `model` is a mechanism, or what has no parts."""
    time = time_on_branch(whole, t)
    if not isinstance(model, Mechanism):
        if loads is not None:
            raise BeamdaeError(
                "equilibrium: loads can be named of a Mechanism only, what is stated by "
                "expressions is under its loads as they are."
            )
        stages: Stages = ()
        models = [whole]
    else:
        stages = resolve_load_stages(model, loads)
        scaled = [set().union(*stages[k:]) for k in range(len(stages) + 1)]
        models = [equations_of_motion(_remove_loads(model, names)) for names in scaled]
    spared = reduced(models[-1], time) if whole.redundant else None
    if spared is not None:
        models = [_remove_redundant(each, time) for each in models]
    static = [StaticEquations(each, time) for each in models]
    pairs = pairwise(static) if stages else [(static[0], static[0])]
    systems = tuple(LoadedEquations(*pair) for pair in pairs)
    rows = {name: k for k, name in enumerate(whole.lam_names)}
    held = np.array([rows[name] for name in models[-1].lam_names], int)
    return Loading(whole, stages, systems, held, spared)


def _remove_redundant(equations: EquationsOfMotion, time: Array) -> EquationsOfMotion:
    found = reduced(equations, time)
    return equations if found is None else found.equations


def _remove_loads(mechanism: Mechanism, names: set[str]) -> Mechanism:
    """The mechanism without some loads, and without what is inactive at the start of a run."""
    rest = copy(mechanism)
    away = names | mechanism.inactive
    rest.parts = {name: part for name, part in rest.parts.items() if name not in away}
    rest.observables, rest.events, rest.inactive, rest.start = {}, [], set(), AS_DRAWN
    if GRAVITY in names:
        rest.gravity, rest.gravity_laws = np.zeros(2), None
    return rest
