"""Motion of the sections of a beam at many states: positions, angles, accelerations, strains."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formula import MAX_SHARED_KERNELS, Formula
from beamdae.symbolic.statements import SX, Local

Array = np.ndarray
# Builds a column of values from local symbols and the function of a section.
Build = Callable[[Local, Callable[..., Any]], SX]


class SectionFunction(NamedTuple):
    """A function of the local coordinates of a section.

    Attributes
    ----------
    operator
        Selects the local coordinates from those of the beam.
    function
        The function, for example the motion of a material point.
    """

    operator: sp.csr_array
    function: Any


def position_and_angle(local: Local, motion: Callable[[SX], tuple[SX, SX]]) -> SX:
    """Build (x, y, angle) of a section."""
    return ca.vertcat(*motion(local.q))


def section_motion(local: Local, motion: Callable[[SX], tuple[SX, SX]]) -> SX:
    """Build (x, y, angle) of a section and their second derivatives with respect to time."""
    position = position_and_angle(local, motion)
    return ca.vertcat(position, local.ddot(position))


def section_jacobian(local: Local, motion: Callable[[SX], tuple[SX, SX]]) -> SX:
    """Build the Jacobian of (x, y, angle) by the local coordinates, column by column."""
    return ca.vec(ca.densify(ca.jacobian(position_and_angle(local, motion), local.q)))


def strains_and_rates(local: Local, values: Callable[[Local], SX]) -> SX:
    """Build axial strain, shear strain and curvature, and their rates."""
    strains = values(local)
    return ca.vertcat(strains, local.dot(strains))


def evaluate_sections(
    build: Build, at: Sequence[SectionFunction], q: Array, v: Array, a: Array
) -> Array:
    """Evaluate an expression of several sections at rows of states.

    Parameters
    ----------
    build
        Builds the expression from the function of a section.
    at
        The sections.
    q, v, a
        Coordinates of the beam and their derivatives, (rows, n).

    Returns
    -------
    ndarray
        (rows, len(at), number of values).
    """
    # Sections whose functions differ in numbers alone share one compiled function.
    groups: dict[Any, list[int]] = {}
    for k, (operator, function) in enumerate(at):
        kind, count = function, None
        if isinstance(function, Formula):
            kind, count = function.kind, len(function.numbers)
        groups.setdefault((kind, operator.shape[0], count), []).append(k)
    result: Array | None = None
    for (kind, size, count), members in groups.items():
        compile_rows = _compile_rows if count is None else _compile_shared_rows
        compiled = compile_rows(build, kind, size, count)
        operators = sp.vstack([at[k].operator for k in members], format="csr")
        local = [(operators @ x.T).T.reshape(-1, size) for x in (q, v, a)]
        numbers = [() if count is None else at[k].function.numbers for k in members]
        data = np.array(numbers, float).reshape(len(members), -1)
        values = compiled(*local, np.tile(data, (len(q), 1))).reshape(len(q), len(members), -1)
        if result is None:
            result = np.empty((len(q), len(at), values.shape[2]))
        result[:, members] = values
    return np.zeros((len(q), 0, 1)) if result is None else result


def _compile_rows(
    build: Build, kind: Callable[..., Any], size: int, count: int | None
) -> RowFunction:
    """Compile rows of (q, v, a, numbers) to rows of values; `count` is None without numbers."""
    local, numbers = Local(size), SX.sym("numbers", count or 0)
    values = build(local, kind if count is None else Formula(kind, numbers))
    inputs = [local.q, local.v, local.a, numbers]
    return RowFunction(ca.Function("sections", inputs, [ca.densify(values)]))


_compile_shared_rows = lru_cache(maxsize=MAX_SHARED_KERNELS)(_compile_rows)
