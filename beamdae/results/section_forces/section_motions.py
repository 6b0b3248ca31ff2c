"""Values at sections of beams at several states: positions, rotations, section forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formula import MAX_SHARED_KERNELS, Formula
from beamdae.symbolic.sparse_operators import stack_rows
from beamdae.symbolic.statements import SX, Local

Array = np.ndarray
# Returns a symbolic column of values, given the local symbols and the function of a section.
Build = Callable[[Local, Callable[..., Any]], SX]
# Matrix that maps the coordinates of the beam to local ones, and function of the local ones.
SectionFunction = tuple[sp.csr_array, Any]


def position_and_angle(local: Local, motion: Callable[[SX], tuple[SX, SX]]) -> SX:
    """Return (x, y, rotation from the reference configuration) of a section as an expression."""
    return ca.vertcat(*motion(local.q))


def section_jacobian(local: Local, motion: Callable[[SX], tuple[SX, SX]]) -> SX:
    """Return the columns of d(x, y, rotation)/d(local coordinates), stacked in one vector."""
    return ca.vec(ca.densify(ca.jacobian(position_and_angle(local, motion), local.q)))


def evaluate_sections(
    build: Build, at: Sequence[SectionFunction], q: Array, v: Array, a: Array
) -> Array:
    """Evaluate an expression at several sections and states.

    Parameters
    ----------
    build
        Function that returns the expression, for example `position_and_angle`.
    at
        The sections.
    q, v, a
        Coordinates of the beam and their derivatives, (rows, n).

    Returns
    -------
    ndarray
        Values (rows, len(at), number of values).
    """
    # Sections whose functions differ only in their numbers share one compiled function.
    groups: dict[Any, list[int]] = {}
    for k, (operator, function) in enumerate(at):
        kind, count = function, None
        if isinstance(function, Formula):
            kind, count = function.kind, len(function.numbers)
        groups.setdefault((kind, operator.shape[0], count), []).append(k)
    result: Array | None = None
    for (kind, size, count), members in groups.items():
        compile_rows = _compile_rows if count is None else _compile_shared_rows
        compiled, is_used = compile_rows(build, kind, size, count)
        operators = stack_rows([at[k][0] for k in members])
        local = [
            (operators @ x.T).T.reshape(-1, size) if is_read else np.zeros(size)
            for x, is_read in zip((q, v, a), is_used, strict=True)
        ]
        numbers = [() if count is None else at[k][1].numbers for k in members]
        data = np.array(numbers, float).reshape(len(members), -1)
        values = compiled(*local, np.tile(data, (len(q), 1))).reshape(len(q), len(members), -1)
        if result is None:
            result = np.empty((len(q), len(at), values.shape[2]))
        result[:, members] = values
    return np.zeros((len(q), 0, 1)) if result is None else result


def _compile_rows(
    build: Build, kind: Callable[..., Any], size: int, count: int | None
) -> tuple[RowFunction, list[bool]]:
    """Compile the map from rows (q, v, a, numbers) to rows of values.

    Return also whether the values depend on q, v and a. `numbers` are the numerical arguments of
    the section function. `count` is the length of `numbers`, or None if the function has no
    numerical arguments.
    """
    local, numbers = Local(size), SX.sym("numbers", count or 0)
    values = build(local, kind if count is None else Formula(kind, numbers))
    inputs = [local.q, local.v, local.a, numbers]
    function = ca.Function("sections", inputs, [ca.densify(values)])
    return RowFunction(function), [ca.depends_on(values, x) for x in inputs[:3]]


_compile_shared_rows = lru_cache(maxsize=MAX_SHARED_KERNELS)(_compile_rows)
