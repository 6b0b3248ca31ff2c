"""Formulas: functions separated from the numbers in them.

Points of two rigid bodies, for example, move by the same expression with different numbers. An
expression made of formulas takes these numbers as data, so that all models can share it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from beamdae.bounded_cache import bounded_cache
from beamdae.symbolic.constraint_kernel import ConstraintKernel
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.local_symbols import Local
from beamdae.symbolic.table_lookups import record_calls

Array = np.ndarray

# Number of shared kernels cached for later models, per cache.
MAX_SHARED_KERNELS = 512
# Unlike `functools.lru_cache`, it returns the same kernel to concurrent threads: structures that
# compare kernels by identity would otherwise differ.
cache_kernels = bounded_cache(MAX_SHARED_KERNELS, lambda kernel: 1.0)


@dataclass(frozen=True)
class Formula:
    """A function and the numbers in it.

    Attributes
    ----------
    kind
        Function of (..., numbers). Equal kinds must compute the same values, so a kind is a
        module-level function or an instance of a frozen dataclass.
    numbers
        Floats, or symbols in their place; `kind` reads single entries such as `numbers[0]`.
    """

    kind: Callable[..., Any]
    numbers: Any = ()

    def __call__(self, *arguments: Any) -> Any:
        """Return `kind(*arguments, numbers)`."""
        return self.kind(*arguments, self.numbers)


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def compile_kind(compile_formula: Callable[..., Any], kind: Any, count: int, *sizes: int) -> Any:
    """Return `compile_formula(formula, numbers, *sizes)` of a formula with `count` numbers."""
    numbers = ca.SX.sym("numbers", count)
    return compile_formula(Formula(kind, numbers), numbers, *sizes)


def _return_numbers(numbers: Any) -> Any:
    return numbers


def constant_formula(*numbers: float) -> Formula:
    """Return a formula without arguments that returns the given numbers."""
    return Formula(_return_numbers, numbers)


@dataclass(frozen=True)
class FormulaExpression:
    """The expression `build(local, *functions)`, with the numbers of formulas in `local.data`.

    Attributes
    ----------
    build
        Function of (local, *functions). Equal functions must compute the same values, as for
        `Formula.kind`.
    functions
        Kinds of the formulas, or other functions.
    counts
        Length of the `numbers` of each formula; None for other functions.
    """

    build: Callable[..., Any]
    functions: tuple[Callable[..., Any], ...]
    counts: tuple[int | None, ...]

    @classmethod
    def of(
        cls, build: Callable[..., Any], functions: Sequence[Callable[..., Any]]
    ) -> tuple[FormulaExpression, Array]:
        """Return the expression and its data, the numbers of the formulas among `functions`."""
        formulas = [x for x in functions if isinstance(x, Formula)]
        expression = cls(
            build,
            tuple(x.kind if isinstance(x, Formula) else x for x in functions),
            tuple(len(x.numbers) if isinstance(x, Formula) else None for x in functions),
        )
        return expression, np.array([number for x in formulas for number in x.numbers], float)

    @property
    def is_shareable(self) -> bool:
        """True if all functions are formulas, so that equal expressions have equal values."""
        return None not in self.counts

    def __call__(self, local: Local, numbers: Any = None) -> Any:
        """Return the expression in the symbols of `local`, with `numbers` in place of its data.

        With `numbers`, an expression is the kind of a `Formula`.
        """
        first, functions = 0, []
        numbers = local.data if numbers is None else numbers
        for function, count in zip(self.functions, self.counts, strict=True):
            if count is None:
                functions.append(function)
            else:
                functions.append(Formula(function, numbers[first : first + count]))
                first += count
        with record_calls(has_numbers_as_symbols=True) as calls:
            value = self.build(local, *functions)
        if calls and isinstance(value, ForceKernel):
            return replace(value, table_calls=tuple(calls))
        return value


def build_formula_kernel(
    build: Callable[..., Any],
    functions: Sequence[Callable[..., Any]],
    size: int,
    n_multipliers: int = 0,
    shared: bool = True,
) -> tuple[Any, Array]:
    """Return the kernel of a `FormulaExpression` and its data, shape (n_data, 1).

    If `shared`, equal expressions made only of formulas share one kernel, in all models of the
    process.

    Parameters
    ----------
    build, functions
        See `FormulaExpression`.
    size, n_multipliers
        Numbers of local coordinates and of multipliers.
    shared
        False if `build` contains user-defined functions; the kernel is then not cached for other
        models.
    """
    expression, numbers = FormulaExpression.of(build, functions)
    sizes = (size, len(numbers), n_multipliers)
    if shared and expression.is_shareable:
        kernel = _build_shared_kernel(expression, *sizes)
    else:
        kernel = expression(Local(*sizes))
    return kernel, numbers[:, None]


@cache_kernels
def _build_shared_kernel(
    expression: FormulaExpression, size: int, n_data: int, n_multipliers: int
) -> ForceKernel | ConstraintKernel:
    return replace(expression(Local(size, n_data, n_multipliers)), reused=True)
