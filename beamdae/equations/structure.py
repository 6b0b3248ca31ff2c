"""Parameter-independent structure of equations of motion: kernels and their operators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar, cast

import numpy as np
import scipy.sparse as sp

from beamdae.bounded_cache import bounded_cache
from beamdae.symbolic.constraint_kernel import ConstraintKernel
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.sums.kernel_sums import SumPlan
from beamdae.symbolic.sums.rotations import LocalRotation


class CacheOwner(Protocol):
    """Object that caches the data derived from it."""

    @property
    def _derived(self) -> dict[Any, Any]: ...


Array = np.ndarray
P = ParamSpec("P")
T = TypeVar("T")
K = TypeVar("K", bound=CacheOwner)

# Largest total number of local coordinates in the terms of the structures cached for later models.
# With everything derived from them, they take 2 to 6 kB each after an equilibrium and 10 kB after a
# run. An equilibrium caches those with and without its loads, and with its resultants.
_MAX_CACHED_COORDINATES = 16_000
# Larger structures are not cached: their sums need memory in proportion to their size, while the
# time to build them becomes negligible compared with the run.
_MAX_COORDINATES = 5000


@dataclass(frozen=True, eq=False)
class ForceTerm:
    """Copies of one force kernel on the global coordinates.

    Attributes
    ----------
    kernel
        Kernel of one copy.
    operator
        Maps the global coordinates to the local coordinates of all copies; with a `rotation`, it
        only selects the global coordinates that the rotation transforms.
    rotation
        Rotation from the selected coordinates to local coordinates, or None.
    data
        Slice of p that contains, for each copy, the numbers of the kernel and of the rotation.
    count
        Number of copies.
    rows
        Operator that selects the multipliers on which the force depends; None if it depends on
        none.
    """

    kernel: ForceKernel
    operator: sp.csr_array
    rotation: LocalRotation | None
    data: slice
    count: int
    rows: sp.csr_array | None = None


@dataclass(frozen=True, eq=False)
class ConstraintTerm:
    """Copies of one constraint kernel on the global coordinates.

    `operator` maps the global coordinates to the local coordinates of all copies, `rows` selects
    their constraints from g, `data` is the slice of p with their numbers, and `count` is the number
    of copies.
    """

    kernel: ConstraintKernel
    operator: sp.csr_array
    data: slice
    rows: sp.csr_array
    count: int


@dataclass(frozen=True)
class Structure:
    """Equations of motion without their numbers p.

    Two structures are equal if they have the same sizes, kernels, slices, rotations and operators.

    Attributes
    ----------
    n, m
        Numbers of coordinates and constraints.
    forces, joints
        Terms of F and of g.
    states
        Indices of the coordinates of first-order states x: their rows of F are x' - f, without
        inertia.
    correction_factors
        Diagonal P of the corrections q' = v - P G^T mu by joints, (n,).
    """

    n: int = field(compare=False)
    m: int = field(compare=False)
    forces: tuple[ForceTerm, ...] = field(compare=False, repr=False)
    joints: tuple[ConstraintTerm, ...] = field(compare=False, repr=False)
    correction_factors: Array = field(compare=False, repr=False)
    states: tuple[int, ...] = field(default=(), compare=False)
    _key: Any = field(init=False, repr=False)
    _derived: dict[Any, Any] = field(default_factory=dict, init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        terms = (*self.forces, *self.joints)
        key = (
            self.n,
            self.m,
            self.states,
            self.correction_factors.tobytes(),
            *(comparison_key(value) for term in terms for value in vars(term).values()),
        )
        object.__setattr__(self, "_key", key)


def comparison_key(value: Any) -> Any:
    """Return a hashable key for a field of a term; kernels compare by identity."""
    if isinstance(value, slice):
        return value.start, value.stop
    if isinstance(value, sp.csr_array):
        arrays = (value.indptr, value.indices, value.data)
        return value.shape, *((array.dtype.char, array.tobytes()) for array in arrays)
    return value if isinstance(value, int | LocalRotation | None) else id(value)


def has_same_patterns(one: Structure, other: Structure) -> bool:
    """Return True if structures are equal except for weights of operators and of corrections."""

    def pattern_key(structure: Structure) -> Any:
        terms = (*structure.forces, *structure.joints)
        values = (value for term in terms for value in vars(term).values())
        keys = (
            comparison_key(_with_unit_weights(x) if isinstance(x, sp.csr_array) else x)
            for x in values
        )
        return structure.n, structure.m, structure.states, *keys

    return one == other or pattern_key(one) == pattern_key(other)


def _with_unit_weights(operator: sp.csr_array) -> sp.csr_array:
    # Weights equal to one are evaluated differently from others.
    weights = np.where(operator.data == 1.0, 1.0, 2.0)
    return sp.csr_array((weights, operator.indices, operator.indptr), shape=operator.shape)


def intern_structure(structure: Structure) -> Structure:
    """Return an equal structure of an earlier model if one is cached, or else `structure`."""
    if structure.n > _MAX_COORDINATES:
        return structure
    return _intern_equal(structure)


def _count_coordinates(structure: Structure) -> int:
    """Return the number of local coordinates of all terms: terms of loads alone have few."""
    terms: tuple[ForceTerm | ConstraintTerm, ...] = (*structure.forces, *structure.joints)
    return 1 + sum(term.operator.shape[0] for term in terms)


@bounded_cache(_MAX_CACHED_COORDINATES, _count_coordinates)
def _intern_equal(structure: Structure) -> Structure:
    return structure


def cache_on_owner(build: Callable[Concatenate[K, P], T]) -> Callable[Concatenate[K, P], T]:
    """Cache the results of a function on its first argument, a structure or equations of motion.

    Results must be immutable, because runs share them.
    """

    @wraps(build)
    def cached(owner: K, *args: P.args, **kwargs: P.kwargs) -> T:
        derived, key = owner._derived, (build, args, tuple(sorted(kwargs.items())))
        if key not in derived:
            # Concurrent threads may build the result twice, but all use the first one stored.
            derived.setdefault(key, build(owner, *args, **kwargs))
        return derived[key]

    return cached


# Weights that keep their values in templates: entries of weight 1 are evaluated differently from
# others, and products of two of these weights are such weights again.
_LITERAL_WEIGHTS = (-1.0, 0.0, 1.0)
# Code of the first of the other weights; the following codes ascend by 1.
_FIRST_CODE = 2.0


def share_plans(
    build: Callable[Concatenate[Structure, P], T],
) -> Callable[Concatenate[Structure, P], T]:
    """Cache plans of sums on structures; structures that differ in weights only share patterns.

    `build` returns a plan, or a tuple or dataclass that contains plans. It is called for a template
    of the structure, whose operators contain codes in place of their weights; the plans then get
    the weights of the structure. `build` must not depend on weights otherwise. It may call other
    functions with this decorator.
    """
    shared = cache_on_owner(build)

    def bind(structure: Structure, *args: P.args, **kwargs: P.kwargs) -> T:
        match = _find_template(structure)
        assert match is not None
        template, weights = match
        return cast("T", _bind_weights(shared(template, *args, **kwargs), weights))

    bound = cache_on_owner(bind)

    @wraps(build)
    def planned(structure: Structure, *args: P.args, **kwargs: P.kwargs) -> T:
        plan = shared if _find_template(structure) is None else bound
        return plan(structure, *args, **kwargs)

    return planned


@cache_on_owner
def _find_template(structure: Structure) -> tuple[Structure, Array] | None:
    """Return the template of a structure and the weights that replace its codes, in order.

    Return None if the operators have no such weights, the structure is too large to be cached, or
    it is a template itself.
    """
    terms: list[ForceTerm | ConstraintTerm] = [*structure.forces, *structure.joints]
    weights = [term.operator.data[_is_coded(term.operator)] for term in terms]
    ends = np.cumsum([len(x) for x in weights])
    if structure.n > _MAX_COORDINATES or not len(ends) or ends[-1] == 0:
        return None
    coded: list[Any] = [
        replace(term, operator=_with_codes(term.operator, end - len(x)))
        for term, x, end in zip(terms, weights, ends, strict=True)
    ]
    count = len(structure.forces)
    template = replace(structure, forces=tuple(coded[:count]), joints=tuple(coded[count:]))
    # Plans derived from the plans of a template keep its codes.
    return None if template == structure else (intern_structure(template), np.concatenate(weights))


def _is_coded(operator: sp.csr_array) -> Array:
    return ~np.isin(operator.data, _LITERAL_WEIGHTS)


def _with_codes(operator: sp.csr_array, first: int) -> sp.csr_array:
    """Return an operator with codes, counted from `first`, in place of its weights.

    `_LITERAL_WEIGHTS` are kept.
    """
    data, is_coded = operator.data.copy(), _is_coded(operator)
    data[is_coded] = _FIRST_CODE + first + np.arange(np.count_nonzero(is_coded))
    return sp.csr_array((data, operator.indices, operator.indptr), shape=operator.shape)


def _bind_weights(value: Any, weights: Array) -> Any:
    """Return a plan, or an object that contains plans, with weights in place of their codes."""

    def decode(codes: Array) -> Array:
        is_coded = codes >= _FIRST_CODE
        values = codes.copy()
        values[is_coded] = weights[(codes[is_coded] - _FIRST_CODE).astype(int)]
        return values

    if isinstance(value, SumPlan):
        return value.with_weights(decode)
    if isinstance(value, tuple):
        return getattr(type(value), "_make", tuple)(_bind_weights(x, weights) for x in value)
    if is_dataclass(value) and not isinstance(value, type):
        changes = {
            x.name: _bind_weights(getattr(value, x.name), weights) for x in fields(value) if x.init
        }
        return replace(value, **changes)
    return value
