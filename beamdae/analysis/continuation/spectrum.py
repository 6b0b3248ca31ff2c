"""Slow motions of linear systems, and growing motions about an equilibrium.

The equations are M q'' + D q' + K q + G^T lam = 0, G q - C lam = 0. Eigenvalues are computed from
the flexibility, the inverse of the saddle-point matrix of K, G and C: slow motions are then its
largest ones, whatever the stiffest ones are. Large systems use an invariant space found by ARPACK.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from beamdae.analysis.continuation.critical import Count

Array = np.ndarray

# Motions with the least stiffness, and the asymmetry in them below which forces have a potential:
# forces normal to sections instead of the axis do work on shear strains.
_SOFT_COUNT = 6
_MIN_ASYMMETRY = 1e-3
# Imaginary parts below this fraction of the eigenvalue are rounding errors; and real parts below
# this fraction of the largest eigenvalue.
_ROUNDING, _ROUNDING_OF_GROWTH = 1e-6, 1e-13
# Reciprocal eigenvalues, or their squares without damping, below this fraction of the largest one
# are rounding errors.
_NEGLIGIBLE = 1e-7
# Largest number of coordinates for dense matrices; beyond, number of the slowest motions that are
# sought.
MAX_DENSE, _SLOW_COUNT = 300, 20
# Relative accuracy of ARPACK, and in clusters; numbers of eigenvalues beyond the wanted ones, and
# of searches and their restarts.
_ARPACK_TOLERANCE, _CLUSTER_TOLERANCE, _CLUSTER_VECTORS = 1e-12, 1e-3, 80
EXTRA_VALUES, _MAX_SEARCHES, _MAX_RESTARTS = 2, 30, 20
# Directions of found motions below this fraction of the others depend on them.
_DEPENDENCE_RATIO = 1e-10


class SlowSpace(NamedTuple):
    """Invariant space of the flexibility.

    Attributes
    ----------
    basis, images
        Orthonormal motions (N, k), and their images under the flexibility.
    is_complete
        True if it contains all wanted motions.
    """

    basis: Array
    images: Array
    is_complete: bool

    @property
    def reduced(self) -> Array:
        """Flexibility in this space, (k, k)."""
        return np.asarray(self.basis.T @ self.images)


def find_slow_space(
    respond: Callable[[Array], Array],
    size: int,
    number: int,
    find_missing: Callable[[Array, float], float] | None = lambda *_: 0.0,
) -> SlowSpace:
    """Return motions that span the slowest modes, or all motions of small systems.

    Found motions are removed from the flexibility, and the largest eigenvalue of the rest tells
    which modes are complete. So copies of multiple eigenvalues are found, too.

    Parameters
    ----------
    respond
        Flexibility, from motions (N, k) to their images.
    size, number
        N, and number of eigenvalues of the first search.
    find_missing
        Function from eigenvalues of the flexibility to the number of missing modes, if all that are
        larger than the second argument are known. None to search once more, for oscillations:
        strong damping slows many motions down to nearly the same decay.
    """
    if size <= max(MAX_DENSE, 2 * number):
        return SlowSpace(np.eye(size), respond(np.eye(size)), True)
    basis, images = np.zeros((2, size, 0))

    def remove(y: Array) -> Array:
        return y - basis @ (basis.T @ y)

    def multiply(y: Array) -> Array:
        return remove(respond(remove(y.reshape(-1, 1))))

    operator = LinearOperator((size, size), multiply, dtype=float)
    tolerance, bound = _ARPACK_TOLERANCE, np.inf
    for k in range(_MAX_SEARCHES):
        if basis.shape[1] + number > size // 2:
            break
        start = np.random.default_rng(k).standard_normal(size)
        settings = {"v0": start, "tol": tolerance, "maxiter": _MAX_RESTARTS}
        if tolerance > _ARPACK_TOLERANCE:
            number, settings["ncv"] = EXTRA_VALUES, _CLUSTER_VECTORS
        try:
            which = "LI" if k and find_missing is None else "LM"
            found, vectors = eigs(operator, number, which=which, **settings)
        except ArpackNoConvergence as error:
            # Decays at nearly the same rate are not separated.
            found, vectors = error.eigenvalues, error.eigenvectors
            if not len(found) and tolerance > _ARPACK_TOLERANCE:
                break
            tolerance = _CLUSTER_TOLERANCE
        if k and len(found):
            bound = float(np.max(np.abs(found)))
        new = la.orth(remove(np.hstack([vectors.real, vectors.imag])), _DEPENDENCE_RATIO)
        basis, images = np.hstack([basis, new]), np.hstack([images, respond(new)])
        if find_missing is None:
            if k:
                return SlowSpace(basis, images, True)
            continue
        inverses = la.eigvals(basis.T @ images)
        missing = int(np.ceil(find_missing(inverses[inverses != 0.0], (1.0 - tolerance) * bound)))
        if missing <= 0:
            return SlowSpace(basis, images, True)
        number = EXTRA_VALUES + (2 * missing if k else 0)
    return SlowSpace(basis, images, False)


def invert_motion(
    respond: Callable[[Array], Array],
    damping: sp.csc_array | None,
    mass: sp.csc_array,
    s: float = 0.0,
) -> Callable[[Array], Array]:
    """Return the inverse of a linear motion about a shift s.

    With y = (x, l x), its eigenvalues are 1 / (l - s); without damping, those for y = x are
    1 / (s^2 - l^2). `respond` is the flexibility at the shift, from forces and changes of
    constraints, to which `damping` and `mass` lead.
    """
    n = mass.shape[1]

    def apply(y: Array) -> Array:
        x = y[:n]
        if damping is None:
            return respond(mass @ x)
        image = -respond(mass @ (y[n:] + s * x) + damping @ x)
        return np.vstack([image, x + s * image])

    return apply


def has_potential(respond: Callable[[Array], Array], n: int, m: int) -> bool:
    """Return True if the motions with the least stiffness feel no asymmetry of the stiffness.

    `respond` leads from forces and changes of constraints (n + m, k) to displacements (n, k).
    """

    def move(forces: Array) -> Array:
        return respond(np.vstack([forces, np.zeros((m, forces.shape[1]))]))

    vectors = np.cos(np.outer(np.arange(n) ** 2.0, np.arange(1.0, min(_SOFT_COUNT, n) + 1.0)))
    for _ in range(2):
        vectors = np.linalg.qr(move(vectors))[0]
    reduced = vectors.T @ move(vectors)
    return bool(np.abs(reduced - reduced.T).max() <= _MIN_ASYMMETRY * np.abs(reduced).max())


def count_growing(
    respond: Callable[[Array], Array], damping: sp.csc_array, mass: sp.csc_array, s: float = 0.0
) -> Count:
    """Return the number of growing motions; see `invert_motion` for the arguments.

    In large systems, they are those among the slowest ones. About a shift s, motions without
    stiffness, l = 0, are not counted.
    """
    is_damped, n = damping.nnz > 0 and abs(damping).max() > 0.0, mass.shape[1]
    apply, size = invert_motion(respond, damping if is_damped else None, mass, s), n + n * is_damped
    if n <= MAX_DENSE:
        values = la.eigvals(apply(np.eye(size)))
    else:
        further = {"find_missing": None} if is_damped else {}
        values = la.eigvals(find_slow_space(apply, size, _SLOW_COUNT, **further).reduced)
    # Others are rounding errors of the slowest one.
    values = values[np.abs(values) > _NEGLIGIBLE * np.abs(values).max(initial=0.0)]
    # With w = 1 / (l - s), 1 / l = w / (1 + s w); with w = 1 / (s^2 - l^2), -1 / l^2 is
    # w / (1 - s^2 w).
    ratios = 1.0 + s * values if is_damped else 1.0 - s**2 * values
    has_stiffness = np.abs(ratios) > _ROUNDING
    values = values[has_stiffness] / ratios[has_stiffness]
    is_real = np.abs(values.imag) <= _ROUNDING * np.abs(values)
    values = np.where(is_real, values.real, values)
    if is_damped:
        growing = values.real > _ROUNDING_OF_GROWTH * np.abs(values).max(initial=0.0)
        divergent, oscillating = growing & is_real, growing & ~is_real
    else:
        # Reciprocals of squared eigenvalues: real ones do not oscillate if they are positive.
        divergent, oscillating = is_real & (values.real < 0.0), ~is_real
    return Count(int(divergent.sum()), int(oscillating.sum()) // 2)
