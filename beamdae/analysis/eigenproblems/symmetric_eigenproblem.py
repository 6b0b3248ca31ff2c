"""Undamped modes: K x + G^T mu = w^2 M x under G x = 0, with symmetric K and M.

Small systems are solved by the dense inverse of K + s M in the null space of G, which gives all
modes. Large systems are solved by a block Krylov method about the negative shift -s, with the
multipliers among the unknowns of a sparse factorization (Ericsson & Ruhe, Math. Comput. 35 (1980)
1251). K may be singular, and infinite eigenvalues do not occur because all vectors satisfy G x = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.analysis.eigenproblems.block_krylov import BlockKrylov, converge
from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import LinearizedCoordinates, compute_tangent
from beamdae.equations.starts.rank import scaled_null_space
from beamdae.errors import BeamdaeError
from beamdae.linear.saddle_point import factorize_saddle_point

Array = np.ndarray
Solver = Callable[[Array], Array]

# Largest number of coordinates for which all modes are computed by dense matrices.
MAX_DENSE_COORDINATES = 250
# The same if a sparse method does not converge; all modes then take up to ten seconds.
MAX_FALLBACK_COORDINATES = 800
# Squared frequencies up to this fraction of the shift are treated as zero.
ZERO_SQUARE_RATIO = 1e-13
# Bound on the rounding error of x^H K x, relative to |x|^T |K| |x|. Free motions of straight,
# curved and welded beams of any mesh reach 6e-17.
_ROUNDING_RATIO = 1e-15
# Shift of dense matrices, relative to the lowest squared frequency that is not zero.
_DENSE_SHIFT_RATIO = 0.4
# Share of the kinetic energy of an image that is not parallel to its shape, up to which the image
# is used. Hundreds of images with this share remain independent.
_MAX_IMAGE_DEVIATION = 1e-6
# Smallest dense shift as a multiple of the rounding errors of squared frequencies.
_MIN_SHIFT_FACTOR = 1e3
# Shift of sparse matrices, relative to the largest ratio of stiffness to mass at first, and then
# relative to the highest squared frequency of interest, as estimated with this number of blocks.
# Low modes remain distinct although the shift exceeds their squared frequencies.
_INITIAL_SHIFT_RATIO = 1e-8
_SHIFT_RATIO = 1e-3
_ESTIMATION_BLOCKS = 3
# A shift is lowered if it exceeds the suitable shift by more than this factor, up to this number of
# times; estimates decrease from shift to shift.
_MAX_SHIFT_EXCESS = 10.0
_MAX_SHIFTS = 20
# Number of vectors in a block in addition to the number of modes.
_EXTRA_VECTORS = 2
# Factor applied to the shift if the matrix is singular.
_SINGULAR_SHIFT_FACTOR = 1.37
# Squared frequencies that cannot be distinguished from zero, relative to the largest squared
# frequency; and the smallest number with a finite inverse.
_DENSE_ZERO_RATIO = 1e-11
_MIN_INVERTIBLE = 1e-200
# Asymmetry up to which a matrix is treated as symmetric, relative to its largest entry: of exact
# matrices, and of matrices with finite differences. The first is small because a follower load is
# small compared with the axial stiffness of a thin beam.
_EXACT_TOLERANCE = 1e-13
_DIFFERENCE_TOLERANCE = 1e-9
# Deviation of the directions of reactions from the gradients of the constraints, relative to the
# largest gradient.
_REACTION_TOLERANCE = 1e-12


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


class SymmetricProblem:
    """Eigenvalue problem K x + G^T mu = w^2 M x, G x = 0 with the symmetric parts of K and M."""

    def __init__(self, lin: LinearizedEquations) -> None:
        tangent = lin.tangent
        self.e = lin.equations
        self.stiffness = _symmetric_part(tangent.stiffness)
        self.mass = _symmetric_part(tangent.mass)
        self.rows = tangent.acceleration_jacobian(lin.equations)
        self.mode_count, self.zero_square = self.e.n - self.e.m, lin.zero_square

    def solve(self, count: int | None) -> UndampedModes:
        """Return all modes or, with sparse matrices, the `count` modes with the smallest |w^2|.

        Sparse matrices are used for large systems if `count` is less than half the number of modes.

        Raises
        ------
        MasslessError
            If the matrices are dense and an admissible motion has no inertia.
        """
        if self.mode_count <= 0:
            return UndampedModes(np.zeros(0), np.zeros((self.e.n, 0)))
        is_small = self.e.n <= MAX_DENSE_COORDINATES
        if count is None or is_small or count >= self.mode_count // 2:
            shapes, shift = self._solve_dense()
        else:
            shapes, shift = self._solve_sparse(count)
        # The error of Rayleigh quotients is of second order in the error of the shapes.
        shapes = shapes / np.sqrt(np.einsum("ij,ij->j", shapes, self.mass @ shapes))
        squares, zero_squares = self._rayleigh_quotients(shapes, shift)
        squares[np.abs(squares) <= zero_squares] = 0.0
        order = np.argsort(squares, kind="stable")
        return UndampedModes(squares[order], shapes[:, order])

    def _rayleigh_quotients(self, shapes: Array, shift: float) -> tuple[Array, Array]:
        """Return x^T K x for each column x of `shapes`, and the size up to which it may be zero."""
        squares = np.einsum("ij,ij->j", shapes, self.stiffness @ shapes)
        rounding = quadratic_form_rounding(self.stiffness, shapes)
        return squares, np.maximum(rounding, max(ZERO_SQUARE_RATIO * shift, self.zero_square))

    def _solve_dense(self) -> tuple[Array, float]:
        """Return all shapes and the shift s, from the inverse of K + s M in the null space of G.

        With the inverse, the lowest modes are the most accurate. It is computed with the
        multipliers among the unknowns: the null space mixes the small motions of stiff parts with
        those of soft parts, which changed frequencies of beams by up to 400 %.
        """
        basis = orthonormal_motions(self.e, self.rows, self.mass)
        s = _shift_below(la.eigvalsh(basis.T @ (self.stiffness @ basis)))
        momenta = np.vstack([self.mass @ basis, np.zeros((self.e.m, basis.shape[1]))])
        for _ in range(_MAX_SHIFTS):
            solve = self._factorize(s)
            if solve is None:
                s *= _SINGULAR_SHIFT_FACTOR
                continue
            images = np.stack([solve(column)[: self.e.n] for column in momenta.T], axis=1)
            product = momenta[: self.e.n].T @ images
            inverses, vectors = la.eigh(0.5 * (product + product.T))
            # Slow modes are accurate, also growing ones, whose inverses are negative.
            vectors = vectors[:, np.argsort(-np.abs(inverses))]
            shapes = combine_images(images @ vectors, basis @ vectors, self.mass)
            shapes = orthonormalize(shapes, self.mass)
            squares, zero_squares = self._rayleigh_quotients(shapes, s)
            is_zero = np.abs(squares) <= zero_squares
            suitable = max(
                _DENSE_SHIFT_RATIO * float(np.min(np.abs(squares[~is_zero]), initial=np.inf)),
                _MIN_SHIFT_FACTOR * float(np.max(zero_squares[is_zero], initial=0.0)),
            )
            if s <= _MAX_SHIFT_EXCESS * suitable:
                break
            # Rounding errors of the first estimate hid slow modes.
            s = suitable
        return shapes, s

    def _factorize(self, s: float) -> Solver | None:
        """Return a solver of the saddle-point matrix of K + s M, or None if it is singular."""
        return factorize_saddle_point(self.stiffness + s * self.mass, self.rows.T, self.rows)

    def _solve_sparse(self, count: int) -> tuple[Array, float]:
        n, m = self.e.n, self.e.m
        inertia = self.mass.diagonal()
        has_inertia = inertia > 0.0
        ratios = np.abs(self.stiffness.diagonal()[has_inertia]) / inertia[has_inertia]
        s = _INITIAL_SHIFT_RATIO * float(np.max(ratios)) or 1.0
        # Random motions contain all modes.
        motions = np.random.default_rng(0).standard_normal((count + _EXTRA_VECTORS, n))
        block = (self.e.position_scales * motions).T
        for _ in range(_MAX_SHIFTS):
            solve = self._factorize(s)
            if solve is None:
                s *= _SINGULAR_SHIFT_FACTOR
                continue

            def invert(x: Array, solve: Solver = solve) -> Array:
                return solve(np.concatenate([self.mass @ x, np.zeros(m)]))[:n]

            block = np.stack([invert(x) for x in block.T], axis=1)
            krylov = BlockKrylov(
                invert, block, self.mass, is_symmetric=True, blocks=_ESTIMATION_BLOCKS
            )
            shapes = krylov.vectors(np.arange(len(krylov.values)))
            squares, zero_squares = self._rayleigh_quotients(shapes, s)
            lowest = np.argsort(np.abs(squares))
            block = shapes[:, lowest[: count + _EXTRA_VECTORS]]
            highest, zero_square = abs(squares[lowest[count - 1]]), zero_squares[lowest[count - 1]]
            suitable = max(_SHIFT_RATIO * highest, zero_square)
            if highest <= zero_square or s <= _MAX_SHIFT_EXCESS * suitable:
                break
            s = suitable

        def find_lowest(inverses: Array) -> Array:
            return np.argsort(np.abs(1.0 / inverses - s), kind="stable")[:count]

        def required_accuracy(inverses: Array) -> Array:
            accuracy = np.full(len(inverses), np.inf)
            accuracy[find_lowest(inverses)] = 0.0
            return accuracy

        def rounding(inverses: Array, shapes: Array) -> Array:
            return quadratic_form_rounding(self.stiffness, shapes) * np.abs(inverses)

        if not converge(krylov, required_accuracy, rounding):
            if n > MAX_FALLBACK_COORDINATES:
                raise convergence_error(count)
            return self._solve_dense()
        return krylov.vectors(find_lowest(krylov.values)), s


def convergence_error(count: int) -> BeamdaeError:
    """Return the error for eigenvalues that Krylov methods do not separate."""
    return BeamdaeError(
        f"modes: the {count} lowest modes were not found, because many eigenvalues are close to "
        "each other; request fewer modes, or use fewer elements: up to "
        f"{MAX_FALLBACK_COORDINATES} coordinates, all modes are computed."
    )


def is_symmetric(lin: LinearizedEquations) -> bool:
    """Return True if the eigenproblem without damping is symmetric.

    That is, K and M are symmetric, reactions act along the gradients of the constraints, and
    constraints on velocities do not depend on positions.
    """
    tangent = lin.tangent
    tolerance = _DIFFERENCE_TOLERANCE if lin.has_differences else _EXACT_TOLERANCE
    if not all(is_symmetric_matrix(x, tolerance) for x in (tangent.stiffness, tangent.mass)):
        return False
    if not lin.equations.m:
        return True
    # At rest, constraints on velocities constrain the shapes of vibrations.
    nonholonomic = lin.nonholonomic
    if nonholonomic.any() and abs(tangent.position_jacobian[nonholonomic]).max() > 0.0:
        return False
    rows = tangent.acceleration_jacobian(lin.equations)
    difference = abs(tangent.reactions.T - rows)
    return bool(difference.max() <= _REACTION_TOLERANCE * abs(rows).max())


def is_symmetric_matrix(matrix: sp.csc_array, tolerance: float = _EXACT_TOLERANCE) -> bool:
    """Return True if the asymmetry is at most `tolerance` times the largest entry."""
    if not matrix.nnz:
        return True
    return bool(abs(matrix - matrix.T).max() <= tolerance * abs(matrix).max())


def _symmetric_part(matrix: sp.csc_array) -> sp.csc_array:
    return sp.csc_array(0.5 * (matrix + matrix.T))


def _eliminated_null_space(rows: sp.csc_array, scales: Array) -> Array:
    """Return a basis (n, k) of the null space of `rows`: motions of one independent coordinate."""
    matrix = rows.toarray() * scales
    upper, pivots = la.qr(matrix, mode="r", pivoting=True)
    m, n = matrix.shape
    basis = np.zeros((n, n - m))
    basis[pivots[m:]] = np.eye(n - m)
    basis[pivots[:m]] = -la.solve_triangular(upper[:, :m], upper[:, m:])
    return scales[:, None] * basis


def orthonormal_motions(e: LinearizedCoordinates, rows: sp.csc_array, mass: sp.csc_array) -> Array:
    """Return a basis (n, k) of the motions x with `rows` x = 0, with X^T M X = I.

    Orthonormal motions combine those of all parts, whose rounding errors exceed the inertia of
    parts that are smaller by 1:1e4. Motions of single coordinates then take their place.

    Raises
    ------
    MasslessError
        If an admissible motion has no inertia.
    """
    scales = e.position_scales
    for find_basis in (scaled_null_space, _eliminated_null_space):
        basis = find_basis(rows, scales)
        inertia = basis.T @ (mass @ basis)
        try:
            lower = la.cholesky(inertia, lower=True)
        except la.LinAlgError:
            continue
        return np.asarray(la.solve_triangular(lower, basis.T, lower=True).T)
    massless = basis @ la.eigh(inertia)[1][:, 0] / scales
    raise MasslessError(e.q_names[int(np.argmax(np.abs(massless)))])


def orthonormalize(shapes: Array, mass: sp.csc_array) -> Array:
    """Return shapes with X^T M X = I, each a combination of itself and its predecessors."""
    shapes = shapes / np.sqrt(np.einsum("ij,ij->j", shapes, mass @ shapes))
    upper = la.cholesky(shapes.T @ (mass @ shapes))
    return np.asarray(la.solve_triangular(upper, shapes.T, trans=1).T)


def combine_images(images: Array, shapes: Array, mass: sp.csc_array) -> Array:
    """Return mode shapes (n, k), replaced by their images under the inverse where accurate.

    Images have more accurate small motions of stiff parts. Those of fast modes contain rounding
    errors of slow ones; they are not parallel to the shapes.
    """
    momenta = mass @ shapes
    products = np.abs(np.einsum("ij,ij->j", images.conj(), momenta)) ** 2
    image_squares, squares = (
        np.einsum("ij,ij->j", x.conj(), y).real
        for x, y in ((images, mass @ images), (shapes, momenta))
    )
    is_parallel = products >= (1.0 - _MAX_IMAGE_DEVIATION) * image_squares * squares
    return np.where(is_parallel, images, shapes)


def quadratic_form_rounding(matrix: sp.csc_array, shapes: Array) -> Array:
    """Return a bound (k,) on the rounding error of x^H A x for each column x of `shapes`."""
    sizes = np.abs(shapes)
    return _ROUNDING_RATIO * np.einsum("ij,ij->j", sizes, abs(matrix) @ sizes)


def _shift_below(squares: Array) -> float:
    """Return a shift s > 0 below the smallest nonzero |square|, or 1 if all are zero."""
    size = np.abs(squares)
    nonzero = size[size > max(_DENSE_ZERO_RATIO * np.max(size, initial=0.0), _MIN_INVERTIBLE)]
    return _DENSE_SHIFT_RATIO * float(np.min(nonzero)) if len(nonzero) else 1.0


@dataclass(frozen=True)
class FrequencyRange:
    """Range of the undamped natural frequencies about a state.

    If a coordinate has no inertia, nothing is computed: the frequencies are None, and the other
    numbers are 0.

    Attributes
    ----------
    lowest, highest
        Lowest and highest natural frequency [Hz]; None if nothing vibrates.
    damping_ratio
        Damping ratio of the mode with the highest frequency [-]; 0 if nothing vibrates.
    loose
        Number of free motions.
    growth_rate
        Largest growth rate of unstable motions [1/s], or 0.
    massless
        Name of a coordinate without inertia; "" if there is none.
    """

    lowest: float | None
    highest: float | None
    damping_ratio: float
    loose: int
    growth_rate: float
    massless: str

    def describe_growth(self) -> str:
        """Return a clause on the fastest growth from the start, or ""."""
        if not self.growth_rate > 0.0:
            return ""
        return f"a motion grows from the start at a rate of {self.growth_rate:.3g} 1/s"


def compute_frequency_range(e: EquationsOfMotion, time: Array, state: State) -> FrequencyRange:
    """Return the range of undamped natural frequencies about a consistent state.

    Constraints must be independent. First-order states are constant and do not count as free
    motions. The computing time grows with the cube of the number of coordinates.
    """
    tangent = compute_tangent(e, time, state)
    if len(e.states):
        moving = np.ones(e.n)
        moving[e.states] = 0.0
        keep = sp.diags_array(moving)
        stiffness, damping = (
            sp.csc_array(keep @ x @ keep) for x in (tangent.stiffness, tangent.damping)
        )
        mass = sp.csc_array(tangent.mass + sp.diags_array(1.0 - moving))
        tangent = tangent._replace(mass=mass, stiffness=stiffness, damping=damping)
    lin = LinearizedEquations(e, tangent)
    try:
        squares, shapes = SymmetricProblem(lin).solve(None)
    except MasslessError as error:
        return FrequencyRange(None, None, 0.0, 0, 0.0, error.coordinate)
    rates = np.sqrt(squares[squares > 0.0])
    ratio = 0.0
    if len(rates):
        fastest = shapes[:, -1]
        ratio = float(fastest @ (tangent.damping @ fastest) / (2.0 * rates[-1]))
    hertz = rates / (2.0 * np.pi)
    return FrequencyRange(
        float(hertz[0]) if len(rates) else None,
        float(hertz[-1]) if len(rates) else None,
        ratio,
        int(np.sum(squares == 0.0)) - len(e.states),
        float(np.sqrt(np.max(-squares, initial=0.0))),
        "",
    )
