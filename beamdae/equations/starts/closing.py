"""Positions at which the joints are closed and coordinates have requested values.

The gaps h(q) of the joints and of the requested coordinates shrink along a path from the given
positions q0: h(q) = r h(q0), where r decreases from 1 to 0. Its steps are so short that Newton's
method contracts from the first iteration on (Deuflhard, Newton Methods for Nonlinear Problems,
2004, chapter 5), so that the path neither passes a dead center nor changes to another branch.

Each step minimizes the strain energy, counted from the forces of the given positions. Forces with
kinks, such as contacts, are left out: they may close along the path. Motions without strain are as
small as possible in the metric of the mass matrix. The forces of stiff parts are unknowns, so that
slender beams are not strained by rounding errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.linalg.lapack import dpstrf
from scipy.sparse.linalg import splu

from beamdae.equations.formulations.compliant_equations import (
    CompliantEquations,
    introduce_resultants,
)
from beamdae.equations.formulations.sums import InputLayout, add_saddle_point, create_matrix_sum
from beamdae.equations.starts.dependent_constraints import require_independent_constraints
from beamdae.equations.starts.rigid_motions import DisplacementMeasure
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.errors import BeamdaeError
from beamdae.symbolic.force_kernel import DAMPING, MASS, STIFFNESS
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_matrix_factors, set_time
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator

Array = np.ndarray

# Inertia of motions that the strain energy does not determine, relative to the largest stiffness.
# It slows the motion of soft parts, and decreases by a factor where they converge slowly; motions
# that it determines are accurate to 1e-16 over the share.
_INERTIA_SHARE, _MIN_INERTIA_SHARE = 1e-4, 1e-10
_INERTIA_REDUCTION = 0.01
_FAST_CONTRACTION = 0.1

_POSITION_TOLERANCE = 1e-12  # permitted gap, relative to its scale
# Smaller gaps exceed the tolerances of accurate runs and of small mechanisms. They are closed, too,
# as long as an iteration reduces them to this fraction, down to rounding errors: this multiple of
# the scale of the gap and, where they are larger, of coordinates relative to their scales.
_CLOSING_RATIO = 0.1
_GAP_ROUNDING = 2e-15
_MAX_ITERATIONS = 50

# Steps of the path. A correction of Newton's method may be this fraction of the last one.
_MAX_CONTRACTION = 0.25
# At the end, which may be a dead center, where each correction is half of the last one.
_MAX_LAST_CONTRACTION = 0.6
_MIN_STEP = 1e-6  # of the gaps at the beginning; below, the last contraction is permitted
_STEP_FACTOR = 4.0
_MAX_PREDICTED_ROTATION = 0.2  # [rad]; with corrections that contract, a step stays below 0.3 rad

# Requested coordinates whose mobility, relative to 1 / inertia, is smaller do not move.
_MIN_MOBILITY = 1e-13
_AGREEMENT_TOLERANCE = 1e-11  # of requested values that depend on each other, relative to the scale

# In units of `position_scales`. Below the second, changes stop to shrink at rounding errors.
_CONVERGED_CHANGE = 1e-10
_SMALL_CHANGE = 1e-6


def closing_matrices(
    evaluator: StateEvaluator, time: Array, q: Array
) -> tuple[sp.csc_array, sp.csc_array]:
    """Return the matrix A by which positions follow the gaps of joints, and its part M / T^2.

    Rows and columns are those of the coordinates, (n,), of the joints, (m,), and of others. The
    inertia M / T^2 slows the first step x = A^-1 gaps; the second adds A^-1 (M / T^2) x.
    """
    path = _Path(evaluator, time, q, evaluator.equations.states, q[evaluator.equations.states])
    inertia = _MIN_INERTIA_SHARE * path.stiffness
    whole, inertial = (path.matrix(path.begin, x, inertia) for x in (1.0, 0.0))
    return whole, inertial[: len(q), : len(q)]


@cache_on_owner
def _without_kinks(structure: Structure) -> Structure:
    return replace(structure, forces=structure.smooth_forces)


@cache_on_owner
def _plan_matrix(
    structure: Structure, joint_count: int, held: tuple[int, ...]
) -> tuple[sp.csc_array, SumPlan]:
    """Return the pattern and plan of `_Path.matrix`, with inputs (q, 0, lam)."""
    n, m, total = structure.n, structure.m, create_matrix_sum()
    layout = InputLayout(q=0, v=n, a=n, lam=2 * n)
    # As in `StateEvaluator`, so that both use the same kernels.
    sums = ((STIFFNESS,), (DAMPING,), (MASS,))
    add_saddle_point(total, structure, layout, sums, with_reaction_stiffness=True)
    first = n + joint_count
    total.add_diagonal(m - joint_count, (first, first), None, -1.0)
    for row, column in enumerate(held, n + m):
        total.add_diagonal(1, (row, column), None, 1.0)
        total.add_diagonal(1, (column, row), None, 1.0)
    size = n + m + len(held)
    return total.matrix((size, size))


def close_joints(
    evaluator: StateEvaluator,
    time: Array,
    q: Array,
    requested: Mapping[int, float],
) -> Array:
    """Return positions (n,) on the branch of `q` at which the joints are closed.

    Parameters
    ----------
    evaluator
        Evaluator of the equations of motion.
    time
        (t, branch).
    q
        Positions (n,), with unstrained beams.
    requested
        Values of coordinates, by index.

    Raises
    ------
    BeamdaeError
        If constraints depend on each other, joints cannot be closed or values cannot be reached.
    """
    selected, targets = np.array([*requested], int), q.copy()
    targets[selected] = values = np.array([*requested.values()], float)
    leading = selected
    if len(selected):
        # Coordinates that can move independently, by changes of positions due to unit forces.
        forces = np.eye(len(q))[selected]
        mobility = np.array([evaluator.solve_saddle(time, q, None, x, 0.0)[0] for x in forces])
        weights = np.sqrt(np.abs(evaluator.mass_matrix(time, q).diagonal()[selected]))
        scaled = np.ascontiguousarray(weights[:, None] * mobility[:, selected].T * weights)
        _, pivots, rank, _ = dpstrf(scaled, tol=_MIN_MOBILITY)
        leading = selected[np.sort(pivots[:rank] - 1)]
    held = np.append(leading, np.setdiff1d(evaluator.equations.states, leading))
    path = _Path(evaluator, time, q, held, targets[held])
    closed_q, remaining = path.follow()
    e, gaps = evaluator.equations, path.drawn_gaps
    if remaining and (worst := int(np.argmax(np.abs(gaps) / path.scales))) < e.m:
        gap = abs(gaps[worst])
        raise BeamdaeError(
            f"{e.lam_names[worst]}: the joints cannot be closed at t = {time[0]:g} s because a "
            f"gap of {remaining * gap:.6g} (m or rad) remains of {gap:.6g}; check the dimensions "
            "of the parts and the start values."
        )
    errors = np.abs(closed_q[selected] - values) / e.position_scales[selected]
    if remaining or np.max(errors, initial=0.0) > _AGREEMENT_TOLERANCE:
        request = ", ".join(f"{e.q_names[i]} = {x:g}" for i, x in requested.items())
        k = selected[np.argmax(errors)]
        raise BeamdaeError(
            f"start: the joints cannot be closed with {request}, because {e.q_names[k]} can be led "
            f"only to {closed_q[k]:.6g} on the branch of the drawing; specify fewer or different "
            "positions."
        )
    if closed_q is not q:
        closed_q[selected] = values
    return closed_q


class _Point(NamedTuple):
    """Positions (n,), forces of joints and of stiff parts, and forces on held coordinates."""

    q: Array
    lam: Array
    holding: Array


@dataclass(frozen=True)
class _Path:
    """Path on which the gaps of the joints and of held coordinates shrink in proportion.

    Attributes
    ----------
    evaluator, time
        See `close_joints`.
    drawn
        Positions (n,) at which the path begins, and whose forces F (elastic forces, weight and
        loads) are subtracted in the strain energy.
    held, values
        Indices of independent coordinates, with all first-order states, and their values at the
        end.
    """

    evaluator: StateEvaluator
    time: Array
    drawn: Array
    held: Array
    values: Array

    @cached_property
    def _measure(self) -> DisplacementMeasure:
        return DisplacementMeasure.of(self.evaluator.equations)

    @cached_property
    def scales(self) -> Array:
        e = self.evaluator.equations
        return np.concatenate([e.constraint_scales, e.position_scales[self.held]])

    @cached_property
    def drawn_gaps(self) -> Array:
        return self._gaps(self.drawn)

    def follow(self) -> tuple[Array, float]:
        """Return the last positions (`drawn` itself if no gap is open), and the share of the gaps.

        The share that remains is zero unless the path ends before.
        """
        if not np.all(np.isfinite(self.drawn_gaps)):
            name = self.evaluator.equations.lam_names[np.argmin(np.isfinite(self.drawn_gaps))]
            raise BeamdaeError(
                f"{name}: the constraint is not finite at t = {self.time[0]:g} s; check the laws "
                "and the start values."
            )
        if self._size(self.drawn_gaps) <= self._rounding(self.drawn):
            return self.drawn, 0.0
        require_independent_constraints(self.evaluator, self.time, self.drawn)
        # Rejects forces and derivatives that are not finite, and coordinates without resistance.
        resistance = (1.0, 0.0, 1.0)
        self.evaluator.solve_saddle(self.time, self.drawn, None, 0.0, 0.0, resistance)
        point, remaining, step = self.begin, 1.0, 1.0
        rotation = self._predict_rotation(point)
        while remaining > 0.0:
            step = min(step, remaining, _MAX_PREDICTED_ROTATION / max(rotation, 1e-300))
            end = max(remaining - step, 0.0)
            is_smallest = step <= _MIN_STEP
            contraction = _MAX_LAST_CONTRACTION if is_smallest else _MAX_CONTRACTION
            try:
                closed = self._close(point, end * self.drawn_gaps, contraction)
                if closed is not None and end > 0.0:
                    rotation = self._predict_rotation(closed)
            except (BeamdaeError, RuntimeError):  # SuperLU raises the latter for singular matrices.
                closed = None
            if closed is not None:
                point, remaining, step = closed, end, step * _STEP_FACTOR
            elif not is_smallest:
                step /= _STEP_FACTOR
            else:
                break
        return point.q, remaining

    @cached_property
    def _form(self) -> CompliantEquations:
        e = self.evaluator.equations
        return introduce_resultants(replace(e, structure=_without_kinks(e.structure)))

    @cached_property
    def _mixed(self) -> StateEvaluator:
        """Evaluator of the equations with the forces of stiff parts as unknowns."""
        return StateEvaluator(self._form.equations)

    @cached_property
    def begin(self) -> _Point:
        """The drawing, with the forces of its strains."""
        unloaded = _Point(self.drawn, np.zeros(self._form.equations.m), np.zeros(len(self.held)))
        return unloaded._replace(lam=self._unbalance(unloaded)[1])

    @cached_property
    def _drawn_force(self) -> Array:
        return self._unbalance(self.begin)[0]

    def _unbalance(self, point: _Point) -> tuple[Array, Array]:
        """Return F + R^T lam, (n,), and the strains of stiff parts less their forces, (m,)."""
        force, (strains, *_) = self._mixed.balance(self.time, point.q, None, None, point.lam)
        force[self.held] += point.holding
        errors = strains - point.lam
        errors[: self._form.joint_count] = 0.0
        return force, errors

    def _gaps(self, q: Array) -> Array:
        joint_gaps = self.evaluator.position_gaps(self.time, q)
        return np.concatenate([joint_gaps, q[self.held] - self.values])

    def _size(self, gaps: Array) -> float:
        return float(np.max(np.abs(gaps) / self.scales, initial=0.0))

    def _rounding(self, q: Array) -> float:
        scales = self.evaluator.equations.position_scales
        return float(_GAP_ROUNDING * (1.0 + np.max(np.abs(q) / scales, initial=0.0)))

    def _predict_rotation(self, point: _Point) -> float:
        """Return the largest rotation [rad] that would close the gaps of the drawing."""
        change = self._change(point, self.drawn_gaps, _INERTIA_SHARE).q
        return float(np.max(np.abs(change[self.evaluator.equations.is_angle]), initial=0.0))

    def _close(self, begin: _Point, remaining_gaps: Array, max_contraction: float) -> _Point | None:
        """Return a point with these gaps by Newton's method, or None if it does not contract."""
        point, last_size, last_change, share = begin, np.inf, np.inf, _INERTIA_SHARE
        for _ in range(_MAX_ITERATIONS):
            gaps = self._gaps(point.q) - remaining_gaps
            size, rounding = self._size(gaps), self._rounding(point.q)
            change = self._change(point, gaps, share)
            change_size = self._measure.farthest(change.q)
            point = _Point(*map(np.add, point, change))
            is_stalled = size <= _POSITION_TOLERANCE and size > _CLOSING_RATIO * last_size
            # Less inertia makes soft parts converge faster.
            is_slow = change_size > _FAST_CONTRACTION * last_change and share > _MIN_INERTIA_SHARE
            proceeds = is_slow or change_size <= max_contraction * last_change
            limit = _CONVERGED_CHANGE if proceeds else _SMALL_CHANGE
            if (size <= rounding or is_stalled) and change_size < limit:
                return point
            is_large = size > _POSITION_TOLERANCE or not change_size < _SMALL_CHANGE
            if not change_size < np.inf or (is_large and not proceeds):
                return None
            if is_slow:
                share *= _INERTIA_REDUCTION
            last_size, last_change = size, change_size
        return None

    def _change(self, point: _Point, gaps: Array, share: float) -> _Point:
        """Return the step x = change.q of Newton's method by which the gaps vanish.

        It solves share * stiffness * M x + F + K x + R^T lam = F(drawn), see `matrix`.
        """
        (force, errors), joints = self._unbalance(point), self._form.joint_count
        right = [self._drawn_force - force, -gaps[:joints], -errors[joints:], -gaps[joints:]]
        factors = splu(self.matrix(point, 1.0, share * self.stiffness))
        solution = factors.solve(np.concatenate(right))
        return _Point(*np.split(solution, np.cumsum([len(force), len(errors)])))

    @cached_property
    def _plan(self) -> tuple[sp.csc_array, SumEvaluator]:
        e = self._form.equations
        pattern, plan = _plan_matrix(e.structure, self._form.joint_count, tuple(self.held.tolist()))
        return pattern, SumEvaluator(plan, e.p)

    def matrix(self, point: _Point, stiffness: float, inertia: float) -> sp.csc_array:
        """Return [[c_M M + c_K K, R^T], [R, -D]], where D is one for stiff parts, otherwise zero.

        `stiffness` and `inertia` are the factors c_K and c_M = 1 / T^2.
        """
        pattern, total = self._plan
        set_matrix_factors(total, stiffness, 0.0, inertia, 1.0, 1.0, 1.0)
        set_time(total, *self.time)
        values = total(np.concatenate([point.q, np.zeros(len(point.q)), point.lam]), pattern.nnz)
        return sp.csc_array((values, pattern.indices, pattern.indptr), pattern.shape)

    @cached_property
    def stiffness(self) -> float:
        """Largest stiffness, or load, relative to the largest inertia [1/s^2]; 1 without both.

        Loads count because their rounding errors must not exceed the forces of the inertia, and
        stiff parts only if there are no other stiffnesses: their forces are unknowns.
        """
        e = self.evaluator.equations
        scales = e.without_states(e.position_scales)
        squares, loads = scales**2, np.max(scales * np.abs(self._drawn_force))
        elastic, inertial = (self.matrix(self.begin, *x) for x in ((1.0, 0.0), (0.0, 1.0)))
        stiffness, inertia = (
            np.max(squares * np.abs(x.diagonal()[: e.n])) for x in (elastic, inertial)
        )
        stiff = slice(e.n + self._form.joint_count, e.n + self._form.equations.m)
        strains = np.max(elastic.power(2)[stiff, : e.n] @ squares, initial=0.0)
        return float(max(stiffness or strains, loads) / inertia) or 1.0
