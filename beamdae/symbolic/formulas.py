"""Formulas: expressions of a kind, with their numbers beside them.

A beam's end moves by the same expression whatever the beam, with other numbers in it. What is made
of formulas takes the numbers as data, so that it is built once for each kind, not for each model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from beamdae.symbolic.constraint_kernel import ConstraintKernel
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.local_symbols import Local

Array = np.ndarray

# What is kept for models to come, of each sort.
MOST_KINDS = 512


@dataclass(frozen=True)
class Formula:
    """A function with numbers in it.

    Attributes
    ----------
    kind
        (..., numbers) -> value. Equal kinds are the same function: those are functions of a module,
        or frozen dataclasses.
    numbers
        What it takes one by one, `numbers[0]` and so on: floats, or symbols in their place.
    """

    kind: Callable[..., Any]
    numbers: Any = ()

    def __call__(self, *given: Any) -> Any:
        """Its value."""
        return self.kind(*given, self.numbers)


def _themselves(numbers: Any) -> Any:
    return numbers


def plain(*numbers: float) -> Formula:
    """The formula of numbers alone: called without anything it gives them."""
    return Formula(_themselves, numbers)


@dataclass(frozen=True)
class Combined:
    """What `build` makes of local symbols and functions: `build(local, *functions)`.

    Attributes
    ----------
    build
        As the kind of a formula: equal ones are the same function.
    functions
        Kinds of formulas, whose numbers are to be found in `local.data`, or any functions.
    counts
        How many numbers each of them has; None of those that are no formulas.
    """

    build: Callable[..., Any]
    functions: tuple[Callable[..., Any], ...]
    counts: tuple[int | None, ...]

    @classmethod
    def of(
        cls, build: Callable[..., Any], functions: Sequence[Callable[..., Any]]
    ) -> tuple[Combined, Array]:
        """With what it takes as `local.data`: the numbers of the formulas among `functions`."""
        formulas = [x for x in functions if isinstance(x, Formula)]
        made = cls(
            build,
            tuple(x.kind if isinstance(x, Formula) else x for x in functions),
            tuple(len(x.numbers) if isinstance(x, Formula) else None for x in functions),
        )
        return made, np.array([number for x in formulas for number in x.numbers], float)

    @property
    def is_kind(self) -> bool:
        """Whether all of it are formulas: equal ones then give the same."""
        return None not in self.counts

    def __call__(self, local: Local) -> Any:
        """What it gives."""
        first, given = 0, []
        for function, count in zip(self.functions, self.counts, strict=True):
            if count is None:
                given.append(function)
            else:
                given.append(Formula(function, local.data[first : first + count]))
                first += count
        return self.build(local, *given)


def combined_kernel(
    build: Callable[..., Any],
    functions: Sequence[Callable[..., Any]],
    size: int,
    n_multipliers: int = 0,
) -> tuple[Any, Array]:
    """The kernel `build` makes, see `Combined`, and its data (n_data, 1).

    Formulas of the same kinds give the same object.
    """
    combined, numbers = Combined.of(build, functions)
    sizes = (size, len(numbers), n_multipliers)
    kernel = _kept(combined, *sizes) if combined.is_kind else combined(Local(*sizes))
    return kernel, numbers[:, None]


@lru_cache(maxsize=MOST_KINDS)
def _kept(
    combined: Combined, size: int, n_data: int, n_multipliers: int
) -> ForceKernel | ConstraintKernel:
    return replace(combined(Local(size, n_data, n_multipliers)), reused=True)
