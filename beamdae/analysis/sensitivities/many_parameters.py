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
        for x in CENTRAL.steps:
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
