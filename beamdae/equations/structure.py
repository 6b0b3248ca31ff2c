"""Parameter-independent structure of equations of motion: kernels and their operators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import numpy as np
import scipy.sparse as sp

from beamdae.bounded_cache import bounded_cache
from beamdae.symbolic.constraint_kernel import ConstraintKernel
from beamdae.symbolic.force_kernel import ForceKernel
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
    resultants
        Operator that selects the local coordinates that are resultants from those of all terms;
        None if the kernel has none.
    """

    kernel: ForceKernel
    operator: sp.csr_array
    rotation: LocalRotation | None
    data: slice
    count: int
    rows: sp.csr_array | None = None
    resultants: sp.csr_array | None = None


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

    @property
    def smooth_forces(self) -> tuple[ForceTerm, ...]:
        """All forces but those with kinks over the motion, such as forces of contacts."""
        return tuple(x for x in self.forces if not x.kernel.has_kinks_over_motion)

    @property
    def resultant_count(self) -> int:
        """Number of resultants of all forces, in mixed equations."""
        return sum(x.count * x.kernel.resultants for x in self.forces)

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
