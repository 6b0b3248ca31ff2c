"""Neighbors: models at values next to that of a parameter, and differences along them.

Parameters enter the equations of motion only through the numbers p, the operators and the start.
The model function is an arbitrary Python function; therefore, these are differenced, and explicit
maps, such as impacts and energies, are differenced along with them. The equations of implicit steps
are differentiated exactly.

Building a model takes milliseconds, a large part of a short run. Parameters that affect different
numbers, such as the thicknesses of a beam at different points, are therefore changed together
(Curtis, Powell & Reid, IMA J. Appl. Math. 13 (1974) 117, doi:10.1093/imamat/13.1.117).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import ConstraintTerm, ForceTerm, has_same_patterns
from beamdae.errors import BeamdaeError, format_exception, warn_user
from beamdae.interrupts import outermost_call

Array = np.ndarray

# Difference of a parameter, relative to its value. The numbers of a model are smooth functions of
# its parameters: errors of the differences of fourth order are near 1e-12.
RELATIVE_DIFFERENCE = 1e-3
# First difference of a parameter whose value is zero, in its unit.
_DIFFERENCE_FROM_ZERO = 1e-4
# Values such as a stiffness of 0 N/m that is added to 1e9 N/m, or an eccentricity of 0 m of a
# bearing, do not reveal the scale of a parameter. The difference is enlarged if it only changes
# rounding errors, and reduced if one-sided differences deviate by more than the tolerance: errors
# of the derivatives are near the square of this deviation.
_ENLARGEMENT, _REDUCTION = 1e3, 0.1
_TOLERANCE = 1e-4
_MAX_TRIALS = 8
# Larger deviations are reported.
_REPORTED_DEVIATION = 3e-3
# Rounding errors do not grow with the step; changes must grow at least by this factor.
_MIN_GROWTH = 10.0
# Deviation of a number at a kink from the interpolation of its neighbors, relative to its changes.
_MIN_KINK = 1e-3
# Changes below this multiple of rounding errors do not reveal whether a number has a kink.
_MIN_RESOLVED_CHANGE = 10.0
# Smaller changes of numbers are rounding errors of their formulas, relative to the numbers and to
# the largest numbers of the same kind.
_ROUNDING = 1e-9
_ROUNDING_OF_KIND = 1e-12


# Public functions whose messages begin with their own names.
_CALLS = (
    "sensitivities",
    "mode_sensitivities",
    "equilibrium_sensitivities",
    "periodic_sensitivities",
    "gradient",
    "fit",
    "optimize",
    "simulate",
)


def derivative_call() -> str:
    """Return the name of the function that the user called for derivatives, for messages."""
    return outermost_call(_CALLS) or "sensitivities"


@lru_cache
def _weigh(steps: tuple[float, ...], order: int) -> Array:
    """Return the weights of values at `steps` in a derivative at zero."""
    return np.linalg.solve(np.vander(steps, increasing=True).T, np.eye(len(steps))[order])


class NumericModel(Protocol):
    """Model at the values of its parameters, such as a model function with these defaults."""

    @property
    def name(self) -> str:
        """Name of the model function."""

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Values of the parameters."""

    @property
    def build(self) -> Callable[..., Any]:
        """Function of the user."""

    def __call__(self, **values: Any) -> Any:
        """Return the mechanism for other values of some parameters."""


# Values of a parameter in differences, relative to that of the model, in multiples of the
# difference.
Stencil = tuple[float, ...]
CENTRAL: Stencil = (-2.0, -1.0, 1.0, 2.0)
STENCILS: tuple[Stencil, ...] = CENTRAL, (1.0, 2.0, 3.0, 4.0), (-1.0, -2.0, -3.0, -4.0)


@dataclass(frozen=True)
class Neighbors:
    """Models next to a point along a direction.

    Attributes
    ----------
    models
        The models.
    stencil, delta
        Their distances are the steps of the stencil times the difference `delta`.
    """

    models: Sequence[Any]
    stencil: Stencil
    delta: float

    @property
    def steps(self) -> list[float]:
        """Distances of the models."""
        return [x * self.delta for x in self.stencil]

    def along(self, function: Callable[..., Any], *changes: tuple[Any, Any]) -> Any:
        """Return the derivative of function(model, *x) along the direction.

        `changes` are pairs of x and of its derivative.
        """
        return self.combine(
            function(model, *(x + step * dx for x, dx in changes))
            for model, step in zip(self.models, self.steps, strict=True)
        )

    def combine(self, values: Iterable[Any], order: int = 1) -> Any:
        """Return the derivative of a function, given its values in the models.

        If the order is 0, return its value at the point minus the first value.
        """
        weights = _weigh(self.stencil, order) / self.delta**order
        first, *others = values
        # The sum of the weights is zero; differences make derivatives of constants exactly zero.
        return sum(w * (x - first) for w, x in zip(weights[1:].tolist(), others, strict=True))


@dataclass(frozen=True)
class Difference(Neighbors):
    """Equations of models at neighboring values of one parameter.

    Attributes
    ----------
    name
        Name of the parameter.
    base
        Equations at the value of the parameter, with the structure of the neighboring models.
    is_regular
        True if the models are known to differ only in their numbers and start.
    """

    name: str
    base: EquationsOfMotion
    is_regular: bool = False

    @property
    def moves_operators(self) -> bool:
        """True if operators of joints depend on the parameter."""
        return any(e.structure != self.base.structure for e in self.models)

    def between(self, base: EquationsOfMotion, models: Sequence[EquationsOfMotion]) -> Difference:
        """Return the difference of other equations of the same models.

        Forces that vanish at the value of the parameter may be missing in `base`; the numbers are
        then interpolated or extrapolated in the structure of the neighboring models.
        """
        first = models[0]
        is_unchanged = base.structure == first.structure and forms_of(base) == forms_of(first)
        if not is_unchanged and all(e.structure == first.structure for e in models):
            # Entries that are equal in all models are exact: tables contain integers from which
            # rows are computed, and 4 (1 - 1e-16) would select another row.
            p = first.p + self.combine([e.p for e in models], 0)
            base = replace(first, p=p, q0=base.q0, v0=base.v0, breakpoints=base.breakpoints)
        return replace(self, base=base, models=tuple(models))


def difference_model(
    model: NumericModel,
    name: str,
    base: EquationsOfMotion,
    assemble: Callable[[Any], EquationsOfMotion],
) -> Difference:
    """Return the models around the value of one parameter.

    Central differences of fourth order are used. If the model rejects values on one side, as for
    damping = 0, the differences are one-sided, of third order. They are repeated with another step
    if one-sided derivatives show that the step does not suit the scale of the parameter.

    Forces that vanish at the value of the parameter may be missing in `base`, such as damping
    forces at damping = 0. The numbers at this value are then interpolated or extrapolated in the
    structure of the neighboring models. The operators of joints may depend on the parameter, as the
    shape functions at joints of curved floating-frame beams do; see `directional_plan`.

    Parameters
    ----------
    model
        Model at the values of its parameters.
    name
        Name of the parameter, a float.
    base
        Equations of the model.
    assemble
        Function that returns the equations of a mechanism.

    Raises
    ------
    BeamdaeError
        If the model rejects neighboring values on both sides, the parameter changes the structure
        of the equations or the breakpoints of laws, or the model function has a kink at its value;
        the message names the parameter.

    Warns
    -----
    BeamdaeWarning
        If no step leads to relative errors near 1e-5, or the parameter has no effect.
    """
    value = float(model.parameters[name])
    delta = first_difference(value)

    def change(x: float) -> dict[str, float]:
        return {name: value + x}

    build = partial(try_step, model, name, change, base, assemble)
    best: Trial | None = None
    for _ in range(_MAX_TRIALS):
        try:
            trial = build(delta, STENCILS)
        except _RejectedError as rejection:
            problem = rejection
            if best is not None:
                break
            delta *= _REDUCTION
            continue
        except BeamdaeError:
            if best is None:
                raise
            break
        if best is not None and trial.is_rounded and trial.change < _MIN_GROWTH * best.change:
            break  # Another step does not help, or the parameter has no effect.
        if best is None or trial.is_rounded or trial.error < best.error:
            best = trial
        if trial.error <= _TOLERANCE:
            break
        delta *= _ENLARGEMENT if trial.is_rounded else _REDUCTION
    if best is None:
        raise BeamdaeError(
            f"{derivative_call()}: {model.name} rejects values of {name} next to {value:g} "
            f"({problem}); choose another value."
        )
    if best.has_kink:
        raise BeamdaeError(
            f"{derivative_call()}: the numbers of {model.name} have a kink at {name} = "
            f"{value:g}, or change there without a derivative; choose another value."
        )
    if not best.is_rounded and best.error > _REPORTED_DEVIATION:
        warn_user(
            f"{derivative_call()}: differences of the numbers of {model.name} with respect to "
            f"{name} depend on their step at {name} = {value:g}, and the derivatives may be "
            f"inaccurate; compare them with differences of runs, or rescale {name}."
        )
    if not any(has_effect(base, e) for e in best.difference.models):
        warn_without_effect(model.name, name)
    return best.difference


def first_difference(value: float) -> float:
    """Return the first difference of a parameter or of another number."""
    return RELATIVE_DIFFERENCE * abs(value) or _DIFFERENCE_FROM_ZERO


def has_effect(base: EquationsOfMotion, other: EquationsOfMotion) -> bool:
    """Return True if the model with another value of a parameter may differ from `base`.

    Models with events may always differ: actions of events are not compared.
    """
    return bool(
        base.events
        or base.structure != other.structure
        or base.breakpoints != other.breakpoints
        or not np.array_equal(numbers_and_start(base), numbers_and_start(other))
        or not has_same_operators(base, other)
    )


def has_same_operators(base: EquationsOfMotion, other: EquationsOfMotion) -> bool:
    """Return True if observables of both models depend on the same coordinates."""
    pairs = zip(base.observables, other.observables, strict=True)
    return all(np.array_equal(x.operator.data, y.operator.data) for x, y in pairs)


def warn_without_effect(model: str, name: str) -> None:
    """Warn that the derivatives with respect to a parameter of a model are zero."""
    warn_user(
        f"{derivative_call()}: small changes of {name} change no number of {model}, so the "
        f"derivatives are zero; either the model does not use {name}, or {name} only moves a jump, "
        "such as a step of a section along a beam (then replace it by a smooth transition)."
    )


class _RejectedError(BeamdaeError):
    """The model rejects neighboring values on both sides."""


class Trial(NamedTuple):
    """Difference with one step.

    Attributes
    ----------
    difference
        Neighboring models.
    error
        Largest error of one-sided derivatives, relative to the largest change; infinite if all
        changes are rounding errors, and zero if nothing changes.
    change
        Largest change of a number, relative to the larger of 1 and the numbers of the same kind.
    has_kink
        True if a number has a kink, or changes without a derivative.
    """

    difference: Difference
    error: float
    change: float
    has_kink: bool

    @property
    def is_smooth(self) -> bool:
        """Return True if the step suits the scale of the parameter."""
        return self.error <= _TOLERANCE and not self.has_kink

    @property
    def is_rounded(self) -> bool:
        """Return True if changes of numbers are rounding errors; a larger step is needed."""
        return math.isinf(self.error)


def try_step(
    model: NumericModel,
    name: str,
    change: Callable[[float], Mapping[str, float]],
    base: EquationsOfMotion,
    assemble: Callable[[Any], EquationsOfMotion],
    delta: float,
    stencils: Sequence[Stencil],
) -> Trial:
    """Return the difference with a step `delta` of a parameter x, and its accuracy.

    `change` returns values of parameters of the model at a distance of x; `name` is that of x.
    """
    for stencil in stencils:
        try:
            neighbors = tuple(assemble(build_neighbor(model, change(x * delta))) for x in stencil)
        except BeamdaeError as problem:
            rejection = problem
            continue
        for equations in neighbors:
            _require_same_structure(model.name, name, base, neighbors[0], equations)
        difference = Difference(neighbors, stencil, delta, name, base).between(base, neighbors)
        base = difference.base
        here, n_p = numbers_and_start(base), len(base.p)
        sizes, rounding = sizes_and_rounding(base)
        changes = np.array([numbers_and_start(e) for e in neighbors]) - here
        largest = np.abs(changes).max(axis=0)
        is_significant, error = largest > _MIN_RESOLVED_CHANGE * rounding, 0.0
        if np.any(is_significant):
            # Deviation of the derivative on one side, times the smallest step.
            step = min(map(abs, stencil))
            side = [x for x in stencil if x * stencil[-1] > 0.0 and abs(x) <= 2.0 * step]
            one_sided = dict(zip(side, _weigh((0.0, *side), 1)[1:], strict=True))
            weights = np.array([one_sided.get(x, 0.0) for x in stencil]) - _weigh(stencil, 1)
            errors = np.maximum(np.abs(step * weights @ changes) - rounding, 0.0)
            scales = np.maximum(np.maximum(sizes, largest), np.finfo(float).tiny)
            worst, most = (np.max((x / scales)[is_significant]) for x in (errors, largest))
            error = float(worst / most)
        elif np.any(largest):
            error = math.inf
        # A parameter with a tiny value may be added to coordinates, such as 1e-8 m to 1 m.
        is_lost = (largest[n_p:] > 0.0) & (largest[n_p:] <= rounding[n_p:])
        if np.any(is_lost) and delta < _ROUNDING * np.max(sizes[n_p:]):
            error = math.inf
        # Deviations from values that are interpolated between the neighbors.
        gaps = np.abs(_weigh(stencil, 0) @ changes[:, :n_p])
        kinks = gaps > _MIN_KINK * largest[:n_p] + rounding[:n_p]
        relative_change = float(np.max(largest / np.maximum(sizes, 1.0)))
        return Trial(difference, error, relative_change, bool(np.any(kinks)))
    raise _RejectedError(str(rejection))


def numbers_and_start(equations: EquationsOfMotion) -> Array:
    """Return the numbers and the start of equations, (n_p + 2 n,)."""
    return np.concatenate([equations.p, equations.q0, equations.v0])


def sizes_and_rounding(equations: EquationsOfMotion) -> tuple[Array, Array]:
    """Return the largest magnitudes of the kinds of `numbers_and_start`, and rounding errors."""
    largest = np.abs(equations.p)
    terms: list[ForceTerm | ConstraintTerm] = [*equations.forces, *equations.joints]
    for term in terms:
        # The largest magnitude over the copies of a kernel.
        numbers = largest[term.data].reshape((-1, term.count), order="F")
        of_kind = np.broadcast_to(numbers.max(axis=1, keepdims=True), numbers.shape)
        largest[term.data] = of_kind.ravel(order="F")
    motion = [np.abs(x).max(initial=0.0) for x in (equations.q0, equations.v0)]
    size = np.append(largest, np.repeat(motion, equations.n))
    magnitudes = np.abs(numbers_and_start(equations))
    return size, _ROUNDING * magnitudes + _ROUNDING_OF_KIND * np.maximum(size, 1.0)


def build_neighbor(model: NumericModel, values: Mapping[str, float]) -> Any:
    """Return the mechanism; errors of formulas reject parameters as those of parts do."""
    try:
        return model(**values)
    except (ArithmeticError, ValueError) as problem:
        raise BeamdaeError(format_exception(problem)) from problem


def _require_same_structure(
    model: str,
    name: str,
    base: EquationsOfMotion,
    one: EquationsOfMotion,
    other: EquationsOfMotion,
) -> None:
    """Reject a parameter that changes more than the numbers and the start of a model."""
    has_same_operators = one.structure == other.structure
    same = {
        "the coordinates or constraints of the model": (
            (base.q_names, base.lam_names) == (other.q_names, other.lam_names)
        ),
        "the number of times at which laws have breakpoints": (
            len(base.breakpoints) == len(other.breakpoints)
        ),
        "the structure of the equations": has_same_operators
        or all(has_same_patterns(x.structure, other.structure) for x in (one, base)),
        f"the form of an observed column from one value next to {name} to another": (
            forms_of(one) == forms_of(other)
        ),
    }
    changed = next((subject for subject, is_same in same.items() if not is_same), None)
    if changed is not None:
        raise BeamdaeError(
            f"{derivative_call()}: {name} of {model} changes {changed}; use differences of runs "
            "for this parameter."
        )


def equations_key(equations: EquationsOfMotion) -> Any:
    """Return a key that is equal if the same equations serve two parameters.

    Forces that are missing in the run may have the same kernels and operators, but other numbers,
    such as the points on which they act. Their structures are equal; their derivatives are not.
    """
    return equations.structure, (equations.p + 0.0).tobytes()  # not -0.0


def forms_of(equations: EquationsOfMotion) -> list[tuple[int, int]]:
    """Return the numbers of coordinates and constants in the formulas of all columns and events.

    CasADi simplifies 1 q to q, 2 q to q + q and 0 q to 0, without a constant, but not 1.001 q.
    """
    terms = (*equations.observables, *(x.observable for x in equations.events))
    return [(x.operator.shape[0], x.data.stop - x.data.start) for x in terms]


# Parameters are searched for those that affect the same numbers if they are at least this many.
_MIN_SEARCHED = 4
# Largest error of the sum of the derivatives along a common change of all parameters, relative to
# the sum of their magnitudes.
_MAX_COMMON_ERROR = 1e-6


# The latest parameters of a model function with the entries that they affect, (k, size), or False
# if no groups were found: searches of an optimum differentiate the same parameters repeatedly.
_latest_effects: WeakKeyDictionary[Callable[..., Any], dict[Any, Any]]
_latest_effects = WeakKeyDictionary()


def difference_models(
    model: NumericModel,
    names: Sequence[str],
    base: EquationsOfMotion,
    assemble: Callable[[Any], EquationsOfMotion],
) -> dict[str, Difference]:
    """Return the models around the values of parameters, by name; see `difference_model`.

    If groups of parameters act independently, these models contain their linear effects on the
    numbers and the start.

    Parameters
    ----------
    model, names
        Model at the values of its parameters, and names of some that are floats.
    base
        Equations of the model.
    assemble
        Function that returns the equations of a mechanism.
    """
    rows = None
    if base.configurations is None and len(names) >= _MIN_SEARCHED:
        latest = _latest_effects.setdefault(model.build, {})
        key = tuple(names), len(numbers_and_start(base))
        masks = latest.get(key)
        found: Any = False
        for known in () if masks is False else (None,) if masks is None else (masks, None):
            with suppress(BeamdaeError):
                rows, found = _differentiate_groups(model, names, base, assemble, known)
                break
        # Unless the search for groups succeeds, it is not repeated.
        latest[key] = found
    if rows is None:
        return {x: difference_model(model, x, base, assemble) for x in names}
    result = {}
    for name, row in zip(names, rows, strict=True):
        if not np.any(row):
            warn_without_effect(model.name, name)
        delta, models = first_difference(float(model.parameters[name])), []
        for x in CENTRAL:
            moved = numbers_and_start(base) + x * delta * row
            p, q0, v0 = np.split(moved, [len(base.p), len(base.p) + base.n])
            models.append(replace(base, p=p, q0=q0, v0=v0))
        result[name] = Difference(tuple(models), CENTRAL, delta, name, base, is_regular=True)
    return result


class _DependentError(BeamdaeError):
    """No parameters can be changed together; each is differenced alone."""


def _differentiate_groups(
    model: NumericModel,
    names: Sequence[str],
    base: EquationsOfMotion,
    assemble: Callable[[Any], EquationsOfMotion],
    masks: Array | None,
) -> tuple[Array, Array]:
    """Return the derivatives (k, size) of the numbers and the start, by groups, and the masks.

    `masks` are True (k, size) where a parameter affects an entry; None if this is unknown.

    Raises
    ------
    BeamdaeError
        If all parameters depend on each other, the derivatives are not accurate, the model rejects
        a change, or a parameter changes the number of entries.
    """
    values, here = np.array([float(model.parameters[x]) for x in names]), numbers_and_start(base)
    sizes = np.array([first_difference(x) for x in values]) / RELATIVE_DIFFERENCE

    def change(shares: Array) -> Trial:
        """Return the models at relative changes by shares * x about x = 0."""

        def move(x: float) -> dict[str, float]:
            moved = values + x * shares * sizes
            return {names[k]: float(moved[k]) for k in np.flatnonzero(shares).tolist()}

        name = ", ".join(names)
        trial = try_step(model, name, move, base, assemble, RELATIVE_DIFFERENCE, (CENTRAL,))
        is_independent = all(has_same_operators(base, e) for e in trial.difference.models)
        if not (is_independent and is_regular(trial.difference, base)):
            raise _DependentError
        return trial

    if masks is None:
        rows = []
        for name, value in zip(names, values + RELATIVE_DIFFERENCE * sizes, strict=True):
            rows.append(numbers_and_start(assemble(build_neighbor(model, {name: float(value)}))))
            if len(rows[-1]) != len(here):
                raise _DependentError
        masks = np.array(rows) != here
    groups: list[tuple[list[int], Array]] = []
    for k, mask in enumerate(masks):
        for group, union in groups:
            if not np.any(union & mask):
                group.append(k)
                union |= mask
                break
        else:
            groups.append(([k], mask.copy()))
    if len(groups) == len(masks):
        raise _DependentError
    result = np.zeros(masks.shape)
    for group, _ in groups:
        trial = change(np.isin(np.arange(len(names)), group) * 1.0)
        if not trial.is_smooth:
            raise _DependentError
        along = trial.difference.along(numbers_and_start)
        result[group] = np.where(masks[group], along, 0.0) / sizes[group, None]
    # The derivatives add up along a common change of all parameters.
    shares = np.random.default_rng(0).choice([-1.0, -0.5, 0.5, 1.0], len(names))
    parts = result * (shares * sizes)[:, None]
    error = np.abs(change(shares).difference.along(numbers_and_start) - parts.sum(axis=0))
    rounding = sizes_and_rounding(base)[1] / RELATIVE_DIFFERENCE
    if np.any(error > _MAX_COMMON_ERROR * np.abs(parts).sum(axis=0) + rounding):
        raise _DependentError
    return result, masks


def is_regular(difference: Difference, base: EquationsOfMotion) -> bool:
    """Return True if neighboring models differ from `base` only in their numbers and start."""
    return difference.is_regular or all(
        e.structure == base.structure
        and forms_of(e) == forms_of(base)
        and e.breakpoints == base.breakpoints
        for e in difference.models
    )
