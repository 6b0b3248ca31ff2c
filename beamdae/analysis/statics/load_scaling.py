"""Proportional loading: load stages of a mechanism, and static equations with a load factor."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.eigenproblems.linearized_equations import (
    LinearizedEquations,
    linearize_in_mixed_form,
)
from beamdae.analysis.statics.path_parameters import PathParameter
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
from beamdae.errors import BeamdaeError, list_first, require_sequence, short_repr, suggest
from beamdae.parts.mechanism import AS_DRAWN, Mechanism
from beamdae.results.section_forces.applied_loads import GRAVITY

Array = np.ndarray
Stages = tuple[tuple[str, ...], ...]

# Load factors that differ from one by less than this are treated as one, because Newton's method
# does not reach one exactly.
_FACTOR_TOLERANCE = 1e-9
# Step of the derivatives by a parameter, relative to its range.
_DIFFERENCE = 1e-6
_LOADS_DESCRIPTION = "names of loads (or 'gravity'), or lists of such names, one per stage"


def resolve_load_stages(mechanism: Mechanism, loads: Any, caller: str = "equilibrium") -> Stages:
    """Return the names of the loads in each stage; see `equilibrium` for `loads`.

    Raises
    ------
    BeamdaeError
        If `loads` does not consist of names, a name is unknown, occurs twice or belongs to a part
        that does not only apply forces, or a stage is empty.
    """
    active = [x for x in mechanism.parts.values() if x.name not in mechanism.inactive]
    # Without the forces of a controller, its states need not have an equilibrium.
    default = [x.name for x in active if x.is_load and not x.is_controlled]
    default += [GRAVITY] * _has_gravity(mechanism)
    if loads is None:
        return (tuple(default),) if default else ()
    items = [loads] if isinstance(loads, str) else loads
    items = require_sequence(caller, "loads", items, _LOADS_DESCRIPTION)
    if all(isinstance(name, str) for name in items):
        items = [items] if items else []
    stages = tuple(
        tuple(require_sequence(caller, "loads", stage, _LOADS_DESCRIPTION)) for stage in items
    )
    if not all(stages):
        raise BeamdaeError(
            f"{caller}: loads must not contain an empty stage; name at least one load "
            "in each stage."
        )
    names = [name for stage in stages for name in stage]
    candidates = [*mechanism.parts, *[GRAVITY] * _has_gravity(mechanism)]
    for name in names:
        if name not in candidates:
            raise BeamdaeError(
                f"{caller}: loads contain {short_repr(name)}, but no part has this "
                f"name{suggest(name, candidates)}; use the name of a load"
                f"{', such as ' * bool(default)}{list_first(default)}."
            )
        part = mechanism.parts.get(name)
        if part is not None and (len(part.coordinates) or part.constraints()):
            raise BeamdaeError(
                f"{caller}: loads must name parts that only apply forces, but {name} is "
                f"a {type(part).__name__}; omit this name."
            )
        if names.count(name) > 1:
            raise BeamdaeError(
                f"{caller}: loads contain {short_repr(name)} more than once; name each load once."
            )
    return stages


def require_one_stage(caller: str, stages: Stages) -> tuple[str, ...]:
    """Return the names of the loads in the only stage, or reject another number of stages."""
    if len(stages) != 1:
        raise BeamdaeError(
            f"{caller}: loads must be one list of names, got {len(stages)} stages; name the loads "
            "to scale, and add a load if there is none."
        )
    return stages[0]


def _has_gravity(mechanism: Mechanism) -> bool:
    return mechanism.gravity_laws is not None or bool(np.any(mechanism.gravity))


class FactorEquations(NamedTuple):
    """Static equations R = R_0 + share (R_1 - R_0) in x = (q, lam), at one value of mu.

    Attributes
    ----------
    first, last
        R_0 and R_1.
    equations
        Equations of motion with all loads.
    share, rate
        See above, and its derivative by mu.
    """

    first: StaticEquations
    last: StaticEquations
    equations: EquationsOfMotion
    share: float
    rate: float = 1.0

    @property
    def time(self) -> Array:
        """(t, branch), at which laws are evaluated."""
        return self.first.time

    def interpolate(self, first: Any, last: Any) -> Any:
        """Return a quantity, given those of both equations."""
        return (1.0 - self.share) * first + self.share * last

    def convert(self, change: Convert) -> FactorEquations:
        """Return these equations of converted equations of motion."""
        ends = self.first.convert(change), self.last.convert(change)
        return FactorEquations(*ends, change(self.equations), self.share, self.rate)

    def residual(self, q: Array, lam: Array) -> Array:
        """Return R, (n + m,)."""
        return np.asarray(self.interpolate(*(x.residual(q, lam) for x in self[:2])))

    def matrix(self, q: Array, lam: Array) -> sp.csc_array:
        """Return the Jacobian of R with respect to x."""
        return sp.csc_array(self.interpolate(*(x.matrix(q, lam) for x in self[:2])))


@dataclass(frozen=True)
class LoadedEquations:
    """Static equations R(x; mu) = (1 - mu) R_unloaded(x) + mu R_loaded(x) of one load stage.

    The unknowns are x = (q, lam). A parameter of the model may vary in place of mu.

    Attributes
    ----------
    unloaded, loaded
        Static equations without and with the loads of the stage, or those at the first and last
        value of the parameter; the same object if no load is scaled.
    parameter, at
        The parameter, and the function that returns the equations at a value of it. They differ in
        numbers and time only.
    """

    unloaded: StaticEquations
    loaded: StaticEquations
    parameter: PathParameter | None = None
    at: Callable[[float], StaticEquations] | None = None

    @property
    def is_linear(self) -> bool:
        """True if R is linear in mu."""
        return self.at is None

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion with all loads of the stage."""
        return self.loaded.equations

    @property
    def has_scaled_loads(self) -> bool:
        """True if the equations depend on mu."""
        return self.unloaded is not self.loaded

    @property
    def ends(self) -> tuple[float, float]:
        """Values of mu without and with the loads, or first and last value of the parameter."""
        return (self.parameter.begin, self.parameter.end) if self.parameter else (0.0, 1.0)

    def time_at(self, mu: float) -> Array:
        """Return (t, branch) at which laws are evaluated."""
        return self.at(mu).time if self.at else self.loaded.time

    def at_factor(self, mu: float) -> FactorEquations:
        """Return the static equations at a value of mu.

        They are linear in mu: those of a parameter are the equations at its value and beside it.
        """
        if self.at is None:
            return FactorEquations(self.unloaded, self.loaded, self.equations, mu)
        step = _DIFFERENCE * (abs(self.ends[1] - self.ends[0]) or 1.0)
        here, beside = self.at(mu), self.at(mu + step)
        # The step must not lead into the next piece of a law.
        time = np.array([beside.time[0], here.time[1]])
        return FactorEquations(here, replace(beside, time=time), here.equations, 0.0, 1.0 / step)

    def motion_tangent(self, mu: float, state: State, convert: Convert | None = None) -> Tangent:
        """Return converted equations of motion linearized about `state` at a value of mu.

        Neither loads nor mu change mass and constraints.
        """
        here = self.at_factor(mu)
        if convert is None:
            state = state._replace(lam=state.lam[: self.equations.m])
        first, last = (tangent_of(y.equations, y.time, state, convert) for y in here[:2])
        names = ("damping", "stiffness", "reactions", "residual")
        pairs = ((name, getattr(first, name), getattr(last, name)) for name in names)
        return first._replace(**{name: here.interpolate(*pair) for name, *pair in pairs})

    def linearize_motion(self, x: Array, mu: float, idle: Array | None) -> LinearizedEquations:
        """Return the equations of motion about an equilibrium, in mixed form.

        `x` are the unknowns of the static equations in mixed form with the same `idle`.
        """
        q, lam = np.split(x, [self.equations.n])
        state = State(q, np.zeros_like(q), np.zeros_like(q), lam)
        tangent_at = partial(self.motion_tangent, mu)
        return linearize_in_mixed_form(self.at_factor(mu).equations, state, tangent_at, idle)


def active_stage(factors: Array) -> int:
    """Return the number of the stage of loads that a row of load factors (stages,) belongs to."""
    (unfinished,) = np.nonzero(np.abs(factors - 1.0) > _FACTOR_TOLERANCE)
    return int(unfinished[0]) if len(unfinished) else max(len(factors) - 1, 0)


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
    reduction
        Reduction that removed redundant constraints and restores their reactions; None if no
        constraint was removed.
    parameter
        Quantity that varies along the path in place of a load factor, or None.
    """

    full_equations: EquationsOfMotion
    stages: Stages
    systems: tuple[LoadedEquations, ...]
    reduction: ReducedEquations | None
    parameter: PathParameter | None = None

    @property
    def quantity(self) -> str:
        """Name of the quantity that varies along the path."""
        return "load factor" if self.parameter is None else self.parameter.header

    @property
    def multiplier_rows(self) -> Array:
        """Index in the full equations of each multiplier of `systems`."""
        rows = {name: k for k, name in enumerate(self.full_equations.lam_names)}
        return np.array([rows[name] for name in self.systems[0].equations.lam_names], int)

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
    reductions = [remove_redundant_constraints(each, time) for each in models]
    pairs_of_models = zip(models, reductions, strict=True)
    static = [StaticEquations(y.equations if y else x, time) for x, y in pairs_of_models]
    pairs = pairwise(static) if stages else [(static[0], static[0])]
    systems = tuple(LoadedEquations(*pair) for pair in pairs)
    return Loading(full_equations, stages, systems, reductions[-1])


def vary_parameter(full_equations: EquationsOfMotion, parameter: PathParameter) -> Loading:
    """Return the static equations along a path on which a parameter varies, under all loads."""
    begin, end = parameter.begin, parameter.end

    @lru_cache(maxsize=4)
    def at(value: float) -> StaticEquations:
        reduction = parameter.reduce(begin if parameter.time is None else value)
        active = parameter.equations_at(value).initially_active
        return StaticEquations(
            reduction.equations if reduction else active, parameter.time_at(value)
        )

    system = LoadedEquations(at(begin), at(end), parameter=parameter, at=at)
    return Loading(full_equations, (), (system,), parameter.reduce(begin), parameter)


def _equations_without(
    mechanism: Mechanism, full_equations: EquationsOfMotion, names: set[str]
) -> EquationsOfMotion:
    """Return the equations without the named loads and without initially inactive parts."""
    # Assembling equations takes longer than a few load steps. The known ones contain inactive parts
    # and weight, and may begin at other positions.
    if full_equations.configurations is None:
        if not names:
            return full_equations
        if full_equations.start is None and GRAVITY not in names:
            equations = remove_forces(full_equations, names)
            if equations is not None:
                return equations
    rest = copy(mechanism)
    excluded_names = names | mechanism.inactive
    rest.parts = {name: part for name, part in rest.parts.items() if name not in excluded_names}
    rest.observables, rest.events, rest.inactive, rest.start = {}, [], set(), AS_DRAWN
    rest.removed = frozenset(excluded_names)
    if GRAVITY in names:
        rest.gravity, rest.gravity_laws = np.zeros(2), None
    return equations_of_motion(rest)
