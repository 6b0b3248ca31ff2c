"""Accelerations and multipliers at the start where forces depend on the multipliers."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from beamdae.equations.starts.start_sums import StartEquations
from beamdae.errors import BeamdaeError
from beamdae.linear.factorizations import SingularMatrixError, factorization

Array = np.ndarray

_ITERATIONS = 50
# Of a change, relative to what is found: rounding, with room for a badly scaled matrix.
_TOLERANCE = 1e-10


def acceleration_with_friction(
    own: StartEquations, time: Array, q: Array, v: Array, gamma: Array, stiff_time: float
) -> tuple[Array, Array]:
    """Solve M a + F(0, lam) + G^T lam = 0, G a = gamma, by Newton's iteration from lam = 0.

    See `Starter.acceleration`. What the matrix says of dF/dlam is exact, so that the iteration
    converges at once where friction is proportional to the reactions.

    Raises
    ------
    BeamdaeError
        If there are none, as in Painleve's paradox.
    """
    e, pattern = own.equations, own.sums.saddle_pattern
    solver, c = factorization(pattern), (stiff_time**2, 0.0, 1.0)
    found = np.zeros(e.n + e.m)
    for _ in range(_ITERATIONS):
        a, lam = found[: e.n], found[e.n :]
        force = own.force(time, q, v, None, lam)
        nonzeros = own.saddle(time, q, v, None, c, lam)
        if not (np.isfinite(force).all() and np.isfinite(nonzeros).all()):
            break
        block = own.sums.block.matrix(nonzeros)
        parts = (own.gradients(time, q), own.sums.gradient_pattern.indices)
        g = sp.csc_array((*parts, own.sums.gradient_pattern.indptr), shape=(e.m, e.n))
        off = np.concatenate([block @ a + force + g.T @ lam, g @ a - gamma])
        try:
            solver.factorize(nonzeros)
        except SingularMatrixError:
            break
        change = solver.solve(-off)
        found = found + change
        size = float(np.max(np.abs(found), initial=0.0))
        if np.max(np.abs(change), initial=0.0) <= _TOLERANCE * size:
            return found[: e.n], found[e.n :]
    names = sorted({name.rpartition(".")[0] for name in _rubbing(own)})
    raise BeamdaeError(
        f"{', '.join(names)}: no accelerations and reactions fit the friction at "
        f"t = {time[0]:g} s, it is too large for the mechanism to slide (Painleve's paradox); "
        "take a smaller coefficient of friction, or a larger regularization velocity."
    )


def _rubbing(own: StartEquations) -> list[str]:
    """Names of the multipliers that forces depend on."""
    terms = (term.rows for term in own.equations.forces if term.rows is not None)
    return [own.equations.lam_names[k] for rows in terms for k in rows.indices]
