"""Modes of thin beams from differences of the forces.

The stiffness matrix of a thin beam consists of axial stiffnesses EA, whose rounding errors are not
small compared with the bending stiffness EI = EA h^2 / 12. Differences of the forces at displaced
positions have no such error, see `LoadedEquations.multiply_tangent`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.analysis.eigenproblems.eigensolution import EigenSolution
from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.analysis.eigenproblems.symmetric_eigenproblem import quadratic_form_rounding
from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.analysis.statics.null_vectors import (
    natural_scales,
    remove_stiff_motions,
    row_sizes,
    solve_bordered_tangent,
    stiffness_rounding,
)
from beamdae.equations.formulations.tangents import Tangent
from beamdae.linear.saddle_point import factorize_saddle_point

Array = np.ndarray

# Differences replace the stiffness matrix if the bound on its rounding error exceeds this fraction
# of the squared frequency of a mode. The actual error is about 20 times smaller. With many more
# modes, errors of differences, which grow with the frequency, would exceed those of the matrix.
_MAX_ROUNDING_RATIO = 1e-8
# Larger relative errors of differences are accepted up to this fraction of the largest such bound:
# differences for the highest of the modes must not leave the slowest ones inaccurate.
_MAX_ERROR_RATIO = 1e-2
# Modes up to this multiple of the highest such squared frequency are included, because modes that
# nearly coincide determine each other.
_SQUARE_MARGIN = 2.0
# Combinations of mode shapes are dependent if their energy is below the first fraction of the
# largest one, and stiff if their inertia, relative to their energy, is below the second fraction of
# that of the modes. Flutter loads of lightly damped columns are up to 6e-6 off if combinations
# above the third fraction are left out; rounding errors of the stiffness determine their energy if
# the bound on these errors exceeds the fourth fraction of a squared frequency.
_MIN_ENERGY_RATIO = 1e-12
_MIN_INERTIA_RATIO = 1e-6
_MIN_ACCURATE_ENERGY_RATIO = 1e-14
_MAX_ENERGY_ROUNDING = 1e-3
# Values of the shift s of the energy x^T (K + s M) x, relative to the largest squared frequency, of
# which the first one is used that leaves no motion with inertia a negative energy. Next to limit
# points of damped structures, squared frequencies are small compared with negative energies, and
# more than the first number of shifts are necessary; otherwise, larger ones would not help.
_ENERGY_SHIFT_FACTORS = tuple(2.0 * 4.0 ** np.arange(25.0))
_MAX_USUAL_FACTOR = _ENERGY_SHIFT_FACTORS[6]
# Errors may exceed the difference between two steps by this factor, and are at least this fraction
# of the bound on the rounding error of the stiffness matrix: rigid-body motions of free strips have
# a stiffness of up to 6e-4 of it, and the bending of a strip with L/h = 1e5 and 64 elements has a
# stiffness of 5e-2 of it (measured).
ERROR_MULTIPLE = 4.0
ERROR_FLOOR = 5e-3
# Inverse iterations that change by more than this fraction have not converged.
_MAX_CORRECTION = 1e-3
# Rounding errors of the stiffness mix mode shapes if the bound on them exceeds this fraction of a
# squared frequency.
_MAX_MIXING = 3e-2
# Smaller shares of real and imaginary parts of mode shapes are rounding errors.
_MIN_SHARE = 1e-8
# Rounding errors of the damping from differences of the forces are below this fraction of the bound
# on those of the damping matrix: 1e-6 at L/h = 1e6 (measured), more if damped modes are mixed in.
_DAMPING_ROUNDING_RATIO = 1e-2
# Real and imaginary parts of k damped mode shapes span up to 4 k states, which have more
# eigenvalues than there are modes. Eigenvectors with at least this share in the states of the given
# modes are modes: shares of modes are above 0.28, of others below 2e-4 (L/h = 50 to 1e6, measured).
_MIN_MODE_SHARE = 1e-2
# Prevents division by zero for defective eigenvalues.
_TINY = 1e-300


class ReducedStiffness(NamedTuple):
    """Stiffness in the span of some displacements, from differences of the forces.

    Attributes
    ----------
    matrix
        B^T K B for the displacements B, (k, k).
    error
        Difference from the result with twice the step, (k, k).
    """

    matrix: Array
    error: Array


def reduce_stiffness(
    system: LoadedEquations, x: Array, mu: float, basis: Array
) -> ReducedStiffness:
    """Return the stiffness in the span of the displacements `basis`, (n, k), at x = (q, lam).

    Displacements that violate constraints by their rounding errors are corrected to first order:
    reactions, of the size of axial forces EA, do work on them.
    """
    n, scale = system.equations.n, system.scales
    directions = np.vstack([basis, np.zeros((len(x) - n, basis.shape[1]))])
    products = system.difference_forces(x, mu, directions, (1.0, 2.0, 4.0))
    one, two = (basis.T @ each[:n] for each in products)
    work = _reaction_work(system, x, mu, basis / scale[:, None], products[0][:n] * scale[:, None])
    return ReducedStiffness(one + work, one - two)


def _reaction_work(
    system: LoadedEquations, x: Array, mu: float, vectors: Array, forces: Array
) -> Array:
    """Return the work (k, k) of reactions to `forces` on violations of constraints by `vectors`.

    Displacements S^-1 q and forces S f, (n, k), have natural sizes.
    """
    n, m = system.equations.n, system.equations.m
    if not m:
        return np.zeros((vectors.shape[1],) * 2)
    tangent = system.matrix(system.tangent(x, mu))
    gradients = sp.csr_array(tangent[n:, :n]) * system.scales
    gradients = sp.csr_array(gradients * (1.0 / row_sizes(gradients))[:, None])
    try:
        solver = splu(sp.csc_matrix(gradients @ gradients.T))
    except RuntimeError:
        # Constraints are redundant at this point.
        return np.zeros((vectors.shape[1],) * 2)
    reactions = -solver.solve(gradients @ forces)
    work = reactions.T @ (gradients @ vectors)
    return work + work.T


def refine_subspace(
    system: LoadedEquations, x: Array, mu: float, basis: Array, weighted: Array
) -> Array | None:
    """Return soft motions with less admixture of other motions, orthonormal S^-1 q, (n, k).

    `basis`, (n, k), spans approximate motions, as eigenvectors of the stiffness matrix do, and
    `weighted`, (n, k), is their product with the mass or identity matrix. One inverse iteration
    with the stiffness from differences separates soft motions that rounding errors of the matrix
    have mixed. Rounding of the differences adds motions that stretch beams, which the matrix
    separates accurately. If the iteration does not converge, the result is None.
    """
    n, scales = system.equations.n, natural_scales(system, x, mu)
    zeros = np.zeros((len(x) - n, basis.shape[1]))
    left, right = (np.vstack([each, zeros]) for each in (weighted, basis))
    try:
        solution = solve_bordered_tangent(system, x, mu, scales, left, right)
        if not solution.correction <= _MAX_CORRECTION:
            return None
        soft = remove_stiff_motions(system, x, mu, scales, solution.vectors)
    except RuntimeError:
        # A matrix is singular.
        return None
    return la.qr(soft[:n], mode="economic")[0]


def refine_modes(
    system: LoadedEquations, x: Array, mu: float, lin: LinearizedEquations, modes: EigenSolution
) -> EigenSolution:
    """Return `modes` with those of thin beams from differences of the forces.

    They are the modes of the equations of motion in the span of the given shapes (Galerkin's
    method). The result is `modes` if the stiffness matrix is accurate enough, or differences are
    less accurate, for example where a contact begins. Of the refined modes, those that decay
    without oscillation may be missing, and eigenvalues that are zero up to the error are zero.
    """
    tangent = lin.tangent
    # Strongly damped motions are slow although they are stiff.
    energy = np.einsum("ij,ij->j", modes.shapes.conj(), tangent.stiffness @ modes.shapes)
    rounding = quadratic_form_rounding(tangent.stiffness, modes.shapes)
    squares = np.maximum(np.maximum(np.abs(modes.values) ** 2, np.abs(energy)), rounding)
    is_inaccurate = rounding > _MAX_ROUNDING_RATIO * squares
    # Constraints on velocities make the admissible shapes depend on the eigenvalue.
    if not np.any(is_inaccurate) or np.any(lin.nonholonomic):
        return modes
    is_refined = squares <= _SQUARE_MARGIN * np.max(squares[is_inaccurate])
    shapes = modes.shapes[:, is_refined]
    parts = np.hstack([shapes.real, shapes.imag])
    if modes.others is not None:
        parts = np.hstack([parts, modes.others])
    refined = None
    worst = float(np.max(rounding / np.maximum(squares, _TINY)))
    if worst > _MAX_MIXING:
        refined = _refine_shapes(system, x, mu, tangent, parts)
        parts = parts if refined is None else refined
    is_accurate = worst <= _MAX_ENERGY_ROUNDING
    min_energy_ratio = _MIN_ACCURATE_ENERGY_RATIO if is_accurate else _MIN_ENERGY_RATIO
    square = float(np.max(squares[is_refined]))
    basis = _span_soft_motions(tangent, parts, square, min_energy_ratio)
    if not basis.shape[1]:
        return modes
    reduced = reduce_stiffness(system, x, mu, basis)
    least = np.max(rounding[is_refined]) / _MAX_ROUNDING_RATIO
    sizes = np.sqrt(np.maximum(np.abs(np.diag(reduced.matrix)), least))
    max_error = max(_MAX_ROUNDING_RATIO, min(_MAX_ERROR_RATIO * worst, _MAX_CORRECTION))
    if not np.linalg.norm(reduced.error / sizes / sizes[:, None], 2) <= max_error:
        return modes
    damping, ratio = _reduce_damping(
        system, x, mu, tangent.damping, basis, np.median(squares[is_refined])
    )
    errors, floor = reduced.error, ERROR_FLOOR * float(np.max(rounding[is_refined]))
    if refined is not None:
        # The error of the extrapolated stiffness is below its last change.
        softest = basis[:, np.argmin(np.diag(reduced.matrix))]
        errors, floor = errors / 3.0, stiffness_rounding(system, x, mu, softest, softest)
    if not np.any(damping):
        squares, shares, errors = _solve_with_errors(-reduced.matrix, errors, floor)
        squares = np.where(np.abs(squares.imag) <= errors, squares.real + 0j, squares)
        values = np.sqrt(np.where(np.abs(squares) <= errors, 0.0, squares))
        shapes = basis @ shares
    else:
        none, one = np.zeros_like(damping), np.eye(len(damping))
        companion = np.block([[none, one], [-reduced.matrix, -damping]])
        values, shares, errors = _solve_with_errors(companion, errors, floor)
        states = _states_of_modes(tangent, basis, modes, is_refined)
        is_mode = _largest_shares(values, shares, states) > _MIN_MODE_SHARE
        values, shares, errors = values[is_mode], shares[:, is_mode], errors[is_mode]
        shares = shares / la.norm(shares, axis=0)
        shapes = basis @ shares
        oscillations = np.flatnonzero(values.imag > 0.0)
        if len(oscillations):
            ratios = np.abs(values[oscillations].real) / np.abs(values[oscillations])
            onset = oscillations[np.argmin(ratios)]
            values[onset] = _refine_onset(system, x, mu, tangent, values[onset], shapes[:, onset])
        # Errors of the stiffness move undamped eigenvalues off the imaginary axis.
        power = np.abs(np.einsum("ij,ij->j", shares.conj(), damping @ shares))
        is_undamped = power <= ratio * quadratic_form_rounding(tangent.damping, shapes)
        values = np.where(is_undamped & (np.abs(values.real) <= errors), 1j * values.imag, values)
        values = np.where(np.abs(values) <= errors, 0.0, values)
    is_upper = values.imag >= 0.0
    return EigenSolution(
        np.append(values[is_upper], modes.values[~is_refined]),
        np.hstack([shapes[:, is_upper], modes.shapes[:, ~is_refined]]),
    )


def _refine_onset(
    system: LoadedEquations, x: Array, mu: float, tangent: Tangent, value: complex, shape: Array
) -> complex:
    """Return the eigenvalue near `value` of the mode `shape`, (n,), from its left shape as well.

    The mode is an oscillation that is about to grow. Without a potential, errors of the shapes
    enter the eigenvalues of Galerkin's method in first order, and those of this two-sided Rayleigh
    quotient in second order. The result is `value` if the correction is not small.
    """
    solve = factorize_saddle_point(
        sp.csc_array(
            (tangent.stiffness + value * tangent.damping + value**2 * tangent.mass).conj().T
        ),
        sp.csc_array((tangent.position_jacobian + value * tangent.velocity_jacobian).conj().T),
        sp.csc_array(tangent.reactions.T),
    )
    if solve is None:
        return value
    zeros = np.zeros(tangent.reactions.shape[1])
    left = solve(np.concatenate([tangent.mass @ shape, zeros]))[: len(shape)]
    left = left / np.sqrt(np.abs(np.vdot(left, tangent.mass @ left)))
    motions = np.stack([left.real, left.imag, shape.real, shape.imag], axis=1)
    stiffness = reduce_stiffness(system, x, mu, motions).matrix
    damping, _ = _reduce_damping(system, x, mu, tangent.damping, motions, np.abs(value) ** 2)
    inertia = motions.T @ (tangent.mass @ motions)
    unit = np.array([1.0, 1j])
    k, c, m = (np.conj(unit) @ each[:2, 2:] @ unit for each in (stiffness, damping, inertia))
    step = -(k + value * c + value**2 * m) / (c + 2.0 * value * m)
    return value + step if np.abs(step) <= _MAX_CORRECTION * np.abs(value) else value


def _states_of_modes(
    tangent: Tangent, basis: Array, modes: EigenSolution, selected: Array
) -> Array:
    """Return the states (x, x') of selected modes in a basis B with B^T M B = I, (2 k, number).

    Free motions and `modes.others` have two states each, because they may move and rest.
    """
    shapes, values = modes.shapes[:, selected], modes.values[selected]
    if modes.others is not None:
        shapes = np.hstack([shapes, modes.others])
        values = np.append(values, np.zeros(modes.others.shape[1]))
    positions = basis.T @ (tangent.mass @ shapes)
    free = positions[:, values == 0.0]
    moving = np.vstack([np.zeros_like(free), free])
    states = np.hstack([np.vstack([positions, values * positions]), moving])
    return states / np.maximum(la.norm(states, axis=0), _TINY)


def _largest_shares(values: Array, shapes: Array, states: Array) -> Array:
    """Return the largest share (2 k,) of each eigenvector in the real and imaginary states.

    The eigenvectors are (x, l x) for eigenvalues l and shapes x, (k, 2 k).
    """
    vectors = np.vstack([shapes, values * shapes])
    vectors = vectors / la.norm(vectors, axis=0)
    parts = np.linalg.lstsq(vectors, np.hstack([states, states.conj()]), rcond=None)[0]
    return np.max(np.abs(parts), axis=1)


def _refine_shapes(
    system: LoadedEquations, x: Array, mu: float, tangent: Tangent, parts: Array
) -> Array | None:
    """Return the motions (n, k) that `refine_subspace` gives for mode shapes `parts`, or None."""
    scale = system.scales[:, None]
    columns = parts / scale
    columns = columns / np.maximum(la.norm(columns, axis=0), _TINY)
    basis, sizes, _ = la.svd(columns, full_matrices=False)
    basis = basis[:, sizes > _MIN_SHARE * sizes[0]]
    weighted = scale * (tangent.mass @ (scale * basis))
    weighted = weighted / np.max(la.norm(weighted, axis=0))
    refined = refine_subspace(system, x, mu, basis, weighted)
    return None if refined is None else scale * refined


def _span_soft_motions(
    tangent: Tangent, motions: Array, square: float, min_energy_ratio: float
) -> Array:
    """Return a basis of the motions in the span of `motions`, (n, k), that stretch beams little.

    The basis B satisfies B^T M B = I. Rounding adds motions to mode shapes that stretch thin beams.
    In a basis with B^T M B = I alone, their stiffness would exceed that of the modes, which have
    squared frequencies of up to `square`, by ten orders of magnitude. Therefore, motions are first
    scaled to equal energies x^T (K + s M) x. Combinations with less than `min_energy_ratio` of the
    largest energy are dependent.
    """
    inertia, stiffness = (motions.T @ (x @ motions) for x in (tangent.mass, tangent.stiffness))
    # Follower loads make the energy of some combinations of flutter modes negative, by more than
    # the eigenvalues of these modes suggest, unless s is large enough.
    for factor in _ENERGY_SHIFT_FACTORS:
        shift = factor * square
        energy = 0.5 * (stiffness + stiffness.T) + shift * inertia
        # Imaginary parts of shapes are small, but not negligible.
        sizes = np.sqrt(np.maximum(np.diag(energy), _TINY))
        energies, shares = la.eigh(energy / sizes / sizes[:, None])
        is_independent = energies > min_energy_ratio * energies[-1]
        others = shares[:, ~is_independent] / sizes[:, None]
        lost_inertias = np.einsum("ij,ij->j", others, inertia @ others)
        is_complete = not np.any(lost_inertias * shift > _MIN_INERTIA_RATIO)
        has_negative = energies[0] < -_MIN_INERTIA_RATIO * energies[-1]
        if is_complete or (factor >= _MAX_USUAL_FACTOR and not has_negative):
            break
    scaled = shares[:, is_independent] / np.sqrt(energies[is_independent]) / sizes[:, None]
    inertias, shares = la.eigh(scaled.T @ inertia @ scaled)
    is_soft = inertias * shift > _MIN_INERTIA_RATIO
    return motions @ scaled @ (shares[:, is_soft] / np.sqrt(inertias[is_soft]))


def _reduce_damping(
    system: LoadedEquations, x: Array, mu: float, damping: sp.csc_array, basis: Array, square: float
) -> tuple[Array, float]:
    """Return B^T C B, from differences of the forces where they agree with the matrix C.

    They disagree for nonlinear dampers and friction. `square` is a typical squared frequency. The
    second result is the rounding error of B^T C B, relative to the bound on that of the matrix.
    """
    by_matrix = basis.T @ (damping @ basis)
    if not np.any(by_matrix):
        return by_matrix, 1.0
    by_forces = basis.T @ system.multiply_damping(x, mu, basis, float(np.sqrt(square)))
    rounding = np.max(quadratic_form_rounding(damping, basis))
    if np.max(np.abs(by_forces - by_matrix)) <= rounding:
        return by_forces, _DAMPING_ROUNDING_RATIO
    return by_matrix, 1.0


def _solve_with_errors(matrix: Array, error: Array, floor: float) -> tuple[Array, Array, Array]:
    """Return eigenvalues of a matrix, the first k components of their vectors, and error bounds.

    Only the last k rows of the first k columns contain errors: a sample of them is `error`, (k, k),
    and their norm is at least `floor`. The bounds are of first order in the errors.
    """
    k = len(error)
    values, left, right = la.eig(matrix, left=True)
    first, last = right[:k], left[-k:]
    changes = ERROR_MULTIPLE * np.abs(np.einsum("ij,ij->j", last.conj(), error @ first))
    changes = np.maximum(changes, floor * la.norm(last, axis=0) * la.norm(first, axis=0))
    conditions = np.abs(np.einsum("ij,ij->j", left.conj(), right))
    return values, first, changes / np.maximum(conditions, _TINY)
