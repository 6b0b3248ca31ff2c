"""Models around the values of many parameters, with few builds of the model.

Building a model takes milliseconds, a large part of a short run. Parameters that affect different
numbers, such as the thicknesses of a beam at different points, are therefore changed together
(Curtis, Powell & Reid, IMA J. Appl. Math. 13 (1974) 117, doi:10.1093/imamat/13.1.117).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from beamdae.analysis.sensitivities.neighbors import (
    CENTRAL,
    RELATIVE_DIFFERENCE,
    Difference,
    NumericModel,
    Trial,
    build_neighbor,
    difference_model,
    first_difference,
    forms_of,
    has_same_operators,
    numbers_and_start,
    sizes_and_rounding,
    try_step,
    warn_without_effect,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError

Array = np.ndarray

# Parameters are searched for those that affect the same numbers if they are at least this many.
_MIN_SEARCHED = 4
# Largest error of the sum of the derivatives along a common change of all parameters, relative to
# the sum of their magnitudes.
_MAX_COMMON_ERROR = 1e-6


# The latest parameters of a model function with the entries that they affect, (k, size), or None if
# no groups were found: searches of an optimum differentiate the same parameters repeatedly.
_latest_effects: WeakKeyDictionary[Callable[..., Any], dict[Any, Array | None]]
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
        rows = _Changes(model, names, base, assemble).differentiate()
    if rows is None:
        return {x: difference_model(model, x, base, assemble) for x in names}
    result = {}
    for name, row in zip(names, rows, strict=True):
        if not np.any(row):
            warn_without_effect(model.name, name)
        delta = first_difference(float(model.parameters[name]))
        models = tuple(_move(base, x * delta * row) for x in CENTRAL.steps)
        result[name] = Difference(models, CENTRAL, delta, name, base, is_regular=True)
    return result


class _DependentError(BeamdaeError):
    """No parameters can be changed together; each is differenced alone."""


class _Changes:
    """Models with changed parameters; each is reduced to the vector (p, q0, v0)."""

    def __init__(
        self,
        model: NumericModel,
        names: Sequence[str],
        base: EquationsOfMotion,
        assemble: Callable[[Any], EquationsOfMotion],
    ) -> None:
        self.model, self._names, self._base, self._assemble = model, tuple(names), base, assemble
        self._values = np.array([float(model.parameters[x]) for x in names])
        differences = np.array([first_difference(x) for x in self._values])
        self._sizes = differences / RELATIVE_DIFFERENCE
        self.here = numbers_and_start(base)

    def differentiate(self) -> Array | None:
        """Return the derivatives (k, size) by groups, or None if there are no groups."""
        shape = len(self._names), len(self.here)
        known, key = _latest_effects.setdefault(self.model.build, {}), (self._names, shape)
        if key in known:
            masks = known[key]
            if masks is None:
                return None
            with suppress(BeamdaeError):
                return self._differentiate_groups(masks)
        derivatives = masks = None
        with suppress(BeamdaeError):
            masks = self._find_affected()
            derivatives = self._differentiate_groups(masks)
        # Unless the search succeeds, it is not repeated.
        known[key] = None if derivatives is None else masks
        return derivatives

    def _try_change(self, shares: Array) -> Trial:
        """Return the models at relative changes by shares * x about x = 0."""

        def change(x: float) -> dict[str, float]:
            values = self._values + x * shares * self._sizes
            return {self._names[k]: float(values[k]) for k in np.flatnonzero(shares)}

        name = ", ".join(self._names)
        trial = try_step(
            self.model, name, change, self._base, self._assemble, RELATIVE_DIFFERENCE, (CENTRAL,)
        )
        is_independent = all(has_same_operators(self._base, e) for e in trial.difference.models)
        if not (is_independent and is_regular(trial.difference, self._base)):
            raise _DependentError
        return trial

    def _find_affected(self) -> Array:
        """Return True (k, size) where a parameter affects an entry.

        Raises
        ------
        BeamdaeError
            If the model rejects a change, or a parameter changes the number of entries.
        """
        masks = []
        for name, value, size in zip(self._names, self._values, self._sizes, strict=True):
            values = {name: float(value + RELATIVE_DIFFERENCE * size)}
            changed = numbers_and_start(self._assemble(build_neighbor(self.model, values)))
            if len(changed) != len(self.here):
                raise _DependentError
            masks.append(changed != self.here)
        return np.array(masks)

    def _differentiate_groups(self, masks: Array) -> Array:
        """Return the derivatives (k, size) with parameters changed in groups.

        Raises
        ------
        _DependentError
            If they are not accurate.
        """
        groups, count = _group_disjoint(masks), len(masks)
        result = np.zeros(masks.shape)
        for group in groups:
            shares = np.zeros(count)
            shares[group] = 1.0
            trial = self._try_change(shares)
            if not trial.is_smooth:
                raise _DependentError
            change = trial.difference.along(numbers_and_start)
            result[group] = np.where(masks[group], change, 0.0) / self._sizes[group, None]
        # The derivatives add up along a common change of all parameters.
        shares = np.random.default_rng(0).choice([-1.0, -0.5, 0.5, 1.0], count)
        common = self._try_change(shares).difference
        parts = result * (shares * self._sizes)[:, None]
        error = np.abs(common.along(numbers_and_start) - parts.sum(axis=0))
        rounding = sizes_and_rounding(self._base)[1] / RELATIVE_DIFFERENCE
        if np.any(error > _MAX_COMMON_ERROR * np.abs(parts).sum(axis=0) + rounding):
            raise _DependentError
        return result


def is_regular(difference: Difference, base: EquationsOfMotion) -> bool:
    """Return True if neighboring models differ from `base` only in their numbers and start."""
    return difference.is_regular or all(
        e.structure == base.structure
        and forms_of(e) == forms_of(base)
        and e.breakpoints == base.breakpoints
        for e in difference.models
    )


def _move(base: EquationsOfMotion, change: Array) -> EquationsOfMotion:
    """Return equations with changed numbers and start."""
    p, q0, v0 = np.split(numbers_and_start(base) + change, [len(base.p), len(base.p) + base.n])
    return replace(base, p=p, q0=q0, v0=v0)


def _group_disjoint(masks: Array) -> list[list[int]]:
    """Return groups of rows of masks that do not overlap, by a greedy search.

    Raises
    ------
    _DependentError
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
        raise _DependentError
    return groups
