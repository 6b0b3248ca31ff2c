"""Derivatives of the numbers and the start of a model with respect to parameters.

Parameters enter the equations of motion only through the numbers p and the start. The model
function is an arbitrary Python function; therefore, p is differenced, while the equations
themselves are differentiated exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from beamdae.beams.beam import beams_of
from beamdae.beams.section_samples import keep_numbers_of_sections
from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm, Observable
from beamdae.equations.structure import ConstraintTerm, ForceTerm, has_same_patterns
from beamdae.errors import BeamdaeError, format_exception, warn_user
from beamdae.interrupts import outermost_call
from beamdae.model_functions import Model
from beamdae.parts.events import select_impacts, select_switches

Array = np.ndarray

# Difference of a parameter, relative to its value. The numbers of a model are smooth functions of
# its parameters: errors of the differences of fourth order are near 1e-12.
RELATIVE_DIFFERENCE = 1e-3
# First difference of a parameter whose value is zero, in its unit.
_DIFFERENCE_FROM_ZERO = 1e-4
# These differences may be unsuitable: values such as a stiffness of 0 N/m that is added to 1e9 N/m,
# or an eccentricity of 0 m of bearings of 1e-5 m, do not reveal the scale of a parameter. A larger
# difference is used if changes of numbers are rounding errors, a smaller one if differences of
# lower order deviate by more than this fraction, or interpolated numbers by more than the other
# one. The errors of the derivatives are then near the square of the first fraction.
_ENLARGEMENT = 1e3
_REDUCTION = 0.1
_MAX_DEVIATION = 1e-4
_MAX_DEVIATION_OF_VALUES = 1e-6
_MAX_TRIALS = 8
# Rounding errors do not grow with the step; changes must grow at least by this factor.
_MIN_GROWTH = 10.0
# Errors of derivatives near 1e-5, which are reported, exceed these fractions by this factor.
_REPORTED_EXCESS = 30.0
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


class Stencil(NamedTuple):
    """Values of a parameter in differences, and the weights of the model at these values.

    Attributes
    ----------
    steps
        Values of the parameter, relative to that of the model, in multiples of the difference.
    derivative_weights, value_weights, second_order_weights
        Weights of the derivative, of the interpolated value and of the derivative of second order.
    max_interpolation_error
        Largest error of smooth numbers that are interpolated, relative to their changes; with four
        neighbors, it is at least 1/6 at a kink.
    max_excess
        Largest `excess` with which the difference is used without a search for a better step.
    """

    steps: tuple[int, ...]
    derivative_weights: tuple[float, ...]
    value_weights: tuple[float, ...]
    second_order_weights: tuple[float, ...]
    max_interpolation_error: float = 1e-3
    max_excess: float = 1.0

    def estimate_excess(self, changes: Array, size: Array, rounding: Array) -> float:
        """Return the ratio of estimated to permitted errors of differences.

        It is infinite if all changes are rounding errors, and zero if nothing changes.

        Parameters
        ----------
        changes
            Changes of all numbers in the neighboring models, (models, k).
        size, rounding
            Magnitudes of the numbers of the same kind, and bounds of rounding errors, (k,) each.
        """
        change = np.abs(changes).max(axis=0)
        is_significant = change > rounding
        if not np.any(is_significant):
            return math.inf if np.any(change) else 0.0
        size = np.maximum(np.maximum(size, change), np.finfo(float).tiny)
        largest = np.max(change / size, where=is_significant, initial=0.0)

        def error(weights: Sequence[float] | Array) -> float:
            """Return the largest error of the sum of weight * change beyond rounding errors."""
            errors = np.maximum(np.abs(np.asarray(weights) @ changes) - rounding, 0.0)
            return float(np.max(errors / size, where=is_significant, initial=0.0) / largest)

        orders = np.subtract(self.derivative_weights, self.second_order_weights)
        return max(
            error(orders) / _MAX_DEVIATION, error(self.value_weights) / _MAX_DEVIATION_OF_VALUES
        )

    def find_kinks(self, changes: Array, rounding: Array) -> Array:
        """Return True for numbers that are far from their interpolated values, (k,)."""
        errors = np.abs(np.asarray(self.value_weights) @ changes)
        return errors > self.max_interpolation_error * np.abs(changes).max(axis=0) + rounding


FOUR_NEIGHBORS = Stencil(
    (-2, -1, 1, 2),
    (1.0 / 12.0, -2.0 / 3.0, 2.0 / 3.0, -1.0 / 12.0),
    (-1.0 / 6.0, 2.0 / 3.0, 2.0 / 3.0, -1.0 / 6.0),
    (0.0, -0.5, 0.5, 0.0),
)
# Numbers whose deviation from the mean of their neighbors is (h / L)^2 / 6 of their changes, for
# the step h and the scale L of the parameter, have derivatives with errors below 1e-5, which fits
# permit.
TWO_NEIGHBORS = Stencil((-1, 1), (-0.5, 0.5), (0.5, 0.5), (-0.5, 0.5), 1e-2, 4e3)
_ONE_SIDED = Stencil(
    (1, 2, 3, 4),
    (-13.0 / 3.0, 9.5, -7.0, 11.0 / 6.0),
    (4.0, -6.0, 4.0, -1.0),
    (-2.5, 4.0, -1.5, 0.0),
)
_BACKWARD = _ONE_SIDED._replace(
    steps=(-1, -2, -3, -4),
    derivative_weights=tuple(-x for x in _ONE_SIDED.derivative_weights),
    second_order_weights=tuple(-x for x in _ONE_SIDED.second_order_weights),
)
_STENCILS = (FOUR_NEIGHBORS, _ONE_SIDED, _BACKWARD)


@dataclass(frozen=True)
class Difference:
    """Models at neighboring values of one parameter, with the weights of a derivative.

    Attributes
    ----------
    name
        Name of the parameter.
    base
        Equations at the value of the parameter, with the structure of the neighboring models.
    equations
        Equations of the neighboring models.
    weights
        Weights of these models: the sum of weight * f is df/dparameter.
    steps
        Values of the parameter in these models, relative to `base`.
    """

    name: str
    base: EquationsOfMotion
    equations: tuple[EquationsOfMotion, ...]
    weights: tuple[float, ...]
    steps: tuple[float, ...]

    def derivative(self, function: Callable[[EquationsOfMotion], Any]) -> Any:
        """Return the derivative of a function of the equations with respect to the parameter."""
        return difference_values(self.weights, [function(e) for e in self.equations])


def difference_model(
    model: Model,
    name: str,
    parameters: Mapping[str, Any],
    base: EquationsOfMotion,
    assemble: Callable[[Any], EquationsOfMotion],
    *,
    needs_high_order: bool = True,
) -> Difference:
    """Return the models around the value of one parameter.

    Central differences of fourth order are used. If the model rejects values on one side, as for
    damping = 0, the differences are one-sided, of third order. They are repeated with another step
    if differences of second order or interpolated numbers show that the step does not suit the
    scale of the parameter.

    Forces that vanish at the value of the parameter may be missing in `base`, such as damping
    forces at damping = 0. The numbers at this value are then interpolated or extrapolated in the
    structure of the neighboring models. The operators of joints may depend on the parameter, as the
    shape functions at joints of curved floating-frame beams do; see `operator_changes`.

    Parameters
    ----------
    model, parameters
        Model function, and values of its parameters.
    name
        Name of the parameter, a float.
    base
        Equations of the model with `parameters`.
    assemble
        Function that returns the equations of a mechanism.
    needs_high_order
        False to use only two neighbors, with errors of the derivatives up to 1e-5, if their numbers
        are smooth enough and the equations have the structure of `base`.

    Raises
    ------
    BeamdaeError
        If the model rejects neighboring values on both sides, the parameter changes the structure
        of the equations or the breakpoints of laws, or the model function has a kink at its value;
        the message names the parameter.

    Warns
    -----
    BeamdaeWarning
        If no step leads to relative errors below 1e-5, or the parameter has no effect.
    """
    value = float(parameters[name])
    delta = RELATIVE_DIFFERENCE * abs(value) or _DIFFERENCE_FROM_ZERO
    if not needs_high_order and base.configurations is None:
        # Parts that events activate have structures of their own, which need more neighbors.
        with suppress(BeamdaeError):
            two = _try_step(model, name, parameters, base, assemble, delta, (TWO_NEIGHBORS,))
            has_structure = two.difference.base is base and all(
                e.structure == base.structure for e in two.difference.equations
            )
            is_smooth = two.change > 0.0 and two.excess <= TWO_NEIGHBORS.max_excess
            if has_structure and is_smooth and not np.any(two.kinks):
                return two.difference
    best: _Trial | None = None
    problem: BeamdaeError | None = None
    for _ in range(_MAX_TRIALS):
        try:
            trial = _try_step(model, name, parameters, base, assemble, delta)
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
        if trial.is_rounded and best is not None and trial.change < _MIN_GROWTH * best.change:
            break  # A smaller step does not help, or the parameter has no effect.
        if best is not None and not trial.resolves_kinks(best):
            break  # Rounding errors hide the kink.
        if best is None or trial.is_rounded or trial.excess < best.excess:
            best = trial
        if trial.excess <= FOUR_NEIGHBORS.max_excess:
            break
        delta *= _ENLARGEMENT if trial.is_rounded else _REDUCTION
    if best is None:
        raise BeamdaeError(
            f"{derivative_call()}: {model.name} rejects values of {name} next to {value:g} "
            f"({problem}); choose another value."
        )
    if np.any(best.kinks):
        raise BeamdaeError(
            f"{derivative_call()}: the numbers of {model.name} have a kink at {name} = "
            f"{value:g}, or change there without a derivative; choose another value."
        )
    if not best.is_rounded and best.excess > _REPORTED_EXCESS:
        warn_user(
            f"{derivative_call()}: differences of the numbers of {model.name} with respect to "
            f"{name} "
            f"depend on their step at {name} = {value:g}, and the derivatives may be inaccurate; "
            f"compare them with differences of runs, or rescale {name}."
        )
    if not any(has_effect(base, e) for e in best.difference.equations):
        warn_without_effect(model.name, name)
    return best.difference


def has_effect(base: EquationsOfMotion, other: EquationsOfMotion) -> bool:
    """Return True if the model with another value of a parameter may differ from `base`.

    Laws that events start are not compared.
    """
    if (
        base.structure != other.structure
        or base.breakpoints != other.breakpoints
        or not np.array_equal(_numbers_and_start(base), _numbers_and_start(other))
    ):
        return True
    pairs = zip(base.observables, other.observables, strict=True)
    if any(not np.array_equal(x.operator.data, y.operator.data) for x, y in pairs):
        return True
    return any(_event_differs(x, y) for x, y in zip(base.events, other.events, strict=True))


def _event_differs(one: EventTerm, other: EventTerm) -> bool:
    restitutions = [[x.restitution for x in select_impacts(e.do)] for e in (one, other)]
    return (
        one.crosses != other.crosses
        or not np.array_equal(one.observable.operator.data, other.observable.operator.data)
        or restitutions[0] != restitutions[1]
        or any(switch.laws for switch in select_switches(other.do))
    )


def warn_of_idle_parameters(
    model: Model,
    parameters: Mapping[str, Any],
    assemble: Callable[[Any], EquationsOfMotion],
    names: Sequence[str],
) -> list[str]:
    """Warn of each parameter in `names` that has no effect on a model, and return these names.

    See `difference_model` for the other arguments.
    """
    idle: list[str] = []
    if not names:
        return idle
    base = assemble(model(**parameters))
    for name in names:
        value = float(parameters[name])
        changed = value + (RELATIVE_DIFFERENCE * abs(value) or _DIFFERENCE_FROM_ZERO)
        try:
            is_idle = not has_effect(base, assemble(model(**{**parameters, name: changed})))
        except (BeamdaeError, ArithmeticError, ValueError):
            continue
        if is_idle:
            warn_without_effect(model.name, name)
            idle.append(name)
    return idle


def warn_without_effect(model: str, name: str) -> None:
    """Warn that the derivatives with respect to a parameter of a model are zero."""
    warn_user(
        f"{derivative_call()}: small changes of {name} change no number of {model}, so the "
        "derivatives "
        f"of the model with respect to {name} are zero; either the model does not use {name}, or "
        f"{name} only moves a jump, such as a step of a section along a beam, whose derivative "
        "small differences do not contain (then replace the jump by a smooth transition)."
    )


class _RejectedError(BeamdaeError):
    """The model rejects neighboring values on both sides."""


class _Trial(NamedTuple):
    """Difference with one step, and its accuracy.

    Attributes
    ----------
    difference
        Neighboring models.
    excess
        Ratio of estimated errors to permitted errors; infinity if changes are rounding errors.
    change
        Largest change of a number, relative to the larger of 1 and the numbers of the same kind.
    kinks
        True for the numbers (n_p,) that have a kink, or change without a derivative.
    changes, resolution
        Largest changes of the numbers, and smallest changes that are far above rounding errors,
        (n_p,) each.
    """

    difference: Difference
    excess: float
    change: float
    kinks: Array
    changes: Array
    resolution: Array

    def resolves_kinks(self, other: _Trial) -> bool:
        """Return True if this trial reveals whether kinks of another one are at the value.

        Changes due to a kink at the value are proportional to the step. If they are far above
        rounding errors, numbers that do not change that much jump next to the value, not there.
        """
        kinks = other.kinks
        if kinks.shape != self.resolution.shape:
            return False
        ratio = abs(self.difference.steps[0] / other.difference.steps[0])
        return bool(np.all(ratio * other.changes[kinks] > self.resolution[kinks]))

    @property
    def is_rounded(self) -> bool:
        """Return True if changes of numbers are rounding errors; a larger step is needed."""
        return math.isinf(self.excess)


def _try_step(
    model: Model,
    name: str,
    parameters: Mapping[str, Any],
    base: EquationsOfMotion,
    assemble: Callable[[Any], EquationsOfMotion],
    delta: float,
    stencils: Sequence[Stencil] = _STENCILS,
) -> _Trial:
    """Return the difference with a step `delta` of the parameter, and its accuracy."""
    for stencil in stencils:
        try:
            neighbors = _build_neighbors(model, name, parameters, base, assemble, stencil, delta)
        except BeamdaeError as problem:
            rejection = problem
            continue
        for equations in neighbors:
            _require_same_structure(model.name, name, base, neighbors[0], equations)
        first, steps = neighbors[0], tuple(k * delta for k in stencil.steps)
        is_unchanged = base.structure == first.structure and forms_of(base) == forms_of(first)
        if not is_unchanged and all(e.structure == first.structure for e in neighbors):
            base = with_structure(base, neighbors, steps)
        rounding = rounding_of_numbers(base)
        changes = np.array([e.p - base.p for e in neighbors])
        # Smooth numbers are close to their interpolation; a new structure is interpolated.
        kinks = stencil.find_kinks(changes, rounding)
        excess, change = _estimate_excess(base, neighbors, stencil, delta)
        weights = tuple(w / delta for w in stencil.derivative_weights)
        difference = Difference(name, base, neighbors, weights, steps)
        largest = np.abs(changes).max(axis=0)
        return _Trial(difference, excess, change, kinks, largest, _MIN_RESOLVED_CHANGE * rounding)
    raise _RejectedError(str(rejection))


def _build_neighbors(
    model: Model,
    name: str,
    parameters: Mapping[str, Any],
    base: EquationsOfMotion,
    assemble: Callable[[Any], EquationsOfMotion],
    stencil: Stencil,
    delta: float,
) -> tuple[EquationsOfMotion, ...]:
    """Return the equations at the points of a stencil, with steps `delta` of the parameter."""
    value = float(parameters[name])
    sections = {x.name: x.section for x in beams_of(base.mechanism)}
    with keep_numbers_of_sections(sections):
        return tuple(
            assemble(_build_neighbor(model, {**parameters, name: value + step * delta}))
            for step in stencil.steps
        )


def _estimate_excess(
    base: EquationsOfMotion,
    neighbors: Sequence[EquationsOfMotion],
    stencil: Stencil,
    delta: float,
) -> tuple[float, float]:
    """Return `excess` and `change` of `_Trial`.

    Errors of the numbers and of the start are relative to the largest relative change.
    """
    here, n_p = _numbers_and_start(base), len(base.p)
    changes = np.array([_numbers_and_start(e) - here for e in neighbors])
    change = np.abs(changes).max(axis=0)
    motion = np.repeat([np.abs(x).max(initial=0.0) for x in (base.q0, base.v0)], base.n)
    size = np.concatenate([largest_of_kind(base, np.abs(base.p)), motion])
    of_kind = _ROUNDING_OF_KIND * np.maximum(size, 1.0)
    rounding = _ROUNDING * np.abs(here) + of_kind
    is_significant = change > rounding
    # A parameter with a tiny value may be added to coordinates, such as 1e-8 m to 1 m.
    is_lost = (change > of_kind)[n_p:] & ~is_significant[n_p:]
    is_tiny = delta < _ROUNDING * motion.max(initial=0.0)
    largest = float(np.max(change / np.maximum(size, 1.0)))
    if is_tiny and np.any(is_lost):
        return math.inf, largest
    return stencil.estimate_excess(changes, size, rounding), largest


def _numbers_and_start(equations: EquationsOfMotion) -> Array:
    return np.concatenate([equations.p, equations.q0, equations.v0])


def with_structure(
    base: EquationsOfMotion, neighbors: Sequence[EquationsOfMotion], steps: Sequence[float]
) -> EquationsOfMotion:
    """Return equations at the value of a parameter, with the structure of its neighbors.

    `steps` are the values of the parameter in these models, relative to `base`.
    """
    p = interpolate(steps, [e.p for e in neighbors])
    return replace(neighbors[0], p=p, q0=base.q0, v0=base.v0, breakpoints=base.breakpoints)


def interpolate(steps: Sequence[float], values: Sequence[Array]) -> Array:
    """Return the value at zero of the polynomial through values at `steps`.

    Entries that are equal in all values are exact: tables contain integers from which rows are
    computed, and 4 (1 - 1e-16) would select another row.
    """
    weights = []
    for step in steps:
        others = np.array([x for x in steps if x != step])
        weights.append(float(np.prod(others / (others - step))))
    first = values[0]
    return np.asarray(first + _combine(weights, [x - first for x in values]))


def _build_neighbor(model: Model, parameters: Mapping[str, Any]) -> Any:
    """Return the mechanism; errors of formulas reject parameters as those of parts do."""
    try:
        return model(**parameters)
    except (ArithmeticError, ValueError) as problem:
        raise BeamdaeError(format_exception(problem)) from problem


def difference_values(weights: Sequence[float], values: Iterable[Any]) -> Any:
    """Return the derivative of a function, given its values in neighboring models."""
    # The sum of the weights is zero; differences make derivatives of constants exactly zero.
    first, *others = values
    return _combine(weights[1:], [x - first for x in others])


def _combine(weights: Sequence[float], values: Sequence[Any]) -> Any:
    return sum(w * x for w, x in zip(weights, values, strict=True))


def _require_same_structure(
    model: str,
    name: str,
    base: EquationsOfMotion,
    one: EquationsOfMotion,
    other: EquationsOfMotion,
) -> None:
    """Reject a parameter that changes more than the numbers and the start of a model."""
    advice = "use differences of runs for this parameter"
    if base.q_names != other.q_names or base.lam_names != other.lam_names:
        raise BeamdaeError(
            f"{derivative_call()}: {name} of {model} changes the coordinates or constraints of the "
            f"model; {advice}."
        )
    if len(base.breakpoints) != len(other.breakpoints):
        raise BeamdaeError(
            f"{derivative_call()}: {name} of {model} moves one of several breakpoints of laws at "
            "the "
            f"same time, or changes their number; separate their times, or {advice}."
        )
    if one.structure != other.structure and not (
        has_same_patterns(one.structure, other.structure)
        and has_same_patterns(base.structure, other.structure)
    ):
        raise BeamdaeError(
            f"{derivative_call()}: {name} of {model} changes the structure of the equations; "
            f"{advice}."
        )
    if forms_of(one) != forms_of(other):
        raise BeamdaeError(
            f"{derivative_call()}: {name} of {model} changes the form of an observed column from "
            f"one value next to {name} to another; {advice}."
        )


def forms_of(equations: EquationsOfMotion) -> list[tuple[int, int]]:
    """Return `form_of` the observables of all columns and events."""
    terms = (*equations.observables, *(x.observable for x in equations.events))
    return [form_of(x) for x in terms]


def form_of(observable: Observable) -> tuple[int, int]:
    """Return the numbers of coordinates and of constants in the formula of an observable.

    CasADi simplifies 1 q to q, 2 q to q + q and 0 q to 0, without a constant, but not 1.001 q.
    """
    return observable.operator.shape[0], observable.data.stop - observable.data.start


def rounding_of_numbers(equations: EquationsOfMotion) -> Array:
    """Return an upper bound of the rounding errors of each number in p, (n_p,)."""
    sizes = np.abs(equations.p)
    of_kind = np.maximum(largest_of_kind(equations, sizes), 1.0)
    return _ROUNDING * sizes + _ROUNDING_OF_KIND * of_kind


def largest_of_kind(equations: EquationsOfMotion, sizes: Array) -> Array:
    """Return for each of the sizes of p the largest one over the copies of its kernel."""
    sizes = sizes.copy()
    terms: list[ForceTerm | ConstraintTerm] = [*equations.forces, *equations.joints]
    for term in terms:
        numbers = sizes[term.data].reshape((-1, term.count), order="F")
        sizes[term.data] = np.broadcast_to(numbers.max(axis=1, keepdims=True), numbers.shape).ravel(
            order="F"
        )
    return sizes
