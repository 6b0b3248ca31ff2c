"""Positions at which the joints are closed and coordinates have requested values.

The gaps h(q) of the joints and of the requested coordinates shrink along a path from the given
positions q0: h(q) = r h(q0), where r decreases from 1 to 0. Its steps are so short that Newton's
method contracts from the first iteration on (Deuflhard, Newton Methods for Nonlinear Problems,
2004, chapter 5), so that the path neither passes a dead center nor changes to another branch.

Newton's method moves nodes of a rotating beam along tangents, which stretches the beam by half the
square of the angle. Minimizing the motion and the strain energy at the end of each step removes
that strain.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpstrf

from beamdae.equations.measures import BalanceRows
from beamdae.equations.starts.dependent_constraints import require_independent_constraints
from beamdae.equations.starts.rigid_motions import DisplacementMeasure
from beamdae.equations.starts.state_evaluator import (
    MASS_COEFFICIENTS,
    Coefficients,
    StateEvaluator,
)
from beamdae.errors import BeamdaeError

Array = np.ndarray

_RIGID_TIME = 1.0  # [s]; closing joints hardly excites modes of angular frequency above 1 / this
CLOSING_COEFFICIENTS = (_RIGID_TIME**2, 0.0, 1.0)

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
_MAX_PREDICTED_ROTATION = 0.2  # [rad]; with the corrections, a step stays below `_MAX_ROTATION`
_MAX_ROTATION = 0.3  # [rad]

# Requested coordinates whose mobility, relative to 1 / inertia, is smaller do not move.
_MIN_MOBILITY = 1e-13
_AGREEMENT_TOLERANCE = 1e-11  # of requested values that depend on each other, relative to the scale

# In units of `position_scales`. The changes of slender beams stop to shrink at rounding errors.
_CONVERGED_CHANGE = 1e-10
_SMALL_CHANGE = 1e-6
_STRAIN_COLUMN = 1  # of the rows of the energy balance


def find_least_change(
    evaluator: StateEvaluator,
    time: Array,
    q: Array,
    v: Array | None,
    coefficients: Coefficients,
    gaps: Array,
    selected: Array,
    force: Array | float = 0.0,
) -> Array:
    """Return the x, (n,), by which gaps vanish: G x = -gaps of joints, x_k of selected coordinates.

    x minimizes x . W x / 2 - x . force, where W = c0 K + c1 C + c2 M; see `StateEvaluator`. The
    `selected` coordinates are independent; their gaps follow those of the joints.
    """
    m = evaluator.equations.m
    change = evaluator.solve_saddle(time, q, v, force, -gaps[:m], coefficients)[0]
    if len(selected):
        responses = _respond(evaluator, time, q, v, coefficients, selected)
        missing = -gaps[m:] - change[selected]
        change = change + responses @ np.linalg.solve(responses[selected], missing)
    return change


def select_independent(
    evaluator: StateEvaluator, time: Array, q: Array, v: Array | None, selected: Array
) -> Array:
    """Return those of the selected coordinates that can move independently."""
    if not len(selected):
        return selected
    inertia = evaluator.mass_matrix(time, q).diagonal()[selected]
    mobility = _respond(evaluator, time, q, v, MASS_COEFFICIENTS, selected)[selected]
    weights = np.sqrt(np.abs(inertia))
    scaled = np.ascontiguousarray(weights[:, None] * mobility * weights)
    _, pivots, rank, _ = dpstrf(scaled, tol=_MIN_MOBILITY)
    return selected[np.sort(pivots[:rank] - 1)]


def _respond(
    evaluator: StateEvaluator,
    time: Array,
    q: Array,
    v: Array | None,
    coefficients: Coefficients,
    selected: Array,
) -> Array:
    """Return the changes of positions due to unit forces on coordinates, (n, k)."""
    forces = np.zeros((len(selected), len(q)))
    forces[np.arange(len(selected)), selected] = 1.0
    changes = [evaluator.solve_saddle(time, q, v, x, 0.0, coefficients)[0] for x in forces]
    return np.reshape(changes, forces.shape).T


def close_joints(
    evaluator: StateEvaluator,
    time: Array,
    q: Array,
    selected: Array,
    values: Array,
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
    selected, values
        Indices of requested coordinates and their values, (k,) each.

    Raises
    ------
    BeamdaeError
        If constraints depend on each other, joints cannot be closed or values cannot be reached.
    """
    targets = q.copy()
    targets[selected] = values
    leading = select_independent(evaluator, time, q, None, selected)
    path = _Path(evaluator, time, q, leading, targets[leading])
    closed_q, remaining = path.follow()
    if remaining:
        raise _describe_failure(path, selected, values, closed_q, remaining)
    scales = evaluator.equations.position_scales[selected]
    errors = np.abs(closed_q[selected] - values) / scales
    if np.max(errors, initial=0.0) > _AGREEMENT_TOLERANCE:
        k = selected[np.argmax(errors)]
        reason = f"{evaluator.equations.q_names[k]} is {closed_q[k]:.6g} with the other values"
        if len(selected) == 1:
            reason = "joints, drivers or a dead center fix this coordinate in the drawing"
        raise _create_start_error(evaluator, selected, values, reason)
    if closed_q is not q:
        closed_q[selected] = values
    return closed_q


def _describe_failure(
    path: _Path, selected: Array, values: Array, q: Array, remaining: float
) -> BeamdaeError:
    """Return the error of a path that ends at `q`, where this fraction of the gaps remains."""
    e, gaps = path.evaluator.equations, path.drawn_gaps
    worst = int(np.argmax(np.abs(gaps) / path.scales))
    if worst < e.m:
        gap = abs(gaps[worst])
        return BeamdaeError(
            f"{e.lam_names[worst]}: the joints cannot be closed at t = {path.time[0]:g} s because "
            f"a gap of {remaining * gap:.6g} (m or rad) remains of {gap:.6g}; check the dimensions "
            "of the parts and the start values."
        )
    k = path.selected[worst - e.m]
    reason = f"{e.q_names[k]} can be led only to {q[k]:.6g} on the branch of the drawing"
    return _create_start_error(path.evaluator, selected, values, reason)


def _create_start_error(
    evaluator: StateEvaluator, selected: Array, values: Array, reason: str
) -> BeamdaeError:
    names = evaluator.equations.q_names
    request = ", ".join(f"{names[k]} = {x:g}" for k, x in zip(selected, values, strict=True))
    return BeamdaeError(
        f"start: the joints cannot be closed with {request}, because {reason}; specify fewer or "
        "different positions."
    )


@dataclass(frozen=True)
class _Path:
    """Path on which the gaps of the joints and of selected coordinates shrink in proportion.

    Attributes
    ----------
    evaluator, time
        See `close_joints`.
    drawn
        Positions (n,) at which the path begins, and whose forces F (elastic forces, weight and
        loads) are subtracted in the strain energy.
    selected, values
        Indices of independent coordinates and their values at the end.
    """

    evaluator: StateEvaluator
    time: Array
    drawn: Array
    selected: Array
    values: Array

    @cached_property
    def _measure(self) -> DisplacementMeasure:
        return DisplacementMeasure.of(self.evaluator.equations)

    @cached_property
    def scales(self) -> Array:
        e = self.evaluator.equations
        return np.concatenate([e.constraint_scales, e.position_scales[self.selected]])

    @cached_property
    def drawn_gaps(self) -> Array:
        return self._gaps(self.drawn)

    def follow(self) -> tuple[Array, float]:
        """Return the last positions (`drawn` itself if no gap is open), and the share of the gaps.

        The share that remains is zero unless the path ends before.
        """
        q, remaining, step, relaxes = self.drawn, 1.0, 1.0, True
        if not np.all(np.isfinite(self.drawn_gaps)):
            name = self.evaluator.equations.lam_names[np.argmin(np.isfinite(self.drawn_gaps))]
            raise BeamdaeError(
                f"{name}: the constraint is not finite at t = {self.time[0]:g} s; check the laws "
                "and the start values."
            )
        if self._size(self.drawn_gaps) <= self._rounding(q):
            return q, 0.0
        require_independent_constraints(self.evaluator, self.time, q)
        while remaining > 0.0:
            rotation = self._rotation(self._least_change(q, self.drawn_gaps))
            step = min(step, remaining, _MAX_PREDICTED_ROTATION / max(rotation, 1e-300))
            end = max(remaining - step, 0.0)
            is_smallest = step <= _MIN_STEP
            contraction = _MAX_LAST_CONTRACTION if is_smallest else _MAX_CONTRACTION
            next_q = self._take_step(q, end, contraction, relaxes)
            if next_q is not None:
                q, remaining, step = next_q, end, step * _STEP_FACTOR
            elif not is_smallest:
                step /= _STEP_FACTOR
            elif relaxes:
                relaxes = False
            else:
                break
        return q, remaining

    def _gaps(self, q: Array) -> Array:
        joint_gaps = self.evaluator.position_gaps(self.time, q)
        return np.concatenate([joint_gaps, q[self.selected] - self.values])

    def _size(self, gaps: Array) -> float:
        return float(np.max(np.abs(gaps) / self.scales, initial=0.0))

    def _rounding(self, q: Array) -> float:
        scales = self.evaluator.equations.position_scales
        return float(_GAP_ROUNDING * (1.0 + np.max(np.abs(q) / scales, initial=0.0)))

    def _rotation(self, change: Array) -> float:
        return float(np.max(np.abs(change[self.evaluator.equations.is_angle]), initial=0.0))

    def _least_change(self, q: Array, gaps: Array, force: Array | float = 0.0) -> Array:
        """Return the x with x . W x / 2 - x . force minimal, W = M + T^2 K, by which gaps vanish.

        First-order states that are not selected do not change.
        """
        change = find_least_change(
            self.evaluator, self.time, q, None, CLOSING_COEFFICIENTS, gaps, self.selected, force
        )
        change[np.setdiff1d(self.evaluator.equations.states, self.selected)] = 0.0
        return change

    def _take_step(
        self, begin: Array, remaining: float, max_contraction: float, relaxes: bool
    ) -> Array | None:
        """Return the positions near `begin` at which this fraction of the gaps remains, or None."""
        gaps = remaining * self.drawn_gaps
        try:
            q = self._close(begin, gaps, max_contraction)
            if q is None or self._rotation(q - begin) > _MAX_ROTATION:
                return None
            return self._relax(begin, q, gaps) if relaxes else q
        except (BeamdaeError, np.linalg.LinAlgError):
            return None

    def _close(self, begin: Array, remaining_gaps: Array, max_contraction: float) -> Array | None:
        """Return positions with these gaps by Newton's method, or None if it does not contract."""
        q = last_q = begin
        last_size, last_change = np.inf, np.inf
        for _ in range(_MAX_ITERATIONS):
            gaps = self._gaps(q) - remaining_gaps
            size = self._size(gaps)
            is_stalled = size <= _POSITION_TOLERANCE and size > _CLOSING_RATIO * last_size
            if size <= self._rounding(q) or is_stalled:
                return q if size <= last_size else last_q
            change = self._least_change(q, gaps)
            change_size = self._measure.farthest(change)
            if not change_size < np.inf or (
                size > _POSITION_TOLERANCE and change_size > max_contraction * last_change
            ):
                return None
            last_q, last_size, last_change = q, size, change_size
            q = q + change
        return None

    def _relax(self, begin: Array, q: Array, remaining_gaps: Array) -> Array | None:
        """Return positions with these gaps, and with the least motion and strain energy, or None.

        Newton's method solves M (q - begin) + T^2 (F(q) - F(drawn)) + R^T mu = 0, where R is the
        derivative of the gaps. The result is used only if it reduces the strain energy.
        """
        if self._strain_energy(q) == 0.0:
            return q
        e, evaluator = self.evaluator.equations, self.evaluator
        zeros, best, last_size = np.zeros(e.n), q, np.inf
        drawn_force = evaluator.force(self.time, self.drawn, zeros, zeros)
        for _ in range(_MAX_ITERATIONS):
            elastic = evaluator.force(self.time, best, zeros, zeros) - drawn_force
            inertia = evaluator.mass_matrix(self.time, best) @ (best - begin)
            force = e.without_states(-inertia - _RIGID_TIME**2 * elastic)
            change = self._least_change(best, self._gaps(best) - remaining_gaps, force)
            size = float(np.max(np.abs(change) / e.position_scales))
            if not self._rotation(best + change - begin) <= _MAX_ROTATION:
                return None
            best = best + change
            if size < _CONVERGED_CHANGE or last_size <= size < _SMALL_CHANGE:
                return min(q, best, key=self._strain_energy)
            last_size = size
        return None

    def _strain_energy(self, q: Array) -> float:
        e = self.evaluator.equations
        zeros, no_reactions = np.zeros((1, e.n)), np.zeros((1, e.m))
        rows = BalanceRows(e)(self.time[None], q[None], zeros, zeros, no_reactions)
        return float(rows[0, _STRAIN_COLUMN])
