"""What models that differ in numbers alone have in common: kernels, and where they stand."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache, wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import scipy.sparse as sp

from beamdae.symbolic.constraint_kernel import ConstraintKernel
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.rotations import LocalRotation


class CacheOwner(Protocol):
    """What keeps things that are built from it."""

    @property
    def _derived(self) -> dict[Any, Any]: ...


P = ParamSpec("P")
T = TypeVar("T")
K = TypeVar("K", bound=CacheOwner)

# Structures that are kept for models to come, and the coordinates from which on they are not:
# what is built from them grows with these, and beside the run it soon takes no time.
_MAX_STRUCTURES = 16
_MAX_COORDINATES = 1000


@dataclass(frozen=True, eq=False)
class ForceTerm:
    """Copies of one force kernel on the global coordinates.

    Attributes
    ----------
    operator, rotation
        The operator picks coordinates, which kernels turn to local ones, if at all.
    data
        Where in p the copies have their numbers, and behind these those of the turn.
    rows
        Picks the multipliers it depends on, if any.
    """

    kernel: ForceKernel
    operator: sp.csr_array
    rotation: LocalRotation | None
    data: slice
    count: int
    rows: sp.csr_array | None = None


@dataclass(frozen=True, eq=False)
class ConstraintTerm:
    """Copies of one constraint kernel on the global coordinates; `rows` picks their rows of g."""

    kernel: ConstraintKernel
    operator: sp.csr_array
    data: slice
    rows: sp.csr_array
    count: int


@dataclass(frozen=True)
class Structure:
    """Equations of motion but for their numbers, which are an array p.

    Two of them are equal if they have the same kernels, at the same places, on the same operators.

    Attributes
    ----------
    n, m
        Number of coordinates and of constraints.
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
            *(_comparison_key(value) for term in terms for value in vars(term).values()),
        )
        object.__setattr__(self, "_key", key)


def _comparison_key(value: Any) -> Any:
    """What tells an entry of a term from others; kernels are told by identity."""
    if isinstance(value, slice):
        return value.start, value.stop
    if isinstance(value, sp.csr_array):
        arrays = (value.indptr, value.indices, value.data)
        return value.shape, *((array.dtype.char, array.tobytes()) for array in arrays)
    return value if isinstance(value, int | LocalRotation | None) else id(value)


_interning = threading.Lock()


def intern_structure(structure: Structure) -> Structure:
    """The structure that models before had if it is equal, else this one."""
    if structure.n > _MAX_COORDINATES:
        return structure
    # Without the lock threads that come at once would each keep their own.
    with _interning:
        return _intern_equal(structure)


@lru_cache(maxsize=_MAX_STRUCTURES)
def _intern_equal(structure: Structure) -> Structure:
    return structure


def cache_on_owner(build: Callable[Concatenate[K, P], T]) -> Callable[Concatenate[K, P], T]:
    """Decorate what is built from a structure, or from equations of motion: built once for each.

    What it gives has to be immutable: runs share it.
    """

    @wraps(build)
    def kept(owner: K, *args: P.args, **kwargs: P.kwargs) -> T:
        derived, key = owner._derived, (build, args, tuple(sorted(kwargs.items())))
        if key not in derived:
            # Threads that come at once may build it each, but all go on with the same one.
            derived.setdefault(key, build(owner, *args, **kwargs))
        return derived[key]

    return kept
