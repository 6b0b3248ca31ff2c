"""Derivatives of a model with respect to many parameters, with few builds of the model.

Building a model takes milliseconds, a large part of a short run. Parameters that affect different
numbers, such as the thicknesses of a beam at different points, are therefore changed together
(Curtis, Powell & Reid, IMA J. Appl. Math. 13 (1974) 117, doi:10.1093/imamat/13.1.117).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from beamdae.analysis.sensitivities.neighbors import (
    CENTRAL,
    RELATIVE_DIFFERENCE,
    TWO_NEIGHBORS,
    Difference,
    Neighbors,
    Stencil,
    Trial,
    build_neighbor,
    difference_model,
    first_difference,
    numbers_and_start,
    sizes_and_rounding,
    try_step,
    warn_without_effect,
)
from beamdae.analysis.sensitivities.start_derivatives import start_adds_velocities
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable
from beamdae.errors import BeamdaeError
from beamdae.model_functions import Model

Array = np.ndarray

# Change of parameters whose value is zero, relative to that of others.
_SIZE_AT_ZERO = 0.1
# Parameters are searched for those that affect the same numbers if they are at least this many; the
# search ends if no two of the other number can be changed together.
_MIN_SEARCHED, _MAX_DENSE = 4, 8
# Largest error of the sum of the derivatives along a common change of all parameters, relative to
# the sum of their magnitudes, and difference of this change.
_MAX_COMMON_ERROR = 1e-6
_COMMON_DIFFERENCE = 1e-2
# Rounding errors of operators, relative to the larger of 1 and their values.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class FlatModel:
    """Model as a function of single numbers: floats, and the entries of lists of floats.

    Attributes
    ----------
    whole
        Model function with the values of its parameters.
    entries
        Name of the parameter and index of the entry, None for a float, by name of the number, such
        as "E" and "thickness[3]".
    """

    whole: Model
    entries: Mapping[str, tuple[str, int | None]]

    @property
    def name(self) -> str:
        """Name of the model function."""
        return self.whole.name

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the numbers."""
        values = self.whole.parameters
        return {
            name: float(values[key] if k is None else values[key][k])
            for name, (key, k) in self.entries.items()
        }

    def unflatten(self, numbers: Iterable[Any]) -> dict[str, Any]:
        """Return numbers by name of the parameter; a tuple for each list."""
        result: dict[str, Any] = {}
        for (key, k), number in zip(self.entries.values(), numbers, strict=True):
            result[key] = number if k is None else (*result.get(key, ()), number)
        return result

    def __call__(self, **values: float) -> Any:
        """Return the mechanism for other values of some of the numbers."""
        return self.whole(**self.change(values))

    def change(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return all parameters of the model for other values of some of the numbers."""
        parameters = dict(self.whole.parameters)
        for name, value in values.items():
            key, k = self.entries[name]
            if k is None:
                parameters[key] = value
            else:
                numbers = list(parameters[key])
                numbers[k] = value
                parameters[key] = type(parameters[key])(numbers)
        return parameters


@dataclass(frozen=True)
class _Line:
    """Model on a line of numbers, with the parameter x; `slopes` are their derivatives."""

    flat: FlatModel
    slopes: Mapping[str, float]

    @property
    def name(self) -> str:
        return self.flat.name

    @property
    def parameters(self) -> dict[str, float]:
        return {"x": 0.0}

    def __call__(self, **values: float) -> Any:
        here, x = self.flat.parameters, values["x"]
        return self.flat(**{name: here[name] + y * x for name, y in self.slopes.items() if y})


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

    def contract(
        self,
        by_p: Array,
        by_operators: Sequence[Array],
        by_q0: Array | float = 0.0,
        by_v0: Array | float = 0.0,
    ) -> Array:
        """Return the gradient (k,) of a function by the numbers, given its derivatives."""
        result = self.operators @ np.concatenate([np.zeros(0), *by_operators])
        for rows, by in ((self.p, by_p), (self.q0, by_q0), (self.v0, by_v0)):
            result += rows @ np.broadcast_to(by, rows.shape[1])
        return np.asarray(result)


# The latest numbers of a model function with the entries that they affect, (k, size), or None if no
# groups were found: searches of an optimum differentiate the same numbers repeatedly.
_latest_effects: WeakKeyDictionary[Callable[..., Any], dict[Any, Array | None]]
_latest_effects = WeakKeyDictionary()


def differentiate_numbers(
    model: FlatModel,
    base: EquationsOfMotion,
    assemble: Callable[[Any], EquationsOfMotion],
    time: Array,
) -> NumberDerivatives:
    """Return the derivatives of the equations of motion with respect to all numbers of a model.

    Numbers are irregular if a neighboring model differs from `base` in its structure or
    breakpoints, or drivers move at the start.

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
    numbers = _Numbers(model, base, assemble, time)
    derivatives, irregular = _differentiate_together(numbers), list[int]()
    if derivatives is None:
        derivatives = np.zeros(numbers.shape)
        for k, name in enumerate(model.entries):
            difference = difference_model(model, name, base, assemble)
            if numbers.is_regular(difference):
                derivatives[k] = difference.along(_numbers_of)
            else:
                irregular.append(k)
    else:
        for name, row in zip(model.entries, derivatives, strict=True):
            if not np.any(row):
                warn_without_effect(model.name, name)
    ends = np.cumsum([len(base.p), base.n, base.n])
    p, q0, v0, operators = np.split(derivatives, ends, axis=1)
    return NumberDerivatives(p, q0, v0, operators, tuple(irregular))


def difference_numbers(
    model: FlatModel, base: EquationsOfMotion, assemble: Callable[[Any], EquationsOfMotion]
) -> dict[str, Difference]:
    """Return models around the value of each number, by its name, without observables.

    If groups of numbers act independently, these models contain their linear effects.
    """
    numbers, n_p = _Numbers(model, base, assemble, np.zeros(2)), len(base.p)
    rows = None if base.configurations is not None else _differentiate_together(numbers)
    if rows is None:
        return {x: difference_model(model, x, base, assemble) for x in model.entries}
    result = {}
    for name, value, row in zip(model.entries, model.parameters.values(), rows, strict=True):
        near = Neighbors((), CENTRAL, first_difference(value))
        moved = [(base.p + x * row[:n_p], base.q0 + x * row[n_p:][: base.n]) for x in near.steps]
        models = tuple(replace(base, p=p, q0=q0) for p, q0 in moved)
        result[name] = Difference(models, CENTRAL, near.delta, name, base)
    return result


def _differentiate_together(numbers: _Numbers) -> Array | None:
    """Return the derivatives with numbers changed in groups, or None if there are no groups."""
    names, function = tuple(numbers.model.entries), numbers.model.whole.build
    if len(names) < _MIN_SEARCHED:
        return None
    known, key = _latest_effects.setdefault(function, {}), (names, numbers.shape)
    if key in known:
        masks = known[key]
        if masks is None:
            return None
        with suppress(BeamdaeError):
            return numbers.differentiate_groups(masks)
    derivatives = masks = None
    with suppress(BeamdaeError):
        masks = numbers.find_affected()
        derivatives = numbers.differentiate_groups(masks)
    # Unless the search succeeds, it is not repeated.
    known[key] = None if derivatives is None else masks
    return derivatives


class _Numbers:
    """Models with changed numbers; each is reduced to the vector (p, q0, v0, operators)."""

    def __init__(
        self,
        model: FlatModel,
        base: EquationsOfMotion,
        assemble: Callable[[Any], EquationsOfMotion],
        time: Array,
    ) -> None:
        self.model, self._base, self._assemble, self._time = model, base, assemble, time
        self._values = np.array(list(model.parameters.values()))
        self._sizes = np.where(self._values != 0.0, np.abs(self._values), _SIZE_AT_ZERO)
        self.here = _numbers_of(base)
        rounding, operators = sizes_and_rounding(base)[1], self.here[len(base.p) + 2 * base.n :]
        operators = _ROUNDING * np.maximum(1.0, np.abs(operators))
        # Errors of differences over the relative change of the verification.
        self._rounding = np.append(rounding, operators) / (
            TWO_NEIGHBORS.steps[1] * _COMMON_DIFFERENCE
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of parameters and of entries."""
        return len(self._values), len(self.here)

    def _try_change(self, shares: Array, stencil: Stencil, delta: float) -> Trial:
        """Return the models at relative changes of the numbers by shares * x about x = 0."""
        line = _Line(self.model, dict(zip(self.model.entries, shares * self._sizes, strict=True)))
        trial = try_step(line, "x", self._base, self._assemble, delta, (stencil,))
        if not self.is_regular(trial.difference):
            raise BeamdaeError(f"{self.model.name}: the numbers cannot be changed together.")
        return trial

    def is_regular(self, difference: Difference) -> bool:
        """Return True if the neighboring models only differ in their numbers and start."""
        base = self._base
        return difference.base is base and all(
            e.structure == base.structure
            and e.breakpoints == base.breakpoints
            and all(map(_have_same_pattern, e.observables, base.observables))
            and not start_adds_velocities(e, self._time)
            for e in difference.models
        )

    def find_affected(self) -> Array:
        """Return True where a number affects an entry, (k, size).

        Raises
        ------
        BeamdaeError
            If the model rejects a change, or no numbers can be changed together.
        """
        masks = np.zeros(self.shape, bool)
        for k, name in enumerate(self.model.entries):
            value = float(self._values[k] + RELATIVE_DIFFERENCE * self._sizes[k])
            changed = _numbers_of(self._assemble(build_neighbor(self.model, name, value)))
            if len(changed) != len(self.here):
                raise BeamdaeError(f"{self.model.name}: {name} changes the structure.")
            masks[k] = changed != self.here
            if k + 1 == _MAX_DENSE:
                _group_disjoint(masks[:_MAX_DENSE])
        return masks

    def differentiate_groups(self, masks: Array) -> Array:
        """Return the derivatives (k, size) with numbers changed in groups; see `find_affected`.

        Raises
        ------
        BeamdaeError
            If they are not accurate.
        """
        groups, count = _group_disjoint(masks), len(masks)
        result = np.zeros(self.shape)
        for group in groups:
            shares = np.zeros(count)
            shares[group] = 1.0
            trial = self._try_change(shares, CENTRAL, RELATIVE_DIFFERENCE)
            if not trial.is_smooth:
                raise BeamdaeError(f"{self.model.name}: the change does not suit the numbers.")
            change = trial.difference.along(_numbers_of)
            result[group] = np.where(masks[group], change, 0.0) / self._sizes[group, None]
        # The derivatives add up along a common change of all numbers.
        shares = np.random.default_rng(0).choice([-1.0, -0.5, 0.5, 1.0], count)
        common = self._try_change(shares, TWO_NEIGHBORS, _COMMON_DIFFERENCE).difference
        parts = result * (shares * self._sizes)[:, None]
        error = np.abs(common.along(_numbers_of) - parts.sum(axis=0))
        if np.any(error > _MAX_COMMON_ERROR * np.abs(parts).sum(axis=0) + self._rounding):
            raise BeamdaeError(f"{self.model.name}: the numbers do not act independently.")
        return result


def _numbers_of(equations: EquationsOfMotion) -> Array:
    operators = (x.operator.data for x in equations.observables)
    return np.concatenate([numbers_and_start(equations), *operators])


def _have_same_pattern(one: Observable, other: Observable) -> bool:
    """Return True if two observables differ only in numbers."""
    x, y = one.operator, other.operator
    return (
        one.data == other.data
        and x.shape == y.shape
        and np.array_equal(x.indptr, y.indptr)
        and np.array_equal(x.indices, y.indices)
    )


def _group_disjoint(masks: Array) -> list[list[int]]:
    """Return groups of rows of masks that do not overlap, by a greedy search.

    Raises
    ------
    BeamdaeError
        If all of them overlap.
    """
    groups: list[list[int]] = []
    unions: list[Array] = []
    for k, mask in enumerate(masks):
        for group, union in zip(groups, unions, strict=True):
            if not np.any(union & mask):
                group.append(k)
                union |= mask
                break
        else:
            groups.append([k])
            unions.append(mask.copy())
    if len(groups) == len(masks):
        raise BeamdaeError("All numbers of the model affect the same equations.")
    return groups
