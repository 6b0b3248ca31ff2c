"""Whether constraints depend on each other, and which."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.errors import BeamdaeError
from beamdae.symbolic.sparse_operators import column_of

Array = np.ndarray

# A gradient this small, in the scales of the coordinates, is what rounding leaves of zero.
_VANISHING = 1e-13
# Constraints depend on each other from this singular value of their scaled gradients on.
_DEPENDENT = 1e-10
# So many gradients are looked at by a singular value decomposition, which takes their number cubed;
# of more of them those alone whose squared singular values may be smaller than this.
_FEW = 100
_DOUBTFUL = 1e-8
_INVERSE_ITERATIONS = 3


def require_independent(
    pattern: sp.csc_array,
    gradients: Array,
    names: tuple[str, ...],
    t: float,
    what_they_block: Callable[[], str],
) -> None:
    """Refuse constraints that hold nothing or depend on each other at time `t` [s].

    `gradients` are the non-zeros on `pattern` of those of the constraints `names`, a row each, in
    the scales of the coordinates. `what_they_block` is called where they depend on each other.

    Raises
    ------
    BeamdaeError
        Naming them.
    """
    count, size = pattern.shape
    if count == 0:
        return
    lengths = np.sqrt(np.bincount(pattern.indices, gradients**2, count))
    if np.any(lengths <= _VANISHING):
        name = names[int(np.argmin(lengths))]
        raise BeamdaeError(
            f"{name}: this constraint holds nothing at t = {t:g}, its gradient is zero; "
            "it cannot be met from the start given, or is none."
        )
    scaled = gradients / lengths[pattern.indices]
    if count > _FEW and _are_clearly_independent(
        sp.csr_array(sp.csc_array((scaled, pattern.indices, pattern.indptr), shape=(count, size)))
    ):
        return
    matrix = np.zeros((count, size))
    matrix[pattern.indices, column_of(pattern)] = scaled
    left, singular, _ = la.svd(matrix, full_matrices=False)
    rank = int(np.sum(singular > _DEPENDENT))
    if rank == count:
        return
    if count > size:
        left = la.svd(matrix)[0]
    involved = np.max(np.abs(left[:, rank:]), axis=1) > 1e-6
    listed = ", ".join(name for name, is_in in zip(names, involved, strict=True) if is_in)
    blocked = what_they_block()
    raise BeamdaeError(
        f"{listed}: these constraints depend on each other at t = {t:g}, "
        f"remove {count - rank} of them{f': {blocked}' if blocked else ''}."
    )


def _are_clearly_independent(rows: sp.csr_array) -> bool:
    """Whether the smallest eigenvalue of rows @ rows.T, by inverse iteration, is far from zero."""
    try:
        factors = splu(sp.csc_array(rows @ rows.T), "MMD_AT_PLUS_A", 0.0)
    except RuntimeError:
        return False
    x = np.cos(np.arange(rows.shape[0]) ** 2.0)
    for _ in range(_INVERSE_ITERATIONS):
        x = factors.solve(x / np.linalg.norm(x))
    return bool(np.linalg.norm(x) < 1.0 / _DOUBTFUL)
