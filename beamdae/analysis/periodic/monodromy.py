"""Variational equations of a run: propagation of disturbances, and the monodromy matrix.

The residual R(t, y, y') = 0 in the stabilized index-1 form is linearized along the run,
R_y dy + R_y' dy' = 0, and integrated by Radau IIA of order 5 with the steps of the run. For a run
of `Radau`, this is the derivative of the discrete solution with respect to its start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.analysis.continuation.engine import CurveError
from beamdae.analysis.sensitivities.linear_steps import Matrices, propagate_disturbances
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import FirstOrderForm, formulate_first_order
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.errors import BeamdaeError
from beamdae.integrators.radau.coefficients import C
from beamdae.integrators.radau.stepper import STABILIZED_FORM
from beamdae.integrators.step_history import interpolate_balanced
from beamdae.linear.elimination import LANES
from beamdae.results.trajectory import Interval, Trajectory
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

# Rows of the constraint Jacobian whose length is below this fraction of the longest are zero.
_ZERO_ROW_RATIO = 1e-10
# Energy of a disturbance of natural size, relative to that of the motion, which is added because
# some coordinates have no mass.
_MIN_ENERGY_RATIO = 1e-8
# Prevents a threshold of zero if there are no constraints.
_TINY = 1e-300
# Smaller singular values of the propagated disturbances, relative to the largest, are zero: linear
# equations are solved with about this accuracy.
EXACT_RANK = 1e-8
# Random disturbances reveal the range of the matrix if they outnumber its rank by this number.
_OVERSAMPLING = 2


class LinearizationError(BeamdaeError, CurveError):
    """Raised if the equations of a linearized step cannot be solved."""


@dataclass(frozen=True)
class VariationalEquations:
    """Equations of motion, without redundant constraints, linearized along runs."""

    equations: EquationsOfMotion

    @cached_property
    def form(self) -> FirstOrderForm:
        """First-order form with R_y and R_y' evaluated separately."""
        return formulate_first_order(self.equations, STABILIZED_FORM, apart=True)

    @cached_property
    def _evaluator(self) -> StateEvaluator:
        return StateEvaluator(self.equations)

    @cached_property
    def _matrices(self) -> Matrices:
        return Matrices()

    def admissible_disturbances(
        self, trajectory: Trajectory, scales: Array
    ) -> tuple[Array, Array, Array]:
        """Return the initial disturbances of (q, v) that the joints allow.

        They are an orthonormal basis (2 n, k) in coordinates whose square is the energy |dq' K dq|
        + dv' M dv, relative to that of vibrations with the natural sizes `scales`, (2 n,); the
        other values are the matrices to these coordinates and back. In this norm, undamped modes of
        any frequency keep their size; relative to `scales`, stiff modes grow by the ratio of their
        frequency to that of the motion.
        """
        n, interval = self.equations.n, trajectory.intervals[0]
        state = State(*(x[0] for x in interval.at(interval.nodes[:1])))
        time = np.array([interval.nodes[0], interval.branch])
        tangent = compute_tangent(self.equations, time, state)
        stiffness, mass = (_symmetrize(x, scales[:n]) for x in (tangent.stiffness, tangent.mass))
        rate = float(np.max(scales[n:] / scales[:n]))
        kinetic = rate**2 * mass
        reference = max(float(np.trace(kinetic)) / n, _TINY)
        floor = _MIN_ENERGY_RATIO * np.eye(n)
        values, modes = la.eigh(stiffness / reference)
        elastic = (modes * np.abs(values)) @ modes.T
        factors = la.block_diag(
            la.cholesky(elastic + kinetic / reference + floor, lower=True),
            la.cholesky(kinetic / reference + floor, lower=True),
        )
        rows = self._constraint_rows(time, state, scales)
        admissible = la.solve_triangular(factors, rows.T, lower=True)
        lengths = np.linalg.norm(admissible, axis=0)
        is_nonzero = lengths > _ZERO_ROW_RATIO * np.max(lengths, initial=_TINY)
        unit = admissible[:, is_nonzero] / lengths[is_nonzero]
        directions = la.null_space(unit.T) if unit.size else np.eye(2 * n)
        back = scales[:, None] * la.solve_triangular(factors.T, np.eye(2 * n), lower=False)
        return directions, factors.T / scales, back

    def _constraint_rows(self, time: Array, state: State, scales: Array) -> Array:
        """Return the scaled derivatives of the constraints with respect to (q, v)."""
        form, n, m = self.form, self.equations.n, self.equations.m
        y, yp = form.pack(state)
        nonzeros = form.jacobian(time, y, yp)
        by_y = np.zeros((form.size, form.size))
        by_y[form.pattern.indices, column_indices(form.pattern)] = nonzeros[: form.pattern.nnz]
        return by_y[2 * n : 2 * (n + m), : 2 * n] * scales

    def propagate(self, trajectory: Trajectory, disturbances: Array, refinement: int = 0) -> Array:
        """Propagate initial `disturbances` (2 n, k) of (q, v) to the end of a run.

        Parameters
        ----------
        trajectory
            The run.
        disturbances
            Disturbances (2 n, k) at the start.
        refinement
            Number of times the steps of the run are halved; -1 to join two steps.

        Raises
        ------
        LinearizationError
            If the linearized equations of a step cannot be solved.
        """
        rows = disturbances.T
        for interval in trajectory.intervals:
            stages = self._at_stages(interval, refinement)
            try:
                rows = propagate_disturbances(self.equations, stages, rows, self._matrices)
            except BeamdaeError as problem:
                raise LinearizationError(str(problem)) from problem
        return rows.T

    def _at_stages(self, interval: Interval, refinement: int) -> Interval:
        """Return the states at the stages of steps that are the halved steps of an interval."""
        if refinement == 0 and interval.nodes_per_step == len(C):
            return interval
        numbers = np.arange(len(interval.t))
        count = max(round(numbers[-1] * 2.0**refinement), 1)
        ends = np.interp(np.linspace(0.0, numbers[-1], count + 1), numbers, interval.t)
        h = np.diff(ends)
        # Rounding may put the last stage beyond the end.
        times = np.minimum((ends[:-1, None] + h[:, None] * C).ravel(), interval.t[-1])
        steps = np.repeat(h, len(C))
        states = interpolate_balanced(interval, times, steps, self._evaluator)
        start = (x[:1] for x in interval.rows)
        rows = State(*map(np.concatenate, zip(start, states, strict=True)))
        return Interval(np.append(ends[0], times), rows, interval.branch, len(C))


def _symmetrize(matrix: sp.csc_array, scales: Array) -> Array:
    """Return the symmetric part of a matrix with scaled rows and columns, dense."""
    dense = matrix.toarray() * scales[:, None] * scales
    return 0.5 * (dense + dense.T)


def assemble_monodromy(
    propagate: Callable[[Array], Array], directions: Array, tolerance: float = EXACT_RANK
) -> Array:
    """Return the monodromy matrix (k, k), exact on its range and on `directions`.

    Most disturbances of a damped beam vanish within a period, so that the matrix has a low rank.
    Random disturbances reveal its range (Halko, Martinsson & Tropp, SIAM Review 53 (2011) 217); the
    range and the `directions` are then propagated. On the complement of all these disturbances,
    the result is zero. The eigenvalues, and solutions of (M - I) x = b with b in the span of
    `directions`, do not depend on the complement. A matrix of full rank is propagated completely.

    Parameters
    ----------
    propagate
        Function that maps disturbances (k, j) at the start of a period to those at its end.
    directions
        Disturbances (k, d).
    tolerance
        Singular values of the propagated disturbances below this fraction of the largest are zero.
    """
    size = len(directions)
    lengths = np.maximum(np.linalg.norm(directions, axis=0), _TINY)
    start = _extend_basis(np.zeros((size, 0)), directions / lengths, tolerance)
    random = np.random.default_rng(0).standard_normal((size, size))
    inputs = la.qr(np.column_stack([start, random]), mode="economic")[0]
    outputs, count = np.zeros((size, 0)), 0
    while count < size:
        # Disturbances are propagated in blocks of lanes; those that would fill a block are free.
        end = -(-max(start.shape[1] + _OVERSAMPLING, 2 * count) // LANES) * LANES
        outputs = np.column_stack([outputs, propagate(inputs[:, count:end])])
        count = outputs.shape[1]
        vectors, values, _ = la.svd(outputs, full_matrices=False)
        largest = max(float(values[0]), _TINY)
        rank = int(np.sum(values > tolerance * largest))
        if rank + _OVERSAMPLING <= count and count + rank < size:
            # Omitted parts of the range change the square of the matrix by this tolerance.
            weighted = vectors[:, :rank] * (values[:rank] / largest)
            extra = _extend_basis(inputs[:, :count], weighted, tolerance)
            if extra.size:
                outputs = np.column_stack([outputs, propagate(extra)])
            return outputs @ np.column_stack([inputs[:, :count], extra]).T
    return outputs @ inputs.T


def dominant_range(monodromy: Array, tolerance: float) -> Array:
    """Return an orthonormal basis of the range of a monodromy matrix."""
    vectors, values, _ = la.svd(monodromy)
    return vectors[:, values > tolerance * np.max(values, initial=_TINY)]


def _extend_basis(basis: Array, columns: Array, tolerance: float) -> Array:
    """Return an orthonormal basis of the part of the span of `columns` outside that of `basis`.

    Directions in which the columns are at most `tolerance` long are omitted.
    """
    # The second projection removes rounding errors of the first one.
    for _ in range(2):
        columns = columns - basis @ (basis.T @ columns)
    vectors, values, _ = la.svd(columns, full_matrices=False)
    return vectors[:, values > tolerance]
