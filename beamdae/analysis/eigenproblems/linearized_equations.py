"""Linearized equations as the eigenvalue solvers need them.

Axial and shear stiffnesses of thin beams exceed those of their slow motions by many digits. In
mixed form, their forces are multipliers of compliant constraints, so that the slenderness does not
enter rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.compliant_equations import introduce_resultants
from beamdae.equations.formulations.tangents import (
    Convert,
    Tangent,
    compute_residual,
)
from beamdae.equations.starts.steady_rotation import RotatingCoordinates
from beamdae.linear.blas_threads import single_threaded
from beamdae.linear.factorizations import SaddlePencil

Array = np.ndarray

# Bound on the rounding errors of y^T A y, relative to that of all magnitudes, and of the stiffness
# over the inertia, relative to their largest ratio.
ROUNDING_RATIO = 2e-14
# Squared rate [1/s^2] of motions without stiffness: inverses of smaller ones would overflow.
_MIN_SQUARE = 1e-100
# The same without stiff forces, for motions of natural size: below the stiffness of slow modes, but
# so large that free motions, which its inverse amplifies, are removed without rounding errors.
_HOLDING_RATIO = 1e-10
# Asymmetry up to which a matrix is treated as symmetric, relative to its largest entry: of exact
# matrices, and of matrices with finite differences. The first is small because a follower load is
# small compared with the axial stiffness of a thin beam.
_EXACT_TOLERANCE, _DIFFERENCE_TOLERANCE = 1e-13, 1e-9
_ROTATION_ROUNDING = 1e-9  # of deformations by a translation
# Deviation of the directions of reactions from the gradients of the constraints, relative to the
# largest gradient.
_REACTION_TOLERANCE = 1e-12


class MixedForm(NamedTuple):
    """Matrices without stiff forces, and compliant constraints J (x + tau x') - mu = 0.

    Attributes
    ----------
    stiffness, damping
        Sparse matrices (n, n).
    rows
        Derivatives J of the constraints, sparse (r, n).
    retardation
        Diagonal of tau, (r,).
    multipliers
        Multipliers of the state, then its stiff forces; of all parts.
    """

    stiffness: sp.csc_array
    damping: sp.csc_array
    rows: sp.csc_array
    retardation: Array
    multipliers: Array


@dataclass(frozen=True)
class LinearizedEquations:
    """Linearized equations M x'' + C x' + K x + H mu = 0, J x + V x' = 0.

    Attributes
    ----------
    equations
        Equations of the active parts with independent constraints.
    tangent
        Matrices of the linearized equations.
    zero_square
        Squared frequencies up to this magnitude [1/s^2] are treated as zero.
    has_differences
        True if the matrices contain errors of finite differences or of the transformation to a
        rotating frame, so that symmetry is tested with a larger tolerance.
    mixed
        Mixed form of the same equations, or None.
    """

    equations: EquationsOfMotion
    tangent: Tangent
    zero_square: float = 0.0
    has_differences: bool = False
    mixed: MixedForm | None = None

    @cached_property
    def rows(self) -> sp.csc_array:
        """Matrix (m, n) that multiplies accelerations in the differentiated constraints."""
        return self.tangent.acceleration_jacobian(self.equations)

    @property
    def stiffness(self) -> sp.csc_array:
        """Stiffness (n, n) without the forces of compliant constraints."""
        return (self.mixed or self.tangent).stiffness

    def energies(self, x: Array) -> tuple[Array, Array]:
        """Return x^T K x and x^T C x (k,) of shapes (n, k), with squares of stiff strains."""
        form = self.mixed or self.tangent
        stiffness, damping = (
            np.einsum("ij,ij->j", x, matrix @ x) for matrix in (form.stiffness, form.damping)
        )
        if self.mixed is not None:
            squares = (self.mixed.rows @ x) ** 2
            stiffness = stiffness + np.sum(squares, axis=0)
            damping = damping + self.mixed.retardation @ squares
        return stiffness, damping

    @property
    def rounding_square(self) -> float:
        """Squared rate [1/s^2] near the rounding errors of the stiffness."""
        inertia, stiffness = self.tangent.mass.diagonal(), self.tangent.stiffness.diagonal()
        ratios = np.abs(stiffness[inertia > 0.0]) / inertia[inertia > 0.0]
        square = ROUNDING_RATIO * float(np.max(ratios, initial=0.0))
        return square if square > _MIN_SQUARE else 1.0

    @cached_property
    def pencil(self) -> SaddlePencil:
        """Matrix A(s) of (x, mu) for x exp(s t), or for (x, mu, forces of the mixed form)."""
        tangent, n, size = self.tangent, self.equations.n, self.equations.n + self.equations.m
        blocks = [
            (0, 0, 0, self.stiffness),
            (0, 0, n, tangent.reactions),
            (0, n, 0, tangent.position_jacobian),
            (1, 0, 0, (self.mixed or tangent).damping),
            (1, n, 0, tangent.velocity_jacobian),
            (2, 0, 0, tangent.mass),
        ]
        if self.mixed is not None:
            rows, retardation = self.mixed.rows, self.mixed.retardation
            blocks += [
                (0, 0, size, rows.T),
                (0, size, 0, rows),
                (1, size, 0, sp.diags_array(retardation) @ rows),
                (0, size, size, -sp.eye_array(len(retardation))),
            ]
            size += len(retardation)
        return SaddlePencil(size, blocks)

    @cached_property
    def is_symmetric(self) -> bool:
        """True if the eigenproblem without damping is symmetric.

        That is, K and M are symmetric, reactions act along the gradients of the constraints, and
        constraints on velocities do not depend on positions.
        """
        tangent = self.tangent
        tolerance = _DIFFERENCE_TOLERANCE if self.has_differences else _EXACT_TOLERANCE
        if not all(is_symmetric_matrix(x, tolerance) for x in (tangent.stiffness, tangent.mass)):
            return False
        # At rest, constraints on velocities constrain the shapes of vibrations.
        rolling = tangent.position_jacobian[self.nonholonomic]
        if rolling.nnz and abs(rolling).max() > 0.0:
            return False
        difference = abs(self.tangent.reactions.T - self.rows)
        return not difference.nnz or bool(
            difference.max() <= _REACTION_TOLERANCE * abs(self.rows).max()
        )

    @property
    def is_conservative(self) -> bool:
        """True if squared eigenvalues are real, those of a symmetric problem without damping."""
        return not np.any(self.tangent.damping.data) and self.is_symmetric

    @property
    def has_rates(self) -> bool:
        """True if an eigenvalue itself occurs in the eigenproblem, not only its square."""
        matrices = (self.tangent.damping, self.tangent.velocity_jacobian)
        return any(np.any(matrix.data) for matrix in matrices)

    def symmetrized(self) -> LinearizedEquations:
        """Return undamped equations with the symmetric parts of M and K, and reactions along G.

        First-order states are held.
        """
        tangent, mixed, n = self.tangent, self.mixed, self.equations.n
        moving = self.equations.without_states(np.ones(n))
        rows = sp.csc_array(self.rows * moving)

        def symmetrize(matrix: sp.csc_array) -> sp.csc_array:
            return sp.csc_array(0.5 * (matrix + matrix.T) * moving * moving[:, None])

        def stiffen(matrix: sp.csc_array) -> sp.csc_array:
            return sp.csc_array(symmetrize(matrix) + sp.diags_array(1.0 - moving))

        undamped = tangent._replace(
            mass=symmetrize(tangent.mass),
            damping=sp.csc_array((n, n)),
            stiffness=stiffen(tangent.stiffness),
            reactions=sp.csc_array(rows.T),
            position_jacobian=rows,
            velocity_jacobian=sp.csc_array(rows.shape),
        )
        if mixed is not None:
            mixed = mixed._replace(
                stiffness=stiffen(mixed.stiffness),
                damping=undamped.damping,
                rows=sp.csc_array(mixed.rows * moving),
                retardation=np.zeros(len(mixed.retardation)),
            )
        return replace(self, tangent=undamped, mixed=mixed)

    @single_threaded
    def introduce_forces(
        self,
        time: Array,
        state: State,
        tangent_at: Callable[[State, Convert], Tangent],
        idle: Array | None = None,
    ) -> LinearizedEquations:
        """Return the equations in mixed form about a `state` whose strains are constant.

        `tangent_at` returns the tangent of converted equations at a state; see
        `introduce_resultants` for `idle`.
        """
        e, m = self.equations, self.equations.m
        form = introduce_resultants(e, idle)
        retardation = form.retardation[m:]
        if not len(retardation):
            return self

        def evaluate(lam: Array) -> LinearizedEquations:
            lin = linearize_in_mixed_form(e, state._replace(lam=lam), tangent_at, idle)
            unmixed = self.tangent._replace(residual=lin.tangent.residual[: e.n + m])
            return replace(self, tangent=unmixed, mixed=lin.mixed)

        lam = np.append(state.lam[:m], np.zeros(len(retardation)))
        # Without forces, the constraints are the deformations.
        lam[m:] = compute_residual(form.equations, time, state._replace(lam=lam))[e.n + m :]
        # Rounding of the positions hides small strains: forces follow from equilibrium.
        lin = evaluate(lam)
        if idle is None and np.any(state.v) and np.any(retardation):
            # In a rotating frame, the rates of deformations of dampers on the ground depend on
            # positions, too, unlike those of others, which turn with the frame.
            assert lin.mixed is not None
            moved = np.abs(lin.mixed.rows @ RotatingCoordinates.from_equations(e).translations)
            grounded = (retardation > 0.0) & (moved.max(axis=1) > _ROTATION_ROUNDING * moved.max())
            if grounded.any():
                return self.introduce_forces(time, state, tangent_at, grounded)
        scales, pencil = e.position_scales, lin.symmetrized().pencil
        inertia = float(scales @ (self.tangent.mass @ scales))
        square = _HOLDING_RATIO * float(scales @ (abs(lin.stiffness) @ scales)) / inertia
        solve = pencil.factorize(np.sqrt(square))
        if solve is None:
            return self
        change = solve(np.append(lin.tangent.residual, np.zeros(len(retardation))))
        # Free motions, which the residual does not determine, are removed: forces turn with them.
        change -= solve(square * (pencil.matrices[2] @ change))
        return evaluate(lam - change[e.n :])

    @property
    def nonholonomic(self) -> Array:
        """Mask of the constraints on velocities, (m,)."""
        return np.isin(np.arange(self.equations.m), self.equations.nonholonomic_rows)


def linearize_in_mixed_form(
    e: EquationsOfMotion,
    state: State,
    tangent_at: Callable[[State, Convert], Tangent],
    idle: Array | None = None,
) -> LinearizedEquations:
    """Return the linearized equations about a state whose multipliers include the stiff forces.

    Their residual includes the compliant constraints without these forces. `tangent_at` returns the
    tangent of converted equations at a state; see `introduce_resultants` for `idle`.
    """
    m, form = e.m, introduce_resultants(e, idle)

    def convert(equations: EquationsOfMotion) -> EquationsOfMotion:
        return (form if equations is e else introduce_resultants(equations, idle)).equations

    tangent = tangent_at(state, convert)
    rows = sp.csc_array(tangent.position_jacobian[m:])
    retardation = form.retardation[m:]
    mixed = MixedForm(tangent.stiffness, tangent.damping, rows, retardation, state.lam)
    own = tangent._replace(
        reactions=sp.csc_array(tangent.reactions[:, :m]),
        position_jacobian=sp.csc_array(tangent.position_jacobian[:m]),
        velocity_jacobian=sp.csc_array(tangent.velocity_jacobian[:m]),
    )
    return LinearizedEquations(e, own, mixed=mixed if len(retardation) else None)


def quadratic_forms(matrix: sp.sparray, x: Array) -> Array:
    """Return x^H A x (k,) of a matrix A and the columns x of an array (n, k)."""
    return np.einsum("ij,ij->j", x.conj(), matrix @ x)


def is_symmetric_matrix(matrix: sp.csc_array, tolerance: float = _EXACT_TOLERANCE) -> bool:
    """Return True if the asymmetry is at most `tolerance` times the largest entry."""
    return not matrix.nnz or bool(abs(matrix - matrix.T).max() <= tolerance * abs(matrix).max())
