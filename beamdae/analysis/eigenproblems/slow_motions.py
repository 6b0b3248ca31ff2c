"""Slowest motions of linearized equations.

The modes x exp(l t) solve (l^2 M + l D + K) x + H mu = 0 and (J + l V) x - C mu = 0, where C is
diagonal, with ones for the constraints of the mixed form and zeros for others. They are the largest
eigenvalues of the flexibility, the inverse of the saddle-point matrix [[K, H], [J, -C]] at a shift
(Ericsson & Ruhe, Math. Comput. 35 (1980) 1251; Tisseur & Meerbergen, SIAM Rev. 43 (2001) 235).
Small problems use all admissible motions, large ones an invariant space found by ARPACK.

Quantities below the rounding error of the saddle-point matrix in their motion are zero.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.analysis.continuation.spectrum import (
    EXTRA_VALUES,
    MAX_DENSE,
    find_slow_space,
    invert_motion,
)
from beamdae.analysis.eigenproblems.linearized_equations import (
    ROUNDING_RATIO,
    LinearizedEquations,
    is_symmetric_matrix,
    quadratic_forms,
)
from beamdae.errors import BeamdaeError

Array = np.ndarray

# Largest number of coordinates for dense matrices if ARPACK does not find the slowest motions.
_MAX_FALLBACK_COORDINATES = 800
# A shift s^2 is kept between the first multiple of the smallest square that is not zero (0 if none
# is zero) and this square. Otherwise, it becomes the second multiple, at least the third of itself.
_MIN_SQUARE_SHARE, _SQUARE_RATIO, _MIN_REDUCTION = 1e-6, 0.4, 1e-2
# Numbers of shifts, and of vectors and iterations of the estimates; squares that are zero, relative
# to a shift and to the last shift.
_MAX_SHIFTS, _BLOCK_SIZE, _ITERATIONS, _SLOW_RATIO, _ZERO_RATIO = 20, 8, 4, 1e-9, 1e-11
# Shift relative to the geometric mean of the lowest and highest frequency of interest; a factor of
# one would hit the frequency of a single mode. If all modes are requested, the lowest ten count.
_SHIFT_RATIO, _DEFAULT_COUNT = 0.6, 10
# Eigenvalues of the inverse below this fraction of the largest are lost in rounding.
_MIN_INVERSE_RATIO = 1e-13
# Images under the flexibility replace shapes if this share of their kinetic energy is not parallel.
_MAX_IMAGE_DEVIATION = 1e-6
# Imaginary and real parts up to these fractions of the eigenvalue are rounding errors.
_IMAGINARY_TOLERANCE, _REAL_TOLERANCE = 1e-9, 1e-12
# Largest relative correction of eigenvalues.
_MAX_CORRECTION = 1e-5
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


class _Motions(NamedTuple):
    """Motions (N, k), the rows (k, N) of a left inverse, and their images under the flexibility."""

    basis: Array
    left: Array
    images: Array


def quadratic_form_rounding(matrix: sp.csc_array, shapes: Array) -> Array:
    """Return a bound (k,) on the rounding error of x^H A x for each column x of `shapes`."""
    return ROUNDING_RATIO * quadratic_forms(abs(matrix), np.abs(shapes))


def solve_undamped(lin: LinearizedEquations, count: int | None) -> tuple[Array, Array]:
    """Return squared angular frequencies (k,) [1/s^2] and shapes (n, k), x^T M x = 1, in order.

    They are those of the symmetric parts of M and K under G x - C mu = 0, with first-order states
    held; squares of unstable motions are negative. All modes or, of large problems, the `count`
    modes with the smallest |squares|.

    Raises
    ------
    MasslessError
        If the matrices are dense and an admissible motion has no inertia.
    BeamdaeError
        If many eigenvalues are too close to each other to be separated.
    """
    e = lin.equations
    if e.n - len(e.states) <= e.m:
        return np.zeros(0), np.zeros((e.n, 0))
    lin = lin.symmetrized()
    square = _choose_shift(lin)

    def find_missing(inverses: Array, bound: float) -> float:
        is_known = np.abs(1.0 / inverses - square) <= 1.0 / bound - square
        return (count or 0) - float(np.sum(is_known))

    space = _find_motions(lin, np.sqrt(square), count, find_missing)
    squares, shapes = _solve_symmetric(lin, space, square, count)
    order = np.argsort(squares, kind="stable")
    return squares[order], shapes[:, order]


def _choose_shift(lin: LinearizedEquations) -> float:
    """Return s^2 near the smallest square that is not zero, by inverse iteration."""
    first = square = lin.rounding_square
    scales = _find_scales(lin, 0.0)[:, None]
    block = np.random.default_rng(0).standard_normal((len(scales), _BLOCK_SIZE))
    for _ in range(_MAX_SHIFTS):
        invert = _invert(lin, np.sqrt(square))
        for _ in range(_ITERATIONS):
            basis = la.orth(block)
            block = invert(scales * basis) / scales
        inverses, vectors = la.eig(basis.T @ block)
        # Motions without inertia are infinitely fast.
        inverses, vectors = inverses[inverses != 0.0], vectors[:, inverses != 0.0]
        sizes, shapes = np.abs(1.0 / inverses - square), scales * (basis @ vectors.real)
        is_zero = sizes <= np.maximum(_bound_rounding(lin, shapes, square), _SLOW_RATIO * square)
        slowest = float(np.min(sizes[~is_zero], initial=np.inf))
        min_square = _MIN_SQUARE_SHARE * slowest if np.any(is_zero) else 0.0
        if min_square <= square <= slowest < np.inf:
            return square
        # A shift that is too large hides all squares, or distinguishes no free motions.
        share = 0.0 if np.isinf(slowest) else _SQUARE_RATIO * slowest / square
        square *= max(share, _MIN_REDUCTION)
    return square if np.isfinite(slowest) else first


def _solve_symmetric(
    lin: LinearizedEquations, motions: _Motions, square: float, count: int | None
) -> tuple[Array, Array]:
    """Return squares (k,) and shapes (n, k): fast shapes from the stiffness, others from images.

    Errors of the flexibility are relative to the slowest mode, those of the stiffness to the
    fastest one. Errors of squares are of second order in those of the shapes.
    """
    mass, stiffness = lin.tangent.mass, lin.tangent.stiffness
    basis, _, images = motions
    gram = basis.T @ (mass @ basis)
    try:
        lower = la.cholesky(gram, lower=True)
        is_massless = np.min(lower.diagonal() ** 2, initial=1.0) <= np.finfo(float).eps * len(gram)
    except la.LinAlgError:
        is_massless = True
    if is_massless:
        massless = basis @ la.eigh(gram)[1][:, 0] / lin.equations.position_scales
        raise MasslessError(lin.equations.q_names[int(np.argmax(np.abs(massless)))])
    basis, images = (la.solve_triangular(lower, x.T, lower=True).T for x in (basis, images))
    flexibility, reduced = basis.T @ (mass @ images), basis.T @ (stiffness @ basis)
    inverses, vectors = la.eigh(0.5 * (flexibility + flexibility.T))
    largest = np.max(np.abs(inverses), initial=0.0) or 1.0
    is_fast = np.abs(inverses) < np.sqrt(largest / max(la.norm(reduced), 1.0 / largest))
    is_fast[np.argsort(-np.abs(inverses), kind="stable")[:count]] &= count is None
    rest, slow = vectors[:, is_fast], vectors[:, ~is_fast]
    estimates, images = basis @ slow, images @ slow
    order = np.argsort(-np.abs(inverses[~is_fast]), kind="stable")
    shapes = _combine(images, estimates, mass)[:, order]
    upper = la.cholesky(shapes.T @ (mass @ shapes))
    shapes = la.solve_triangular(upper, shapes.T, trans=1).T
    squares = lin.energies(shapes)[0]
    squares = np.where(np.abs(squares) <= _bound_rounding(lin, shapes, square), 0.0, squares)
    fast, combinations = la.eigh(rest.T @ (0.5 * (reduced + reduced.T)) @ rest)
    return np.append(squares, fast), np.hstack([shapes, basis @ rest @ combinations])


def _bound_rounding(lin: LinearizedEquations, shapes: Array, square: float) -> Array:
    """Return the squared frequencies (k,) up to which those of shapes (n, k) are zero."""
    inertia = quadratic_forms(lin.tangent.mass, shapes).real
    # Forces that are not balanced turn with the motion.
    forces = np.abs(lin.tangent.residual[: len(shapes)]) / lin.equations.position_scales
    rounding = quadratic_form_rounding(lin.stiffness, shapes) + forces @ np.abs(shapes) ** 2
    rounding = rounding / np.where(inertia > 0.0, inertia, 1.0) + _ZERO_RATIO * square
    return np.maximum(rounding, lin.zero_square)


def _combine(images: Array, shapes: Array, mass: sp.csc_array) -> Array:
    """Return images (n, k) of mode shapes scaled to x^H M x = 1, or the shapes, if more accurate.

    Images have more accurate small motions of stiff parts. Those of fast modes contain rounding
    errors of slow ones; they are not parallel to the shapes.
    """
    products, image_squares, squares = (
        np.abs(np.einsum("ij,ij->j", x.conj(), mass @ y))
        for x, y in ((images, shapes), (images, images), (shapes, shapes))
    )
    is_parallel = products**2 >= (1.0 - _MAX_IMAGE_DEVIATION) * image_squares * squares
    sizes = np.sqrt(np.where(is_parallel, image_squares, squares))
    return np.where(is_parallel, images, shapes) / np.where(sizes > 0.0, sizes, 1.0)


def _find_motions(
    lin: LinearizedEquations,
    s: float,
    count: int | None,
    find_missing: Callable[[Array, float], float],
    free: Array | None = None,
) -> _Motions:
    """Return motions that span the slowest modes, or all admissible ones.

    Parameters
    ----------
    lin, s
        Equations and shift.
    count
        Number of modes of interest. None for all.
    find_missing
        Function from eigenvalues of the flexibility to the number of missing modes, if all that are
        larger than the second argument are known.
    free
        Motions (n, k) without stiffness and damping that are left out, with x^T M x = 1.
    """
    mass, n = lin.tangent.mass, lin.equations.n
    free = np.zeros((n, 0)) if free is None else free
    momenta, invert = (mass @ free).T, _invert(lin, s)

    def apply(y: Array) -> Array:
        parts = np.split(invert(y), len(y) // n)
        return np.vstack([x - free @ (momenta @ x) for x in parts])

    scales = _find_scales(lin, s)
    # Others than admissible motions are lost in the flexibility.
    admissible = (1 + lin.has_rates) * (n - lin.equations.m)
    number = (1 + lin.has_rates) * (count or n) + EXTRA_VALUES
    if n > MAX_DENSE and 2 * number < admissible:
        sizes = scales[:, None]
        space = find_slow_space(
            lambda y: apply(sizes * y) / sizes, len(scales), number, find_missing
        )
        if space.is_complete:
            return _Motions(sizes * space.basis, (space.basis / sizes).T, sizes * space.images)
        if n > _MAX_FALLBACK_COORDINATES:
            raise BeamdaeError(
                f"modes: the {count} lowest modes were not found, because many eigenvalues are "
                "close to each other; request fewer modes, or use fewer elements: up to "
                f"{_MAX_FALLBACK_COORDINATES} coordinates, all modes are computed."
            )
    basis = scales[:, None] * _null_space(_constraint_rows(lin, momenta) * scales)
    return _Motions(basis, (basis / scales[:, None] ** 2).T, apply(basis))


def _find_scales(lin: LinearizedEquations, s: float) -> Array:
    """Return sizes of the coordinates, and of their rates, that have equal inertia."""
    inertia, scales = lin.tangent.mass.diagonal(), lin.equations.position_scales
    has_inertia = inertia > 0.0
    largest = float(np.max(inertia * scales**2, initial=0.0)) or 1.0
    squares = np.where(has_inertia, 1.0 / np.where(has_inertia, inertia, 1.0), scales**2 / largest)
    sizes = np.sqrt(squares)
    return np.append(sizes, s * sizes) if lin.has_rates else sizes


def _constraint_rows(lin: LinearizedEquations, momenta: Array) -> Array:
    """Return rows whose null space contains the admissible x, or (x, x').

    Constraints on speeds, J x + V x' = 0, do not constrain x. States have no inertia.
    """
    e, tangent, rolling = lin.equations, lin.tangent, lin.nonholonomic
    states = np.eye(e.n)[e.states]
    if not lin.has_rates:
        return np.vstack([tangent.position_jacobian.toarray(), momenta, states])
    position, velocity = (
        x.toarray() for x in (tangent.position_jacobian, tangent.velocity_jacobian)
    )
    fixed = np.vstack([position[~rolling], momenta])
    return np.vstack(
        [
            la.block_diag(fixed, np.vstack([fixed, states])),
            np.hstack([position, velocity])[rolling],
        ]
    )


def _null_space(rows: Array) -> Array:
    """Return an orthonormal basis (n, k) of the null space of independent rows (m, n)."""
    lengths = la.norm(rows, axis=1)[:, None]
    return la.qr((rows / lengths).T)[0][:, len(rows) :] if len(rows) else np.eye(rows.shape[1])


def _invert(lin: LinearizedEquations, s: float) -> Callable[[Array], Array]:
    """Return the inverse of the linearization about a shift, see `invert_motion`."""
    n, pencil = lin.equations.n, lin.pencil
    _, damping, mass = (x[:, :n] for x in pencil.matrices)
    solve = pencil.factorize(s)
    if solve is None:
        raise BeamdaeError(
            "modes: the linearized equations are singular; add mass or stiffness to the parts "
            "that can move."
        )

    damping = damping if lin.has_rates else None
    return invert_motion(lambda forces: solve(forces)[:n], damping, mass, s)


def solve_damped(lin: LinearizedEquations, count: int | None) -> tuple[Array, Array]:
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

    Raises
    ------
    BeamdaeError
        If the equations are singular at the shift, or many eigenvalues are too close to each other.
    """
    squares, undamped = solve_undamped(lin, count or _DEFAULT_COUNT)
    sizes, still = np.abs(squares), undamped[:, squares == 0.0]
    rates = np.sqrt(np.sort(sizes[sizes > 0.0])[: count or _DEFAULT_COUNT])
    # In the middle of the modes of interest, low and high modes lose equal accuracy. Round numbers
    # may be eigenvalues.
    s = float(_SHIFT_RATIO * np.sqrt(rates[0] * rates[-1])) if len(rates) else np.pi
    free, has_rates, mass = _undamped_free_motions(lin, still), lin.has_rates, lin.tangent.mass
    # Double zeros are one free motion.
    needed = (count or 0) + still.shape[1] - 2 * free.shape[1]

    def find_values(inverses: Array) -> Array:
        return s + 1.0 / inverses if has_rates else s**2 - 1.0 / inverses

    def find_missing(inverses: Array, bound: float) -> float:
        values = find_values(inverses)
        is_known = np.abs(values) <= 1.0 / bound - (s if has_rates else s**2)
        # Either eigenvalue of a conjugate pair counts half.
        weights = np.where(has_rates & (values.imag != 0.0), 0.5, 1.0)
        return needed - float(np.sum(weights[is_known]))

    basis, left, images = _find_motions(
        lin, s, None if count is None else max(needed, 1), find_missing, free
    )
    inverses, vectors = la.eig(left @ images)
    is_accurate = np.abs(inverses) > _MIN_INVERSE_RATIO * np.max(np.abs(inverses), initial=0.0)
    inverses, vectors = inverses[is_accurate], vectors[:, is_accurate]
    n = lin.equations.n
    shapes = _combine(images[:n] @ vectors / inverses, basis[:n] @ vectors, mass)
    values = find_values(inverses)
    if has_rates and lin.is_symmetric and is_symmetric_matrix(lin.tangent.damping):
        values, shapes = _refine_values(lin, values, shapes)
    if not has_rates:
        values, shapes = _roots_of_squares(values, shapes)
    values = np.append(np.zeros(free.shape[1]), values)
    return _clean(lin, still, s, values, np.hstack([free, shapes]))


def _refine_values(lin: LinearizedEquations, values: Array, shapes: Array) -> tuple[Array, Array]:
    """Return values (k,) from quadratic forms of their shapes, and real shapes of decays.

    Errors of shapes enter values squared. ARPACK does not separate modes that decay at nearly the
    same rate, and gives complex pairs of them.
    """

    def forms(x: Array) -> tuple[Array, Array, Array]:
        return np.einsum("ij,ij->j", x, lin.tangent.mass @ x), *lin.energies(x)

    # An eigenvalue solves l^2 m + l d + k = 0 with the Hermitian forms of its shape.
    m, k, d = (sum(pair) for pair in zip(forms(shapes.real), forms(shapes.imag), strict=True))
    is_decay = d**2 >= 4.0 * m * k
    parts = np.where(values.imag < 0.0, shapes.imag, shapes.real)
    shapes = np.where(is_decay, parts, shapes)
    # x^T and not x^H: the left eigenvectors of symmetric matrices are conjugate.
    m, k, d = forms(shapes)
    root = np.sqrt(d**2 - 4.0 * m * k)
    root = np.where((d * root.conj()).real < 0.0, -root, root)
    slow, fast = -2.0 * k / (d + root), -0.5 * (d + root) / np.where(m != 0.0, m, 1.0)
    nearest = np.where(np.abs(slow - values) < np.abs(fast - values), slow, fast)
    is_accepted = is_decay & (nearest.imag == 0.0)
    is_accepted |= np.abs(nearest - values) <= _MAX_CORRECTION * np.abs(values)
    return np.where(is_accepted, nearest, values), shapes


def _undamped_free_motions(lin: LinearizedEquations, free: Array) -> Array:
    """Return the free motions (n, k) on which no damper acts, scaled to x^T M x = 1.

    The result is empty if the equations are not symmetric: follower loads couple free motions to
    other modes. Without these motions, large eigenvalues of the inverse hide no slow modes.
    """
    damping = lin.tangent.damping
    if not lin.is_symmetric:
        return free[:, :0]
    free = free @ la.inv(la.cholesky(free.T @ (lin.tangent.mass @ free))) if free.size else free
    free = free @ la.eigh(free.T @ (damping @ free))[1]
    scales = lin.equations.position_scales[:, None]
    # Coordinates without motion contain rounding errors of motions of natural size.
    sizes = scales * np.max(np.abs(free) / scales, axis=0, initial=0.0)
    forces, rounding = np.abs(damping @ free), abs(damping) @ sizes
    return free[:, np.all(forces <= _FREE_ROUNDING * rounding, axis=0)]


def _roots_of_squares(squares: Array, shapes: Array) -> tuple[Array, Array]:
    """Return the eigenvalues with these squares, and their shapes.

    Either sign of a root is an eigenvalue; complex ones are represented by the upper of each pair.
    """
    is_real = np.abs(squares.imag) <= _IMAGINARY_TOLERANCE * np.abs(squares)
    values = np.sqrt(np.where(is_real, squares.real, squares).astype(complex))
    values = np.where(values.imag < 0.0, -values, values)
    decaying = values.imag == 0.0
    return np.append(values, -values[decaying]), np.hstack([shapes, shapes[:, decaying]])


def _clean(
    lin: LinearizedEquations,
    free: Array,
    shift: float,
    values: Array,
    shapes: Array,
) -> tuple[Array, Array]:
    """Return upper eigenvalues and shapes, with zeros in place of rounding errors.

    Each free motion is represented by one zero.
    """
    tangent, states, size = lin.tangent, lin.equations.states, np.abs(values)
    inertia = quadratic_forms(tangent.mass, shapes).real
    inertia += np.sum(np.abs(shapes[states]) ** 2, axis=0)
    shapes = shapes / np.sqrt(np.where(inertia > 0.0, inertia, 1.0))
    rounding = _bound_rounding(lin, shapes, shift**2)
    kinetic, power = (quadratic_forms(x, shapes) for x in (tangent.mass, tangent.damping))
    real = np.where(np.abs(values.real) <= _REAL_TOLERANCE * size, 0.0, values.real)
    imaginary = np.where(np.abs(values.imag) <= _IMAGINARY_TOLERANCE * size, 0.0, values.imag)
    if lin.is_symmetric and not len(states):
        # The imaginary part of x^H (l^2 M + l D + K) x = 0 contains no stiffness.
        is_lossless = np.abs(power.real) <= quadratic_form_rounding(tangent.damping, shapes)
        momentum = 2.0 * imaginary + power.imag
        is_regular = np.abs(momentum) > _MIN_MOMENTUM * np.abs(imaginary)
        is_regular &= imaginary != 0.0
        loss = np.where(is_lossless, 0.0, power.real) * imaginary
        real = np.where(is_regular, -loss / np.where(is_regular, momentum, 1.0), real)
        real[is_lossless & (imaginary != 0.0) & (real**2 <= rounding)] = 0.0
    # |x^H K x| = |l^2 m + l d|: that of a slow decay comes from its damper.
    stiffness = size * np.abs(power + values * kinetic)
    inertia = np.where(kinetic.real > 0.0, kinetic.real, 1.0)
    is_zero = (size**2 <= rounding) & (stiffness <= rounding * inertia)
    if lin.is_symmetric and not len(states) + len(lin.equations.nonholonomic_rows):
        # The same motions are free with and without dampers.
        momenta = (tangent.mass @ free).T
        is_zero &= np.sum(np.abs(momenta @ shapes) ** 2, axis=0) > 0.5
    scales = lin.equations.position_scales[:, None]
    parts = shapes[:, is_zero] / scales
    parts = parts / la.norm(parts, axis=0)
    left, singular, _ = la.svd(np.hstack([parts.real, parts.imag]), full_matrices=False)
    independent = scales * left[:, singular > _RANK_TOLERANCE * np.max(singular, initial=0.0)]
    is_upper = ~is_zero & (imaginary >= 0.0)
    return (
        np.append(np.zeros(independent.shape[1]), (real + 1j * imaginary)[is_upper]),
        np.hstack([independent, shapes[:, is_upper]]),
    )
