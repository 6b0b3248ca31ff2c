"""Variational equations of a run: propagation of disturbances, and the monodromy matrix.

The residual R(t, y, y') = 0 in the stabilized index-1 form is linearized along the run,
R_y dy + R_y' dy' = 0, and integrated by Radau IIA of order 5 on nodes of the run. On the steps of a
run of `Radau`, this is the derivative of the discrete solution with respect to its start.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.analysis.continuation.engine import CurveError
from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import (
    FirstOrderForm,
    KinematicReduction,
    formulate_first_order,
    reduce_kinematics,
)
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.errors import BeamdaeError
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.integrators.radau.coefficients import TABLEAU, C
from beamdae.integrators.step_history import interpolate_balanced
from beamdae.linear.elimination import LANES, aligned_zeros, index_lanes
from beamdae.results.trajectory import Interval, Trajectory
from beamdae.symbolic.sparse_operators import column_indices
from beamdae.symbolic.sums.kernel_sums import SumPlan

Array = np.ndarray

_FORM = "stabilized-index1"
_STAGES = 3
# Number of steps per call of the compiled loop, which limits the memory of its stages.
_STEPS_PER_CALL = 64
# Maximum number of times a step of the variational equations is halved.
_MAX_HALVINGS = 10
# Rows of the constraint Jacobian whose length is below this fraction of the longest are zero.
_ZERO_ROW_RATIO = 1e-10
# Energy of a disturbance of natural size, relative to that of the motion, which is added because
# some coordinates have no mass.
_MIN_ENERGY_RATIO = 1e-8
# Prevents a threshold of zero if there are no constraints.
_TINY = 1e-300
# Smaller singular values of the propagated disturbances, relative to the largest, are zero: they
# are not larger than the errors of the stages.
EXACT_RANK = 1e-8
# Random disturbances reveal the range of the matrix if they outnumber its rank by this number.
_OVERSAMPLING = 2


class LinearizationError(BeamdaeError, CurveError):
    """Raised if the stage equations of a linearized step cannot be solved."""


@dataclass(frozen=True)
class VariationalEquations:
    """Equations of motion, without redundant constraints, linearized along runs."""

    equations: EquationsOfMotion

    @cached_property
    def form(self) -> FirstOrderForm:
        """First-order form with R_y and R_y' evaluated separately."""
        return formulate_first_order(self.equations, _FORM, apart=True)

    @cached_property
    def _evaluator(self) -> StateEvaluator:
        return StateEvaluator(self.equations)

    @cached_property
    def _loop(self) -> StepLoop[Workspace]:
        form = self.form
        pattern, jacobian, reduction = reduce_kinematics(form)
        real = FactorizedMatrix.from_pattern(pattern, in_lanes=True)
        complex_ = FactorizedMatrix.from_pattern(pattern, complex, real, in_lanes=True)

        n, size, reduced_size = form.equations.n, form.size, pattern.shape[0]
        parts = _arrange_parts(pattern, jacobian, n)
        rows, blocks = _STAGES * _STEPS_PER_CALL, -(-2 * n // LANES)
        vectors = ("y", "yp", "real_change", "complex_real", "complex_imaginary")
        stages = ("w", "last_w", "stages", "rates")

        buffers = form.buffers()
        buffers.jacobian = jacobian.sum(True, form.equations.p)
        lanes: dict[str, Any] = {name: _lane_zeros(size)[0] for name in vectors}
        lanes |= {name: _lane_zeros(size, _STAGES) for name in stages}
        work = Workspace(
            "VariationalWorkspace",
            tableau=TABLEAU,
            form=buffers,
            real_solver=real.make_solver(),
            complex_solver=complex_.make_solver(),
            reduction=KinematicReduction(*map(index_lanes, reduction)),
            step_size=Workspace("StepSizeState", longest=math.inf),
            times=np.zeros(rows),
            states=np.zeros((rows, size)),
            state_rates=np.zeros((rows, size)),
            h=np.zeros(_STEPS_PER_CALL),
            disturbances=_lane_zeros(size, blocks),
            ends=_lane_zeros(size, blocks),
            disturbances_w=_lane_zeros(size, _STAGES * blocks),
            ends_w=_lane_zeros(size, _STAGES * blocks),
            scales=np.zeros(2 * n),
            weights=_lane_zeros(2 * n)[0],
            jacobians=np.zeros((_STAGES, 3 * pattern.nnz + 1)),
            real_nonzeros=real.nonzeros,
            complex_nonzeros=complex_.nonzeros,
            row_starts=parts.indptr.astype(np.uint32),
            entry_columns=parts.indices.astype(np.uint32),
            entry_sources=parts.data.astype(np.uint32),
            right=_lane_zeros(reduced_size)[0],
            complex_right=_lane_zeros(reduced_size, dtype=complex)[0],
            extrapolation=np.zeros((_STAGES, _STAGES)),
            velocities=_lane_zeros(n)[0],
            complex_change=_lane_zeros(size, dtype=complex)[0],
            residuals=_lane_zeros(reduced_size, _STAGES),
            unknowns=_lane_zeros(parts.shape[1])[0],
            **lanes,
        )
        pairs = (work.real_solver, real), (work.complex_solver, complex_)
        return StepLoop("propagate_disturbances", work, *pairs)

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

    def propagate(
        self,
        trajectory: Trajectory,
        disturbances: Array,
        scales: Array,
        tolerance: float = EXACT_RANK,
        refinement: int = 0,
    ) -> Array:
        """Propagate initial `disturbances` (2 n, k) of (q, v) to the end of a run.

        Steps in which the iteration of the stages does not converge are halved.

        Parameters
        ----------
        trajectory
            The run.
        disturbances
            Disturbances (2 n, k) at the start.
        scales
            Natural sizes (2 n,) of (q, v).
        tolerance
            Error of the stages, relative to the disturbance.
        refinement
            Number of times the steps of the run are halved; -1 to join two steps.

        Raises
        ------
        LinearizationError
            If the iteration of the stages does not converge in steps that were halved this often.
        """
        work, (n_state, columns) = self._loop.work, disturbances.shape
        work.count, work.tolerance = -(-columns // LANES), tolerance
        work.scales[:] = 1.0 / scales
        # Blocks, state, lanes.
        blocks = work.disturbances[: work.count].reshape(work.count, -1, LANES)
        by_column = np.zeros((work.count * LANES, n_state))
        by_column[:columns] = disturbances.T
        blocks[:] = 0.0
        blocks[:, :n_state] = by_column.reshape(work.count, LANES, n_state).transpose(0, 2, 1)
        for interval in trajectory.intervals:
            work.step_size.last_step = 0.0
            numbers, done = np.arange(len(interval.t)), 0
            count = max(round(numbers[-1] * 2.0**refinement), 1)
            nodes = np.interp(np.linspace(0.0, numbers[-1], count + 1), numbers, interval.t)
            shortest = 2.0**-_MAX_HALVINGS * np.min(np.diff(nodes))
            while done < len(nodes) - 1:
                stop = min(done + _STEPS_PER_CALL, len(nodes) - 1)
                done += self._take_steps(interval, nodes[done : stop + 1])
                if done < stop:
                    middle = np.mean(nodes[done : done + 2])
                    if middle - nodes[done] < shortest:
                        raise LinearizationError(
                            f"periodic: the equations linearized at t = {nodes[done]:.6g} s "
                            "cannot be solved; use a smaller rtol."
                        )
                    nodes = np.insert(nodes, done + 1, middle)
        by_column = blocks[:, :n_state].transpose(0, 2, 1).reshape(-1, n_state)
        return by_column[:columns].T.copy()

    def _take_steps(self, interval: Interval, nodes: Array) -> int:
        """Propagate the disturbances through steps with these ends; return the number of steps.

        It is smaller if the next step fails.
        """
        work, h, n = self._loop.work, np.diff(nodes), self.equations.n
        # Rounding may put the last stage beyond the end.
        times = np.minimum((nodes[:-1, None] + h[:, None] * C).ravel(), interval.t[-1])
        first = int(np.searchsorted(interval.nodes, nodes[0]))
        ends = interval.nodes[first : first + len(times) + 1 : _STAGES]
        if interval.nodes_per_step == _STAGES and np.array_equal(ends, nodes):
            state = State(*(x[first + 1 : first + 1 + len(times)] for x in interval.rows))
        else:
            state = interpolate_balanced(interval, times, np.repeat(h, _STAGES), self._evaluator)
        stages = slice(0, len(times))
        work.times[stages], work.h[: len(h)] = times, h
        work.states[stages, : 2 * n] = np.hstack([state.q, state.v])
        rates = np.hstack([state.v, state.a, state.lam])
        work.state_rates[stages, : rates.shape[1]] = rates
        work.branch, work.steps, work.next = interval.branch, len(h), 0
        self._loop()
        return work.next


def _arrange_parts(pattern: sp.csc_array, plan: SumPlan, n: int) -> sp.csr_array:
    """Return the three parts of a reduced matrix side by side, with indices in place of entries.

    The indices are those of the result of `plan`. The third part has only columns of `n`
    coordinates, see `reduce_kinematics`.
    """
    targets = np.unique(np.concatenate([plan.add_targets, plan.weighted_targets]))
    sources = targets[targets < 3 * pattern.nnz].astype(np.intp)
    part, entry = np.divmod(sources, pattern.nnz)
    columns = part * pattern.shape[0] + column_indices(pattern)[entry]
    shape = (pattern.shape[0], 2 * pattern.shape[0] + n)
    # Indices from 1 on: zeros would not be stored.
    parts = sp.csr_array(sp.coo_array((sources + 1, (pattern.indices[entry], columns)), shape))
    parts.data -= 1
    return parts


def _lane_zeros(size: int, rows: int = 1, dtype: type = float) -> Array:
    """Return rows of zeros for `size` entries of all lanes each."""
    return aligned_zeros(rows * size * LANES, dtype).reshape(rows, -1)


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
