"""How many sections of a beam move at many states: places, turns and their accelerations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formulas import MAX_SHARED_KERNELS, Formula
from beamdae.symbolic.statements import SX, Local

Array = np.ndarray
# (local symbols, function) -> column of values.
Build = Callable[[Local, Callable[..., Any]], SX]


class SectionFunction(NamedTuple):
    """Rows that pick local coordinates from those of a beam, and a function of these."""

    operator: sp.csr_array
    function: Any


def section_motion(local: Local, motion: Callable[[SX], tuple[SX, SX]]) -> SX:
    """(x, y, turn) of a section and their second derivatives."""
    place, turn = motion(local.q)
    moved = ca.vertcat(place, turn)
    return ca.vertcat(moved, local.ddot(moved))


def position_and_angle(local: Local, motion: Callable[[SX], tuple[SX, SX]]) -> SX:
    """(x, y, turn) of a section."""
    return ca.vertcat(*motion(local.q))


def section_jacobian(local: Local, motion: Callable[[SX], tuple[SX, SX]]) -> SX:
    """Derivatives of (x, y, turn) by the local coordinates, column after column."""
    return ca.vec(ca.densify(ca.jacobian(position_and_angle(local, motion), local.q)))


def strains_and_rates(local: Local, values: Callable[[Local], SX]) -> SX:
    """Axial strain, shear strain and curvature, and their rates."""
    strains = values(local)
    return ca.vertcat(strains, local.dot(strains))


def evaluate_sections(
    build: Build, at: Sequence[SectionFunction], q: Array, v: Array, a: Array
) -> Array:
    """What is built of each function, at rows (rows, n) of a beam's coordinates.

    Returns
    -------
    ndarray
        (rows, len(at), number of values).
    """
    kinds: dict[Any, list[int]] = {}
    for k, (operator, function) in enumerate(at):
        kind, numbers = function, None
        if isinstance(function, Formula):
            kind, numbers = function.kind, len(function.numbers)
        kinds.setdefault((kind, operator.shape[0], numbers), []).append(k)
    found: Array | None = None
    for (kind, size, numbers), members in kinds.items():
        function = (_made if numbers is None else _kept)(build, kind, size, numbers)
        operators = sp.vstack([at[k].operator for k in members], format="csr")
        local = [(operators @ x.T).T.reshape(-1, size) for x in (q, v, a)]
        given = [() if numbers is None else at[k].function.numbers for k in members]
        own = np.array(given, float).reshape(len(members), -1)
        values = function(*local, np.tile(own, (len(q), 1))).reshape(len(q), len(members), -1)
        if found is None:
            found = np.empty((len(q), len(at), values.shape[2]))
        found[:, members] = values
    return np.zeros((len(q), 0, 1)) if found is None else found


def _made(build: Build, kind: Callable[..., Any], size: int, numbers: int | None) -> RowFunction:
    """Rows of (q, v, a, numbers) -> rows of values; None of a function that is no formula."""
    local, own = Local(size), SX.sym("numbers", numbers or 0)
    values = build(local, kind if numbers is None else Formula(kind, own))
    inputs = [local.q, local.v, local.a, own]
    return RowFunction(ca.Function("sections", inputs, [ca.densify(values)]))


_kept = lru_cache(maxsize=MAX_SHARED_KERNELS)(_made)
