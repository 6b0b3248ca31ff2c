"""Proportional loading: load stages of a mechanism, and static equations with a load factor."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.statics.path_parameters import PathParameter, VariedEquations
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.assembly.building import remove_forces
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.formulations.tangents import Convert, Tangent, tangent_of
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.reduced_equations import (
    ReducedEquations,
    remove_redundant_constraints,
)
from beamdae.errors import BeamdaeError, require_sequence, short_repr, suggest
from beamdae.parts.mechanism import AS_DRAWN, Mechanism
from beamdae.results.section_forces.applied_loads import GRAVITY

Array = np.ndarray
Stages = tuple[tuple[str, ...], ...]

# Load factors that differ from one by less than this are treated as one, because Newton's method
# does not reach one exactly.
_FACTOR_TOLERANCE = 1e-9
_LOADS_DESCRIPTION = "names of loads (or 'gravity'), or lists of such names, one per stage"


def resolve_load_stages(mechanism: Mechanism, loads: Any, caller: str = "equilibrium") -> Stages:
    """Return the names of the loads in each stage; see `equilibrium` for `loads`.

    Raises
    ------
    BeamdaeError
        If `loads` does not consist of names, a name is unknown, occurs twice or belongs to a part
        that does not only apply forces, or a stage is empty.
    """
    if loads is None:
        active = [x for x in mechanism.parts.values() if x.name not in mechanism.inactive]
        # Without the forces of a controller, its states need not have an equilibrium.
        default = tuple(x.name for x in active if x.is_load and not x.is_controlled)
        if _has_gravity(mechanism):
            default = (*default, GRAVITY)
        return (default,) if default else ()
    items = require_sequence(caller, "loads", loads, _LOADS_DESCRIPTION)
    if all(isinstance(name, str) for name in items):
        items = [items] if items else []
    stages = tuple(
        tuple(require_sequence(caller, "loads", stage, _LOADS_DESCRIPTION)) for stage in items
    )
    names = [name for stage in stages for name in stage]
    for name in names:
        _require_load(mechanism, name, caller)
        if names.count(name) > 1:
            raise BeamdaeError(
                f"{caller}: loads contain {short_repr(name)} more than once; name each load once."
            )
    if not all(stages):
        raise BeamdaeError(
            f"{caller}: loads must not contain an empty stage; name at least one load "
            "in each stage."
        )
    return stages


def _has_gravity(mechanism: Mechanism) -> bool:
    return mechanism.gravity_laws is not None or bool(np.any(mechanism.gravity))


def _require_load(mechanism: Mechanism, name: Any, caller: str) -> None:
    if not isinstance(name, str):
        raise BeamdaeError(f"{caller}: loads must be {_LOADS_DESCRIPTION}, got {short_repr(name)}.")
    if name == GRAVITY and _has_gravity(mechanism):
        return
    if name == GRAVITY and name not in mechanism.parts:
        raise BeamdaeError(
            f"{caller}: loads contain 'gravity', but the mechanism has no gravity; "
            "set gravity= of the Mechanism."
        )
    if name not in mechanism.parts:
        candidates = (*mechanism.parts, GRAVITY)
        raise BeamdaeError(
            f"{caller}: loads contain {short_repr(name)}, but no part has this "
            f"name{suggest(name, candidates)}; use the name of a load."
        )
    part = mechanism.parts[name]
    if len(part.coordinates) or part.constraints():
        raise BeamdaeError(
            f"{caller}: loads must name parts that only apply forces, but {name} is "
            f"a {type(part).__name__}; omit this name."
        )


@dataclass(frozen=True)
class LoadedEquations:
    """Static equations R(x; mu) = (1 - mu) R_unloaded(x) + mu R_loaded(x) of one load stage.

    The unknowns are x = (q, lam).

    Attributes
    ----------
    unloaded, loaded
        Static equations without and with the loads of the stage; the same object if no load is
        scaled.
    held_coordinates
        Indices of the coordinates that springs in the tangent hold, see `neutral_motions`.
    varied
        Equations R(x; mu) that depend on another parameter mu than a load factor, or None;
        `unloaded` and `loaded` are then those at its first and last value.
    """

    unloaded: StaticEquations
    loaded: StaticEquations
    held_coordinates: tuple[int, ...] = ()
    varied: VariedEquations | None = None

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion with all loads of the stage."""
        return self.loaded.equations

    @property
    def has_scaled_loads(self) -> bool:
        """True if the load factor scales at least one load."""
        return self.unloaded is not self.loaded

    @property
    def ends(self) -> tuple[float, float]:
        """Load factors, or values of the parameter, without and with the loads."""
        return (0.0, 1.0) if self.varied is None else (self.varied.begin, self.varied.end)

    def time_at(self, mu: float) -> Array:
        """Return (t, branch) at which laws are evaluated."""
        return self.loaded.time if self.varied is None else self.varied.at(mu).time

    def interval_at(self, mu: float) -> tuple[StaticEquations, StaticEquations, float]:
        """Return two equations and the share of the second one in those at `mu`."""
        if self.varied is None:
            return self.unloaded, self.loaded, mu
        return self.varied.at(mu), self.varied.at(mu), 1.0

    def residual(self, x: Array, mu: float) -> tuple[Array, Array]:
        """Return the residual (n + m,) and, for load factors, its derivative by mu."""
        *pair, share = self.interval_at(mu)
        first, last = (each.residual(*np.split(x, [each.equations.n])) for each in pair)
        return first + share * (last - first), last - first

    def matrix(self, x: Array, mu: float) -> sp.csc_array:
        """Return the Jacobian of the residual with respect to x."""
        *pair, share = self.interval_at(mu)
        first, last = (each.matrix(*np.split(x, [each.equations.n])) for each in pair)
        return sp.csc_array((1.0 - share) * first + share * last)

    def motion_tangent(self, mu: float, state: State, convert: Convert | None = None) -> Tangent:
        """Return converted equations of motion linearized about `state` at the load factor `mu`."""
        first, last, share = self.interval_at(mu)
        if convert is None:
            state = state._replace(lam=state.lam[: self.equations.m])
        loaded = tangent_of(last.equations, last.time, state, convert)
        if first is last:
            return loaded
        unloaded = tangent_of(first.equations, first.time, state, convert)
        return interpolate_tangents(unloaded, loaded, share)

    def at_factor(self, mu: float) -> FixedFactorEquations | StaticEquations:
        """Return the static equations under a fixed load factor."""
        return FixedFactorEquations(self, mu) if self.varied is None else self.varied.at(mu)


def active_stage(factors: Array) -> int:
    """Return the number of the stage of loads that a row of load factors (stages,) belongs to."""
    (unfinished,) = np.nonzero(np.abs(factors - 1.0) > _FACTOR_TOLERANCE)
    return int(unfinished[0]) if len(unfinished) else max(len(factors) - 1, 0)


def interpolate_tangents(unloaded: Tangent, loaded: Tangent, mu: float) -> Tangent:
    """Return the tangent for the load factor `mu`; loads do not change mass and constraints."""
    interpolated = {
        name: (1.0 - mu) * getattr(unloaded, name) + mu * getattr(loaded, name)
        for name in ("damping", "stiffness", "reactions", "residual")
    }
    return loaded._replace(**interpolated)


@dataclass(frozen=True)
class FixedFactorEquations:
    """Static equations at a fixed load factor, with the interface that relaxation requires."""

    system: LoadedEquations
    mu: float

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion with all loads of the stage; relaxation uses their inertia."""
        return self.system.equations

    @property
    def time(self) -> Array:
        """(t, branch) at which laws are evaluated."""
        return self.system.loaded.time

    def residual(self, q: Array, lam: Array) -> Array:
        """Return (F + G^T lam, g), shape (n + m,)."""
        return self.system.residual(np.append(q, lam), self.mu)[0]

    def matrix(self, q: Array, lam: Array) -> sp.csc_array:
        """Return the Jacobian of the residual with respect to (q, lam), (n + m, n + m)."""
        return self.system.matrix(np.append(q, lam), self.mu)


@dataclass(frozen=True)
class Loading:
    """Static equations of the load stages of a model.

    Attributes
    ----------
    full_equations
        Equations of all parts, including observables and redundant constraints.
    stages
        Names of the loads in each stage; empty if no load is scaled.
    systems
        Static equations of each stage; a single entry if no load is scaled.
    multiplier_rows
        Index in the full equations of each multiplier of `systems`.
    reduction
        Reduction that removed redundant constraints and restores their reactions; None if no
        constraint was removed.
    parameter
        Quantity that varies along the path in place of a load factor, or None.
    """

    full_equations: EquationsOfMotion
    stages: Stages
    systems: tuple[LoadedEquations, ...]
    multiplier_rows: Array
    reduction: ReducedEquations | None
    parameter: PathParameter | None = None

    @property
    def quantity(self) -> str:
        """Name of the quantity that varies along the path."""
        return "load factor" if self.parameter is None else self.parameter.header

    def full_multipliers(self, q: Array, lam: Array, times: Array | None = None) -> Array:
        """Return the multipliers of all constraints, (k, m), for k rows of q, lam and times.

        The times (t, branch) are needed only where the time varies along the path.
        """
        if self.reduction is not None:
            if times is None:
                times = np.tile(self.systems[0].loaded.time, (len(q), 1))
            return self.reduction.restore_reactions(times, q, lam)
        multipliers = np.zeros((len(lam), self.full_equations.m))
        multipliers[:, self.multiplier_rows] = lam
        return multipliers


def build_loading(
    model: Any,
    full_equations: EquationsOfMotion,
    loads: Any,
    t: float,
    caller: str = "equilibrium",
) -> Loading:
    """Return the static equations of all load stages of a model.

    Parameters
    ----------
    model
        Mechanism, constrained system or equations. Only a mechanism has named loads.
    full_equations
        Equations of motion of the model.
    loads
        See `equilibrium`.
    t
        Time [s] at which laws are evaluated.
    caller
        Function that errors name.

    Raises
    ------
    BeamdaeError
        If `loads` is invalid, or a constraint acts on velocities only.
    """
    time = time_on_branch(full_equations.breakpoints, t)
    if not isinstance(model, Mechanism):
        if loads is not None:
            raise BeamdaeError(
                f"{caller}: loads= requires a Mechanism; omit loads= for constrained "
                "systems and equations, which are solved under all loads."
            )
        stages: Stages = ()
        models = [full_equations]
    else:
        stages = resolve_load_stages(model, loads, caller)
        remaining = [set().union(*stages[k:]) for k in range(len(stages) + 1)]
        models = [_equations_without(model, full_equations, names) for names in remaining]
    reduction = None
    if full_equations.redundant:
        reduction = remove_redundant_constraints(models[-1], time)
    if reduction is not None:
        reductions = [remove_redundant_constraints(each, time) for each in models]
        models = [
            each if reduced is None else reduced.equations
            for each, reduced in zip(models, reductions, strict=True)
        ]
    static = [StaticEquations(each, time) for each in models]
    pairs = pairwise(static) if stages else [(static[0], static[0])]
    systems = tuple(LoadedEquations(*pair) for pair in pairs)
    rows = {name: k for k, name in enumerate(full_equations.lam_names)}
    multiplier_rows = np.array([rows[name] for name in models[-1].lam_names], int)
    return Loading(full_equations, stages, systems, multiplier_rows, reduction)


def vary_parameter(full_equations: EquationsOfMotion, parameter: PathParameter) -> Loading:
    """Return the static equations along a path on which a parameter varies, under all loads."""
    varied = parameter.vary_statics()
    first, last = varied.at(parameter.begin), varied.at(parameter.end)
    system = LoadedEquations(first, last, (), varied)
    rows = {name: k for k, name in enumerate(full_equations.lam_names)}
    multiplier_rows = np.array([rows[name] for name in first.equations.lam_names], int)
    reduction = parameter.reduce(parameter.begin)
    return Loading(full_equations, (), (system,), multiplier_rows, reduction, parameter)


def _equations_without(
    mechanism: Mechanism, full_equations: EquationsOfMotion, names: set[str]
) -> EquationsOfMotion:
    """Return the equations without the named loads and without initially inactive parts."""
    # Assembling equations takes longer than a few load steps. The known ones contain inactive parts
    # and weight, and may begin at other positions.
    equations = None
    if full_equations.configurations is None:
        if not names:
            return full_equations
        if full_equations.start is None and GRAVITY not in names:
            equations = remove_forces(full_equations, names)
    return equations or equations_of_motion(_remove_loads(mechanism, names))


def _remove_loads(mechanism: Mechanism, names: set[str]) -> Mechanism:
    """Return the mechanism without the named loads and without initially inactive parts."""
    rest = copy(mechanism)
    excluded_names = names | mechanism.inactive
    rest.parts = {name: part for name, part in rest.parts.items() if name not in excluded_names}
    rest.observables, rest.events, rest.inactive, rest.start = {}, [], set(), AS_DRAWN
    rest.removed = frozenset(excluded_names)
    if GRAVITY in names:
        rest.gravity, rest.gravity_laws = np.zeros(2), None
    return rest
