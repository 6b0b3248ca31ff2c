"""Slowest motions of linearized equations.

The modes x exp(l t) solve (l^2 M + l D + K) x + H mu = 0 and (J + l V) x - C mu = 0, where C are
the compliances of the constraints. They are the largest eigenvalues of the flexibility, the inverse
of the saddle-point matrix [[K, H], [J, -C]] at a shift (Ericsson & Ruhe, Math. Comput. 35 (1980)
1251; Tisseur & Meerbergen, SIAM Rev. 43 (2001) 235). Small problems use all columns of the
flexibility, large ones a block Krylov space.

Quantities below the rounding error of the saddle-point matrix in their motion are zero.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.analysis.eigenproblems.block_krylov import (
    BlockKrylov,
    takes_longer_than_dense,
)
from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.errors import BeamdaeError
from beamdae.linear.saddle_point import factorize_saddle_point

Array = np.ndarray

# Largest number of coordinates for dense matrices: of problems with few wanted modes, and of those
# whose Krylov spaces do not converge.
_MAX_DENSE_COORDINATES, _MAX_FALLBACK_COORDINATES = 250, 800
# Bound on the rounding error of y^T A y, relative to |y|^T |A| |y|.
_ROUNDING_RATIO = 1e-15
# The first shift -s^2 of K is this multiple of the largest ratio of stiffness to inertia; if there
# are free motions, or if it exceeds the smallest square that is not zero by the second factor, this
# square times the third number is the shift.
_FIRST_SQUARE, _MAX_EXCESS, _SQUARE_RATIO = 2e-14, 1e4, 0.4
_MIN_SQUARE_SHARE = 1e-3
_MAX_SHIFTS = 6
# Shift relative to the geometric mean of the lowest and highest frequency of interest; a factor of
# one would hit the frequency of a single mode. If all modes are requested, the lowest ten count.
_SHIFT_RATIO, _DEFAULT_COUNT = 0.6, 10
# Numbers of blocks of first Krylov spaces, and number of vectors of a block beyond the wanted ones.
_FIRST_BLOCKS, _EXTRA_VECTORS = 3, 2
# Relative residual that suffices to know on which side of a circle an eigenvalue lies.
_LOCATION_ACCURACY = 1e-3
# Relative residuals from which inverse iteration takes over and at which it ends, and its largest
# number of steps.
_REFINABLE_ACCURACY, _ACCURACY, _REFINEMENTS = 1e-5, 1e-11, 2
# Eigenvalues of the inverse below this fraction of the largest are lost in rounding.
_MIN_INVERSE_RATIO = 1e-13
# Rounding errors of the stiffness in the metric of the energy, relative to its inertia.
_ENERGY_ROUNDING = 1e-6
# Imaginary and real parts up to these fractions of the eigenvalue are rounding errors.
_IMAGINARY_TOLERANCE, _REAL_TOLERANCE = 1e-9, 1e-12
# Free motions are dependent if their singular value is below this fraction of the largest one.
_RANK_TOLERANCE = 1e-3
# Forces of dampers on free motions up to this fraction of their terms are rounding errors.
_FREE_ROUNDING = 1e-13
# The loss of a mode determines its decay unless its momentum, relative to that of an undamped mode,
# is below this number, as where modes of rotating bodies coalesce.
_MIN_MOMENTUM = 1e-3


class MasslessError(BeamdaeError):
    """Raised if a motion has no inertia; `coordinate` names the coordinate that moves most."""

    def __init__(self, coordinate: str) -> None:
        super().__init__(f"{coordinate}: this coordinate has no inertia; add mass or a joint.")
        self.coordinate = coordinate


class UndampedModes(NamedTuple):
    """Undamped modes in ascending order of the squared frequency.

    Attributes
    ----------
    squares
        Squared angular frequencies [1/s^2], (k,); negative for unstable motions.
    shapes
        Mode shapes, (n, k), with x^T M x = 1.
    """

    squares: Array
    shapes: Array


class _Saddle:
    """Factorized saddle-point matrix [[A, H], [J, -C]].

    Raises
    ------
    BeamdaeError
        If the matrix is singular.
    """

    def __init__(
        self, block: sp.csc_array, reactions: sp.csc_array, rows: sp.csc_array, compliance: Array
    ) -> None:
        solve = factorize_saddle_point(block, reactions, rows, compliance)
        if solve is None:
            raise BeamdaeError(
                "modes: the linearized equations are singular; add mass or stiffness to the parts "
                "that can move."
            )
        self._solve, self._compliance = solve, compliance
        self._sizes = abs(block), abs(reactions), abs(rows)

    def solve(self, force: Array, gap: Array | None = None) -> Array:
        """Return (x, mu), (n + m, k), for columns (n, k) of forces and (m, k) of gaps."""
        gap = np.zeros((len(self._compliance), force.shape[1])) if gap is None else gap
        return self._solve(np.vstack([force, gap]))

    def rounding(self, y: Array) -> Array:
        """Return a bound (k,) on the rounding error of y^H A y for columns y = (x, mu)."""
        n = self._sizes[0].shape[0]
        x, mu = np.abs(y[:n]), np.abs(y[n:])
        block, reactions, rows = self._sizes
        terms = np.sum(x * (block @ x + reactions @ mu), axis=0) + np.sum(mu * (rows @ x), axis=0)
        return _ROUNDING_RATIO * (terms + self._compliance @ mu**2)


def quadratic_form_rounding(matrix: sp.csc_array, shapes: Array) -> Array:
    """Return a bound (k,) on the rounding error of x^H A x for each column x of `shapes`."""
    sizes = np.abs(shapes)
    return _ROUNDING_RATIO * np.einsum("ij,ij->j", sizes, abs(matrix) @ sizes)


def solve_undamped(lin: LinearizedEquations, count: int | None) -> UndampedModes:
    """Return the modes of the symmetric parts of M and K under G x - C mu = 0.

    All modes or, with sparse matrices, the `count` modes with the smallest |squares|.

    Raises
    ------
    MasslessError
        If the matrices are dense and an admissible motion has no inertia.
    BeamdaeError
        If many eigenvalues are too close to each other to be separated.
    """
    n, rows, compliance = lin.equations.n, lin.rows, lin.compliance
    mass, stiffness = (0.5 * (x + x.T) for x in (lin.tangent.mass, lin.tangent.stiffness))
    available = n - int(np.sum(compliance == 0.0))
    if available <= 0:
        return UndampedModes(np.zeros(0), np.zeros((n, 0)))
    is_dense = count is None or n <= _MAX_DENSE_COORDINATES or count >= available // 2
    # Random motions contain all modes.
    number = 0 if is_dense else count + _EXTRA_VECTORS
    start = lin.equations.position_scales[:, None] * _random(n, number)
    basis = _admissible_motions(lin, mass) if is_dense else start
    inertia = mass.diagonal()
    ratios = np.abs(stiffness.diagonal()[inertia > 0.0]) / inertia[inertia > 0.0]
    square = _FIRST_SQUARE * float(np.max(ratios, initial=0.0)) or 1.0
    for _ in range(_MAX_SHIFTS):
        saddle = _Saddle(stiffness + square * mass, sp.csc_array(rows.T), rows, compliance)
        if is_dense:
            modes = _solve_dense(lin, saddle, basis, mass, square, count)
        else:
            krylov = BlockKrylov(
                lambda x, saddle=saddle: saddle.solve(mass @ x)[:n],
                start,
                mass,
                is_symmetric=True,
                blocks=_FIRST_BLOCKS,
            )
            start, modes = _lowest(lin, saddle, krylov, mass, square, number)
        sizes = np.sort(np.abs(modes.squares))[:count]
        slowest = np.min(sizes[sizes > 0.0], initial=np.inf)
        has_free = bool(np.any(sizes == 0.0))
        is_low = square <= _MAX_EXCESS * slowest
        if is_low and not (has_free and square < _MIN_SQUARE_SHARE * slowest < np.inf):
            break
        square = _SQUARE_RATIO * slowest
    if not is_dense:

        def required_accuracy(inverses: Array) -> Array:
            accuracy = np.full(len(inverses), np.inf)
            accuracy[np.argsort(np.abs(1.0 / inverses - square), kind="stable")[:count]] = 0.0
            return accuracy

        if not krylov.converge(required_accuracy):
            if n > _MAX_FALLBACK_COORDINATES:
                raise _convergence_error(count)
            return solve_undamped(lin, None)
        modes = _lowest(lin, saddle, krylov, mass, square, count)[1]
    order = np.argsort(modes.squares, kind="stable")
    return UndampedModes(modes.squares[order], modes.shapes[:, order])


def _solve_dense(
    lin: LinearizedEquations,
    saddle: _Saddle,
    basis: Array,
    mass: sp.csc_array,
    square: float,
    count: int | None,
) -> UndampedModes:
    """Return all modes: slow ones from the flexibility, fast ones from the stiffness.

    Errors of the flexibility are relative to the slowest mode, those of the stiffness to the
    fastest one. `basis` (n, k) spans the admissible motions, with X^T M X = I.
    """
    weighted = mass @ basis
    images = saddle.solve(weighted)
    flexibility, reduced = (
        weighted.T @ images[: len(basis)],
        basis.T @ (lin.condensed_stiffness @ basis),
    )
    flexibility, reduced = (0.5 * (x + x.T) for x in (flexibility, reduced))
    inverses, vectors = la.eigh(flexibility)
    largest = np.max(np.abs(inverses))
    is_slow = np.abs(inverses) >= np.sqrt(largest / max(la.norm(reduced), 1.0 / largest))
    slow = _decide_zeros(
        lin,
        saddle,
        square,
        inverses[is_slow],
        basis @ vectors[:, is_slow],
        images @ vectors[:, is_slow],
    )
    if count is not None and count <= np.sum(is_slow):
        return slow
    rest = vectors[:, ~is_slow]
    squares, combinations = la.eigh(rest.T @ reduced @ rest)
    return UndampedModes(
        np.append(slow.squares, squares), np.hstack([slow.shapes, basis @ rest @ combinations])
    )


def _lowest(
    lin: LinearizedEquations,
    saddle: _Saddle,
    krylov: BlockKrylov,
    mass: sp.csc_array,
    square: float,
    count: int,
) -> tuple[Array, UndampedModes]:
    """Return the vectors of the `count` smallest |squares| in a Krylov space, and their modes."""
    order = np.argsort(np.abs(1.0 / krylov.values - square), kind="stable")[:count]
    vectors, inverses = krylov.vectors(order), krylov.values[order]
    images = saddle.solve(mass @ vectors)
    return vectors, _decide_zeros(lin, saddle, square, inverses, vectors, images)


def _decide_zeros(
    lin: LinearizedEquations,
    saddle: _Saddle,
    square: float,
    inverses: Array,
    estimates: Array,
    images: Array,
) -> UndampedModes:
    """Return modes, and zeros for squares below rounding.

    Images (x, mu) of orthonormal estimates (n, k) have more accurate small motions of stiff parts,
    but rounding adds slower motions.
    """
    squares, n, mass = 1.0 / inverses - square, lin.equations.n, lin.tangent.mass
    order = np.argsort(np.abs(squares), kind="stable")
    squares, images = squares[order], images[:, order] / inverses[order]
    (upper,) = la.qr(estimates[:, order].T @ (mass @ images[:n]), mode="r")
    images = la.solve_triangular(upper, images.T, trans=1).T
    inertia = np.einsum("ij,ij->j", images[:n], mass @ images[:n])
    stiffness = np.einsum("ij,ij->j", images[:n], lin.tangent.stiffness @ images[:n])
    squares = (stiffness + lin.compliance @ images[n:] ** 2) / inertia
    rounding = saddle.rounding(images) / inertia + _flexibility_rounding(lin, square)
    is_zero = np.abs(squares) <= np.maximum(rounding, lin.zero_square)
    return UndampedModes(np.where(is_zero, 0.0, squares), images[:n] / np.sqrt(inertia))


def _flexibility_rounding(lin: LinearizedEquations, square: float) -> float:
    """Return a bound on the rounding error of squares near zero, as eigenvalues at a shift."""
    return lin.equations.n * float(np.finfo(float).eps) * square


def _admissible_motions(lin: LinearizedEquations, mass: sp.csc_array) -> Array:
    """Return a basis (n, k) of the motions that rigid constraints allow, with X^T M X = I.

    Coordinates are scaled by their inertia, so that small parts count as much as large ones.
    """
    inertia, scales = mass.diagonal(), lin.equations.position_scales
    largest = float(np.max(inertia * scales**2, initial=0.0)) or 1.0
    sizes = np.sqrt(
        np.where(inertia > 0.0, 1.0 / np.where(inertia > 0.0, inertia, 1.0), scales**2 / largest)
    )
    rows = sp.csc_array(lin.rows[lin.compliance == 0.0]).toarray()
    basis = sizes[:, None] * _null_space(rows * sizes)
    gram = basis.T @ (mass @ basis)
    try:
        lower = la.cholesky(gram, lower=True)
        is_massless = np.min(lower.diagonal()) ** 2 <= np.finfo(float).eps * len(lower)
    except la.LinAlgError:
        is_massless = True
    if is_massless:
        massless = basis @ la.eigh(gram)[1][:, 0] / scales
        raise MasslessError(lin.equations.q_names[int(np.argmax(np.abs(massless)))])
    return np.asarray(la.solve_triangular(lower, basis.T, lower=True).T)


def _random(size: int, count: int) -> Array:
    return np.random.default_rng(0).standard_normal((count, size)).T


def _convergence_error(count: int | None) -> BeamdaeError:
    return BeamdaeError(
        f"modes: the {count} lowest modes were not found, because many eigenvalues are close to "
        "each other; request fewer modes, or use fewer elements: up to "
        f"{_MAX_FALLBACK_COORDINATES} coordinates, all modes are computed."
    )


def solve_damped(
    lin: LinearizedEquations, count: int | None, max_damping_ratio: float = 1.0
) -> tuple[Array, Array]:
    """Return eigenvalues (k,) [1/s] and mode shapes (n, k) of the quadratic problem, not sorted.

    There are usually more than `count`. If `count` is None, only modes that are lost in rounding
    are missing. Each conjugate pair is represented by the eigenvalue with positive imaginary part,
    and each free motion by one zero.

    Parameters
    ----------
    lin
        Linearized equations.
    count
        Number of modes of interest, or None for all modes.
    max_damping_ratio
        If below 1, modes with a larger damping ratio do not count, and may be missing. Sparse
        matrices then give the other modes up to the highest undamped frequency of interest, which
        may be fewer than `count`.

    Raises
    ------
    BeamdaeError
        If the equations are singular at the shift, or many eigenvalues are too close to each other.
    """
    n = lin.equations.n
    is_dense = count is None or n <= _MAX_DENSE_COORDINATES or 2 * count + 6 >= n
    undamped = solve_undamped_without_states(lin, None if is_dense else count)
    sizes = np.abs(undamped.squares)
    rates = np.sqrt(np.sort(sizes[sizes > 0.0])[: count or _DEFAULT_COUNT])
    # In the middle of the modes of interest, low and high modes lose equal accuracy. Round numbers
    # may be eigenvalues.
    shift = float(_SHIFT_RATIO * np.sqrt(rates[0] * rates[-1])) if len(rates) else np.pi
    if count is not None and not is_dense:
        limit = float(rates[-1]) if len(rates) and max_damping_ratio < 1.0 else np.inf
        modes = _solve_sparse(lin, undamped, shift, count, max_damping_ratio, limit)
        if modes is not None:
            return _clean(lin, undamped, shift, *modes, 1.0)
        if n > _MAX_FALLBACK_COORDINATES:
            raise _convergence_error(count)
        undamped = solve_undamped_without_states(lin, None)
    return _clean(lin, undamped, shift, *_solve_all(lin, undamped, shift))


def solve_undamped_without_states(lin: LinearizedEquations, count: int | None) -> UndampedModes:
    """Return the result of `solve_undamped` with first-order states held."""
    moving = np.setdiff1d(np.arange(lin.equations.n), lin.equations.states)
    if len(moving) == lin.equations.n:
        return solve_undamped(lin, count)
    squares, shapes = solve_undamped(lin.select(moving, np.arange(lin.equations.m)), count)
    padded = np.zeros((lin.equations.n, len(squares)))
    padded[moving] = shapes
    return UndampedModes(squares, padded)


def _solve_all(
    lin: LinearizedEquations, undamped: UndampedModes, shift: float
) -> tuple[Array, Array, float]:
    """Return all eigenvalues, shapes and the amplification of rounding from dense matrices.

    Symmetric reactions permit the coordinates of undamped modes, whose stiffness is accurate.
    Without damping, l^2 is computed, which is twice as accurate near coalescing modes.
    """
    tangent, e, shapes = lin.tangent, lin.equations, undamped.shapes
    is_special = not lin.has_gradient_reactions or len(e.states) + len(e.nonholonomic_rows) > 0
    if lin.has_rates and is_special:
        basis, left = _motions_and_speeds(lin, shift)
        inverse = left @ _invert(lin, shift)(basis)[: len(basis)]
    else:
        stiffness = np.diag(undamped.squares)
        if not lin.is_symmetric:
            skew = tangent.stiffness - tangent.stiffness.T
            stiffness += 0.5 * _project(shapes, skew, shapes)
        identity = np.eye(len(stiffness))
        if not lin.has_rates:
            inverses, vectors = la.eig(np.linalg.inv(stiffness + shift**2 * identity))
            return *_roots_of_squares(shift**2 - 1.0 / inverses, shapes @ vectors), 1.0
        # Coordinates of unit energy.
        sizes = np.sqrt(np.abs(undamped.squares) + shift**2)
        damping = _project(shapes, tangent.damping, shapes)
        matrix = np.block(
            [
                [-shift * identity, np.diag(sizes)],
                [-stiffness / sizes, -damping - shift * identity],
            ]
        )
        weights = 1.0 / np.max(np.abs(matrix), axis=1)
        inverse = np.linalg.solve(weights[:, None] * matrix, np.diag(weights))
        basis = np.hstack([shapes / sizes, np.zeros_like(shapes)])
    # Rounding splits double zeros by this factor times the root of the machine precision.
    amplification = max(1.0, shift * float(la.norm(inverse)))
    inverses, vectors = la.eig(inverse)
    accurate = np.abs(inverses) > _MIN_INVERSE_RATIO * np.max(np.abs(inverses), initial=0.0)
    values, shapes = shift + 1.0 / inverses[accurate], basis[: e.n] @ vectors[:, accurate]
    return values, shapes, amplification


def _motions_and_speeds(lin: LinearizedEquations, shift: float) -> tuple[Array, Array]:
    """Return a basis (2 n, k) of the admissible (x, x'), and its left inverse.

    Constraints on speeds, J x + V x' = 0, do not constrain x. States have no inertia.
    """
    e, tangent, rolling = lin.equations, lin.tangent, lin.nonholonomic
    position, velocity = (
        x.toarray() for x in (tangent.position_jacobian, tangent.velocity_jacobian)
    )
    rigid = position[~rolling & (lin.compliance == 0.0)]
    states = np.eye(e.n)[e.states]
    scales = np.concatenate([e.position_scales, shift * e.position_scales])
    rows = np.vstack(
        [
            la.block_diag(rigid, np.vstack([rigid, states])),
            np.hstack([position, velocity])[rolling],
        ]
    )
    basis = _null_space(rows * scales)
    return scales[:, None] * basis, basis.T / scales


def _null_space(rows: Array) -> Array:
    """Return an orthonormal basis (n, k) of the null space of independent rows (m, n)."""
    lengths = la.norm(rows, axis=1)[:, None]
    return la.qr((rows / lengths).T)[0][:, len(rows) :] if len(rows) else np.eye(rows.shape[1])


def _project(left: Array, matrix: sp.csc_array, right: Array) -> Array:
    """Return L^T A R with zeros in place of rounding errors."""
    product = left.T @ (matrix @ right)
    rounding = _ROUNDING_RATIO * (np.abs(left).T @ (abs(matrix) @ np.abs(right)))
    return np.where(np.abs(product) <= rounding, 0.0, product)


def _roots_of_squares(squares: Array, shapes: Array) -> tuple[Array, Array]:
    """Return the eigenvalues with these squares, and their shapes.

    Either sign of a root is an eigenvalue; complex ones are represented by the upper of each pair.
    """
    is_real = np.abs(squares.imag) <= _IMAGINARY_TOLERANCE * np.abs(squares)
    values = np.sqrt(np.where(is_real, squares.real, squares).astype(complex))
    values = np.where(values.imag < 0.0, -values, values)
    decaying = values.imag == 0.0
    return np.append(values, -values[decaying]), np.hstack([shapes, shapes[:, decaying]])


def _solve_sparse(
    lin: LinearizedEquations,
    undamped: UndampedModes,
    s: float,
    count: int,
    max_damping_ratio: float,
    limit: float,
) -> tuple[Array, Array] | None:
    """Return the `count` modes with the smallest |l|, or None.

    With y = (x, l x), the eigenvalues of the inverse about the shift s are 1 / (l - s); without
    damping, those of the inverse with y = x are 1 / (s^2 - l^2). Conjugate eigenvalues count once;
    for `max_damping_ratio`, see `solve_damped`. The Krylov space begins with the undamped modes, as
    displacements and as velocities, and with random motions, because strong dampers slow down
    other motions. The result is None if it does not converge.
    """
    n, shapes, mass = lin.equations.n, undamped.shapes, lin.tangent.mass
    free = _undamped_free_motions(lin, undamped)
    weighted_free, invert = (mass @ free).T, _invert(lin, s)
    # Double zeros are one free motion.
    count += int(np.sum(undamped.squares == 0.0)) - 2 * free.shape[1]
    if count <= 0:
        return np.zeros(free.shape[1], complex), free
    scales, has_rates = lin.equations.position_scales, lin.has_rates

    def apply(y: Array, invert: Callable[[Array], Array] = invert) -> Array:
        parts = np.split(invert(y)[: len(y)], len(y) // n)
        return np.vstack([x - free @ (weighted_free @ x) for x in parts])

    if has_rates:
        scales, shapes = np.concatenate([scales, s * scales]), la.block_diag(shapes, s * shapes)
    start = np.hstack([shapes, scales[:, None] * _random(len(scales), max(count, 2))])
    work = (_FIRST_BLOCKS * start.shape[1]) ** 3
    if n <= _MAX_FALLBACK_COORDINATES and takes_longer_than_dense(work, len(start)):
        return None
    metric = _energy(lin, undamped, s) if has_rates else sp.csr_array(mass)
    krylov = BlockKrylov(apply, apply(start), metric, is_symmetric=False, blocks=_FIRST_BLOCKS)

    def find_values(inverses: Array) -> Array:
        return s + 1.0 / inverses if has_rates else s**2 - 1.0 / inverses

    def find_wanted(values: Array) -> tuple[Array, float]:
        """Return a mask of the wanted eigenvalues, and the largest size of interest."""
        sizes = np.abs(values)
        is_candidate = (values.real >= -max_damping_ratio * sizes) | (not has_rates)
        # Either eigenvalue of a conjugate pair counts half.
        numbers = is_candidate * np.where(has_rates & (values.imag != 0.0), 0.5, 1.0)
        order = np.argsort(sizes, kind="stable")
        last = min(int(np.searchsorted(np.cumsum(numbers[order]), count)), len(order) - 1)
        highest = min(float(sizes[order[last]]), limit if has_rates else np.inf)
        return is_candidate & (sizes <= highest), highest

    def required_accuracy(inverses: Array) -> Array:
        values, center = find_values(inverses), s if has_rates else s**2
        is_wanted, highest = find_wanted(values)
        # No eigenvalue outside this circle about the shift is smaller.
        is_near = np.abs(values - center) <= highest + center
        if has_rates:
            is_near &= -values.real <= 0.5 * (1.0 + max_damping_ratio) * np.abs(values)
        others = np.where(is_near, _LOCATION_ACCURACY, np.inf)
        return np.where(is_wanted, _REFINABLE_ACCURACY, others)

    if not krylov.converge(required_accuracy, 1 if max_damping_ratio < 1.0 else 0):
        return None
    for is_last in (*[False] * _REFINEMENTS, True):
        values = find_values(krylov.values)
        is_wanted = find_wanted(values)[0]
        is_inexact = (krylov.residuals > _ACCURACY) & (values.imag >= 0.0)
        (wanted,), (inexact,) = np.nonzero(is_wanted), np.nonzero(is_wanted & is_inexact)
        if is_last or not len(inexact):
            break
        # Inverse iteration extends the space. It does not separate modes of a cluster.
        shifts = values[inexact] if has_rates else np.sqrt(values[inexact].astype(complex))
        directions = [
            apply(y[:, None], _invert(lin, shift))
            for y, shift in zip(krylov.vectors(inexact).T, shifts.tolist(), strict=True)
        ]
        krylov.extend(np.hstack([part for x in directions for part in (x.real, x.imag)]))
    # Rounding of the stiffness in the metric does not enter quotients of inertia.
    vectors = krylov.vectors(wanted)
    real, imaginary = np.split(invert(np.hstack([vectors.real, vectors.imag])), 2, axis=1)
    images, momenta = real + 1j * imaginary, (mass @ vectors[:n]).conj()
    quotients = np.sum(momenta * images[:n], axis=0) / np.sum(momenta * vectors[:n], axis=0)
    values, images = find_values(quotients), images / quotients
    shapes = images[:n] - free @ (weighted_free @ images[:n])
    if has_rates and lin.is_symmetric:
        values = _refine_values(lin, values, shapes, images[2 * n :])
    if not has_rates:
        values, shapes = _roots_of_squares(values, shapes)
    return np.append(np.zeros(free.shape[1]), values), np.hstack([free, shapes])


def _refine_values(lin: LinearizedEquations, values: Array, x: Array, mu: Array) -> Array:
    """Return the roots l of x^H (l^2 M + l D + K) x + mu^H C mu = 0 nearest to the values."""
    tangent = lin.tangent
    m, c, k = (
        np.einsum("ij,ij->j", x.conj(), matrix @ x)
        for matrix in (tangent.mass, tangent.damping, tangent.stiffness)
    )
    m, k = m.real, k.real + lin.compliance @ np.abs(mu) ** 2
    root = np.sqrt(c**2 - 4.0 * m * k + 0j)
    # The larger sum, and its partner from the product of the roots, do not cancel.
    larger = -0.5 * (c + np.where((c.conj() * root).real >= 0.0, root, -root))
    roots = np.stack([larger / m, k / np.where(larger == 0.0, 1.0, larger)])
    return roots[np.argmin(np.abs(roots - values), axis=0), np.arange(len(values))]


def _invert(lin: LinearizedEquations, s: complex) -> Callable[[Array], Array]:
    """Return the inverse of the linearization about a shift; see `_solve_sparse`.

    Images of y are followed by multipliers.
    """
    tangent, n = lin.tangent, lin.equations.n
    saddle = _Saddle(
        tangent.stiffness + s * tangent.damping + s**2 * tangent.mass,
        tangent.reactions,
        tangent.position_jacobian + s * tangent.velocity_jacobian,
        lin.compliance,
    )

    def apply(y: Array) -> Array:
        x = y[:n]
        if not lin.has_rates:
            return saddle.solve(tangent.mass @ x)
        force = tangent.mass @ (y[n:] + s * x) + tangent.damping @ x
        image = saddle.solve(-force, -(tangent.velocity_jacobian @ x))
        return np.vstack([image[:n], x + s * image[:n], image[n:]])

    return apply


def _undamped_free_motions(lin: LinearizedEquations, undamped: UndampedModes) -> Array:
    """Return the free motions (n, k) on which no damper acts, scaled to x^T M x = 1.

    The result is empty if the equations are not symmetric: follower loads couple free motions to
    other modes. Without these motions, large eigenvalues of the inverse hide no slow modes.
    """
    free, damping = undamped.shapes[:, undamped.squares == 0.0], lin.tangent.damping
    if not lin.is_symmetric:
        return free[:, :0]
    free = free @ la.inv(la.cholesky(free.T @ (lin.tangent.mass @ free))) if free.size else free
    free = free @ la.eigh(free.T @ (damping @ free))[1]
    forces, rounding = np.abs(damping @ free), abs(damping) @ np.abs(free)
    return free[:, np.all(forces <= _FREE_ROUNDING * rounding, axis=0)]


def _energy(lin: LinearizedEquations, undamped: UndampedModes, s: float) -> sp.csr_array:
    """Return the metric of the energy, in which undamped problems have orthogonal modes.

    Inertia exceeds rounding errors and negative stiffness.
    """
    stiffness, mass = lin.tangent.stiffness, lin.tangent.mass
    bounds = quadratic_form_rounding(stiffness, undamped.shapes) / _ENERGY_ROUNDING
    square = max(s**2, float(np.max(bounds, initial=0.0)))
    square += 2.0 * float(np.max(-undamped.squares, initial=0.0))
    states = sp.diags_array(1.0 * np.isin(np.arange(lin.equations.n), lin.equations.states))
    weight = 0.5 * (stiffness + stiffness.T) + square * (mass + states)
    return sp.csr_array(sp.block_diag([weight, mass]))


def _clean(
    lin: LinearizedEquations,
    undamped: UndampedModes,
    shift: float,
    values: Array,
    shapes: Array,
    amplification: float,
) -> tuple[Array, Array]:
    """Return upper eigenvalues and shapes, with zeros in place of rounding errors.

    Each free motion is represented by one zero.
    """
    tangent, states, size = lin.tangent, lin.equations.states, np.abs(values)
    inertia = np.einsum("ij,ij->j", shapes.conj(), tangent.mass @ shapes).real
    inertia += np.sum(np.abs(shapes[states]) ** 2, axis=0)
    shapes = shapes / np.sqrt(np.where(inertia > 0.0, inertia, 1.0))
    matrix = tangent.stiffness + shift * tangent.damping + shift**2 * tangent.mass
    rounding = quadratic_form_rounding(matrix, shapes) + _flexibility_rounding(
        lin, (amplification * shift) ** 2
    )
    rounding = np.maximum(rounding, lin.zero_square)
    real = np.where(np.abs(values.real) <= _REAL_TOLERANCE * size, 0.0, values.real)
    imaginary = np.where(np.abs(values.imag) <= _IMAGINARY_TOLERANCE * size, 0.0, values.imag)
    if lin.is_symmetric and not len(states):
        # The imaginary part of x^H (l^2 M + l D + K) x = 0 contains no stiffness.
        power = np.einsum("ij,ij->j", shapes.conj(), tangent.damping @ shapes)
        is_lossless = np.abs(power.real) <= quadratic_form_rounding(tangent.damping, shapes)
        momentum = 2.0 * imaginary + power.imag
        is_regular = np.abs(momentum) > _MIN_MOMENTUM * np.abs(imaginary)
        is_regular &= imaginary != 0.0
        loss = np.where(is_lossless, 0.0, power.real) * imaginary
        real = np.where(is_regular, -loss / np.where(is_regular, momentum, 1.0), real)
        real[is_lossless & (imaginary != 0.0) & (real**2 <= rounding)] = 0.0
    is_zero = size**2 <= rounding
    if lin.is_symmetric and not len(states) + len(lin.equations.nonholonomic_rows):
        # The same motions are free with and without dampers.
        momenta = (tangent.mass @ undamped.shapes[:, undamped.squares == 0.0]).T
        is_zero &= np.sum(np.abs(momenta @ shapes) ** 2, axis=0) > 0.5
    scales = lin.equations.position_scales[:, None]
    parts = shapes[:, is_zero] / scales
    parts = parts / la.norm(parts, axis=0)
    left, singular, _ = la.svd(np.hstack([parts.real, parts.imag]), full_matrices=False)
    free = scales * left[:, singular > _RANK_TOLERANCE * np.max(singular, initial=0.0)]
    is_upper = ~is_zero & (imaginary >= 0.0)
    return (
        np.append(np.zeros(free.shape[1]), (real + 1j * imaginary)[is_upper]),
        np.hstack([free, shapes[:, is_upper]]),
    )
