"""Derivatives of a model with respect to many parameters, with few builds of the model.

Building a model takes milliseconds, a large part of a short run. Parameters that affect different
numbers, such as the thicknesses of a beam at different points, are therefore changed together
(Curtis, Powell & Reid, IMA J. Appl. Math. 13 (1974) 117, doi:10.1093/imamat/13.1.117).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple, cast
from weakref import WeakKeyDictionary

import numpy as np

from beamdae.analysis.sensitivities.model_differences import (
    FOUR_NEIGHBORS,
    RELATIVE_DIFFERENCE,
    TWO_NEIGHBORS,
    Stencil,
    difference_values,
    largest_of_kind,
    rounding_of_numbers,
    warn_of_idle_parameters,
)
from beamdae.analysis.sensitivities.requested_starts import start_adds_velocities
from beamdae.beams.beam import beams_of
from beamdae.beams.section_samples import keep_numbers_of_sections
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable
from beamdae.errors import BeamdaeError, format_exception
from beamdae.model_functions import Model

Array = np.ndarray

# Up to this number of groups of parameters that are changed together, differences are of fourth
# order.
_MAX_FOURTH_ORDER_GROUPS = 20
# Difference of second order, relative to the values of parameters, with relative errors near 1e-10.
_SECOND_ORDER_DIFFERENCE = 1e-5
# Magnitude of parameters whose value is zero, for their differences.
_SIZE_AT_ZERO = 0.1
# Parameters are searched for those that affect the same numbers if they are at least this many.
_MIN_SEARCHED = 4
# The search ends if no parts of a division into this number of parts can be changed together.
_MAX_DENSE_PARTS = 8
# Largest error of the sum of the derivatives along a common change of all parameters, relative to
# the sum of their magnitudes, and this change, relative to their values.
_MAX_COMMON_ERROR = 1e-6
_COMMON_DIFFERENCE = 1e-4
# Rounding errors of initial values and operators, relative to the larger of 1 and their values.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class FlatModel:
    """Model as a function of single numbers: floats, and the entries of lists of floats.

    Attributes
    ----------
    model
        Model function.
    parameters
        Values of all its parameters.
    entries
        Name of the parameter and index of the entry, None for a float, by name of the number, such
        as "E" and "thickness[3]".
    """

    model: Model
    parameters: Mapping[str, Any]
    entries: Mapping[str, tuple[str, int | None]]

    @property
    def name(self) -> str:
        """Name of the model function."""
        return self.model.name

    @property
    def values(self) -> dict[str, float]:
        """Values of the numbers."""
        return {
            name: float(self.parameters[key] if k is None else self.parameters[key][k])
            for name, (key, k) in self.entries.items()
        }

    def __call__(self, **values: float) -> Any:
        """Return the mechanism for other values of some of the numbers."""
        return self.model(**self.change(values))

    def change(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return all parameters of the model for other values of some of the numbers."""
        parameters = dict(self.parameters)
        for name, value in values.items():
            key, k = self.entries[name]
            if k is None:
                parameters[key] = value
            else:
                numbers = list(parameters[key])
                numbers[k] = value
                parameters[key] = type(self.parameters[key])(numbers)
        return parameters


@dataclass(frozen=True)
class NumberDerivatives:
    """Derivatives of equations of motion with respect to the numbers of a model.

    Attributes
    ----------
    p
        Derivatives of the numbers in the equations, (k, n_p).
    q0, v0
        Derivatives of the initial coordinates and velocities, (k, n) each.
    operators
        Derivatives of the non-zeros of `Observable.operator` of all observables, (k, nnz).
    irregular
        Indices of the numbers without derivatives, see `differentiate_numbers`; their rows are
        zero.
    """

    p: Array
    q0: Array
    v0: Array
    operators: Array
    irregular: tuple[int, ...]


class _Effects(NamedTuple):
    """Names of numbers, and entries that they affect, (k, size); None if no groups were found."""

    names: tuple[str, ...]
    masks: Array | None


# By model function: searches of an optimum differentiate the same numbers repeatedly.
_latest_effects: WeakKeyDictionary[Callable[..., Any], _Effects] = WeakKeyDictionary()


class _IrregularError(Exception):
    """A neighboring model that needs the careful treatment of `difference_model`."""


def differentiate_numbers(
    model: FlatModel,
    base: EquationsOfMotion,
    assemble: Callable[[Any], EquationsOfMotion],
    time: Array,
) -> NumberDerivatives:
    """Return the derivatives of the equations of motion with respect to all numbers of a model.

    Numbers are irregular if the model rejects a neighboring value, if the neighbor differs from
    `base` in its structure or breakpoints, if drivers move at the start, at a kink, or if the step
    of the differences does not suit the scale of the number.

    Parameters
    ----------
    model
        Model function of single numbers.
    base
        Equations at the values of the numbers.
    assemble
        Function that returns the equations of a mechanism.
    time
        (t, branch) of the start.
    """
    differencing = _Differencing(model, base, assemble, time)
    derivatives: Array | None = None
    irregular: list[int] = []
    with suppress(_IrregularError):
        derivatives = _differentiate_together(differencing, model)
    if derivatives is None:
        singles = [[k] for k in range(len(differencing.values))]
        derivatives, irregular = differencing.differentiate(singles, None)
    ends = np.cumsum([len(base.p), base.n, base.n])
    differencing.warn_without_effect(derivatives, irregular)
    p, q0, v0, operators = np.split(derivatives, ends, axis=1)
    return NumberDerivatives(p, q0, v0, operators, tuple(irregular))


def _differentiate_together(differencing: _Differencing, model: FlatModel) -> Array | None:
    """Return the derivatives with numbers changed in groups, or None if there are no groups."""
    names, function = tuple(model.entries), model.model.build
    if len(names) < _MIN_SEARCHED:
        return None
    known = _latest_effects.get(function)
    if known is not None and known.names == names:
        if known.masks is None:
            return None
        if known.masks.shape == differencing.shape:
            derivatives = differencing.differentiate_groups(known.masks)
            if derivatives is not None:
                return derivatives
    masks = _find_affected(differencing)
    derivatives = None if masks is None else differencing.differentiate_groups(masks)
    # Unless the search succeeds, it is not repeated.
    _latest_effects[function] = _Effects(names, None if derivatives is None else masks)
    return derivatives


class _Differencing:
    """Models with changed numbers; each is reduced to the vector (p, q0, v0, operators)."""

    def __init__(
        self,
        model: FlatModel,
        base: EquationsOfMotion,
        assemble: Callable[[Any], EquationsOfMotion],
        time: Array,
    ) -> None:
        self._model, self._base, self._assemble, self._time = model, base, assemble, time
        self._sections = {x.name: x.section for x in beams_of(base.mechanism)}
        self.values = np.array(list(model.values.values()))
        self.sizes = np.where(self.values != 0.0, np.abs(self.values), _SIZE_AT_ZERO)
        self.here = _numbers_of(base)
        count = len(base.p)
        others = _ROUNDING * np.maximum(1.0, np.abs(self.here[count:]))
        self._rounding = np.concatenate([rounding_of_numbers(base), others])
        of_kind = largest_of_kind(base, np.abs(base.p))
        self._magnitudes = np.concatenate([of_kind, np.maximum(1.0, np.abs(self.here[count:]))])

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of parameters and of entries."""
        return len(self.values), len(self.here)

    def evaluate(self, changes: Array) -> Array:
        """Return (p, q0, v0, operators) after changes of the numbers."""
        names, values = self._model.entries, self.values + changes
        changed = {
            name: value
            for name, value, change in zip(names, values.tolist(), changes, strict=True)
            if change != 0.0
        }
        try:
            with keep_numbers_of_sections(self._sections):
                equations = self._assemble(self._model(**changed))
        except (BeamdaeError, ArithmeticError, ValueError) as problem:
            raise _IrregularError(format_exception(problem)) from problem
        base = self._base
        if not (
            equations.structure == base.structure
            and equations.q_names == base.q_names
            and equations.lam_names == base.lam_names
            and equations.breakpoints == base.breakpoints
            and all(map(_have_same_pattern, equations.observables, base.observables))
        ):
            raise _IrregularError
        if start_adds_velocities(equations, self._time):
            raise _IrregularError
        return _numbers_of(equations)

    def differentiate(
        self, groups: Sequence[Sequence[int]], masks: Array | None
    ) -> tuple[Array, list[int]]:
        """Return the derivatives (k, size) with respect to numbers that are changed in groups.

        Also return the indices of irregular numbers, whose rows are zero.

        Parameters
        ----------
        groups
            Indices of the numbers that are changed together.
        masks
            True where a number affects an entry, (k, size); None if each group is a single number.
        """
        if len(groups) <= _MAX_FOURTH_ORDER_GROUPS:
            stencil, relative = FOUR_NEIGHBORS, RELATIVE_DIFFERENCE
        else:
            stencil, relative = TWO_NEIGHBORS, _SECOND_ORDER_DIFFERENCE
        sizes = relative * self.sizes
        result = np.zeros((len(self.values), len(self.here)))
        irregular: list[int] = []
        for group in groups:
            delta = np.zeros(len(self.values))
            delta[group] = sizes[group]
            try:
                change = self._difference(delta, stencil)
            except _IrregularError:
                irregular += group
                continue
            for k in group:
                here = change if masks is None else np.where(masks[k], change, 0.0)
                result[k] = here / sizes[k]
        return result, irregular

    def differentiate_groups(self, masks: Array) -> Array | None:
        """Return the derivatives with numbers changed in groups; None if they are not accurate."""
        singles = [[k] for k in range(len(masks))]
        groups = _group_disjoint(singles, masks)
        if groups == singles:
            return None
        derivatives, irregular = self.differentiate(groups, masks)
        return None if irregular or not self._is_verified(derivatives) else derivatives

    def _difference(self, delta: Array, stencil: Stencil) -> Array:
        """Return the derivative along `delta`."""
        changes = np.array([self.evaluate(step * delta) - self.here for step in stencil.steps])
        excess = stencil.estimate_excess(changes, self._magnitudes, self._rounding)
        if excess > stencil.max_excess or np.any(stencil.find_kinks(changes, self._rounding)):
            raise _IrregularError  # The step does not suit the scale of the parameter.
        return np.asarray(difference_values(stencil.derivative_weights, changes))

    def warn_without_effect(self, derivatives: Array, irregular: Sequence[int]) -> None:
        """Warn of numbers whose derivatives are zero."""
        zero = set(np.flatnonzero(~np.any(derivatives, axis=1)).tolist()) - set(irregular)
        names = [name for k, name in enumerate(self._model.entries) if k in zero]
        # Name and call of a flat model are those of a model.
        model, values = cast(Model, self._model), self._model.values
        warn_of_idle_parameters(model, values, self._assemble, names)

    def _is_verified(self, derivatives: Array) -> bool:
        """Return True if the derivatives add up along a common change of all numbers."""
        shares = np.random.default_rng(0).choice([-1.0, -0.5, 0.5, 1.0], len(self.values))
        delta = _COMMON_DIFFERENCE * shares * self.sizes
        ahead, behind = self.evaluate(delta), self.evaluate(-delta)
        parts = derivatives * delta[:, None]
        error = np.abs(0.5 * (ahead - behind) - parts.sum(axis=0))
        return bool(np.all(error <= _MAX_COMMON_ERROR * np.abs(parts).sum(axis=0) + self._rounding))


def _numbers_of(equations: EquationsOfMotion) -> Array:
    operators = (x.operator.data for x in equations.observables)
    return np.concatenate([equations.p, equations.q0, equations.v0, *operators])


def _have_same_pattern(one: Observable, other: Observable) -> bool:
    """Return True if two observables differ only in numbers."""
    x, y = one.operator, other.operator
    return (
        one.data == other.data
        and x.shape == y.shape
        and np.array_equal(x.indptr, y.indptr)
        and np.array_equal(x.indices, y.indices)
    )


def _find_affected(differencing: _Differencing) -> Array | None:
    """Return the entries that each number affects, (k, size), by bisection.

    Sets of numbers are halved repeatedly. Halves of sets that affect different entries are changed
    together. Return None if this saves no builds.
    """
    count, size = len(differencing.values), len(differencing.here)
    sets, masks = [list(range(count))], [np.ones(size, bool)]
    # Equal relative changes would not change ratios, such as those of the stiffnesses of a beam.
    relative = differencing.sizes * np.random.default_rng(0).uniform(0.5, 1.0, count)
    while any(len(x) > 1 for x in sets):
        parts: list[list[int]] = []
        parents: list[int] = []
        for parent, members in enumerate(sets):
            half = (len(members) + 1) // 2
            for part in filter(None, (members[:half], members[half:])):
                parts.append(part)
                parents.append(parent)
        groups = _group_disjoint(parts, np.array([masks[k] for k in parents]))
        if len(parts) >= _MAX_DENSE_PARTS and len(groups) == len(parts):
            return None
        part_masks = np.zeros((len(parts), size), bool)
        for group in groups:
            steps = np.zeros(count)
            for k in group:
                steps[parts[k]] = RELATIVE_DIFFERENCE * relative[parts[k]]
            is_changed = differencing.evaluate(steps) != differencing.here
            for k in group:
                part_masks[k] = is_changed & masks[parents[k]]
        sets, masks = parts, list(part_masks)
    order = np.argsort([x[0] for x in sets])
    return np.array(masks)[order]


def _group_disjoint(members: Sequence[Any], masks: Array) -> list[list[int]]:
    """Return groups of indices of members whose masks do not overlap, by a greedy search."""
    groups: list[list[int]] = []
    unions: list[Array] = []
    for k in range(len(members)):
        for group, union in zip(groups, unions, strict=True):
            if not np.any(union & masks[k]):
                group.append(k)
                union |= masks[k]
                break
        else:
            groups.append([k])
            unions.append(masks[k].copy())
    return groups
