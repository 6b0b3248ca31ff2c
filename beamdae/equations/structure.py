"""Parameter-independent structure of equations of motion: kernels and their operators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import scipy.sparse as sp

from beamdae.bounded_cache import bounded_cache
from beamdae.symbolic.constraint_kernel import ConstraintKernel
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.rotations import LocalRotation


class CacheOwner(Protocol):
    """Object that caches the data derived from it."""

    @property
    def _derived(self) -> dict[Any, Any]: ...


P = ParamSpec("P")
T = TypeVar("T")
K = TypeVar("K", bound=CacheOwner)

# Largest total number of coordinates of the structures cached for later models. With everything
# derived from them, they take about 5 kB per coordinate.
_MAX_CACHED_COORDINATES = 4000
# Larger structures are not cached: their sums need memory in proportion to their size, while the
# time to build them becomes negligible compared with the run.
_MAX_COORDINATES = 1000


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
    """

    n: int = field(compare=False)
    m: int = field(compare=False)
    forces: tuple[ForceTerm, ...] = field(compare=False, repr=False)
    joints: tuple[ConstraintTerm, ...] = field(compare=False, repr=False)
    _key: Any = field(init=False, repr=False)
    _derived: dict[Any, Any] = field(default_factory=dict, init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        terms = (*self.forces, *self.joints)
        key = (
            self.n,
            self.m,
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


def intern_structure(structure: Structure) -> Structure:
    """Return an equal structure of an earlier model if one is cached, or else `structure`."""
    if structure.n > _MAX_COORDINATES:
        return structure
    return _intern_equal(structure)


@bounded_cache(_MAX_CACHED_COORDINATES, lambda structure: structure.n)
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
