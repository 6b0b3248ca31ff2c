"""Consistent start: positions, velocities, accelerations and multipliers that fit the joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.least_strain import minimize_strain
from beamdae.equations.starts.redundant_constraints import (
    analyze_constraint_rank,
    describe_dependent_sets,
    find_dependent_sets,
    require_independent,
)
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.errors import BeamdaeError
from beamdae.linear.factorizations import Factorization, SingularMatrixError, create_factorization
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

_FRICTION_ITERATIONS = 50
# Of a change, relative to what is found: rounding, with room for a badly scaled matrix.
_FRICTION_TOLERANCE = 1e-10


def _solve_with_friction(
    own: StateEvaluator, time: Array, q: Array, v: Array, gamma: Array, stiff_time: float
) -> tuple[Array, Array]:
    """Solve M a + F(0, lam) + G^T lam = 0, G a = gamma, by Newton's iteration from lam = 0.

    See `ConsistencySolver.acceleration`. What the matrix says of dF/dlam is exact, so that the iteration
    converges at once where friction is proportional to the reactions.

    Raises
    ------
    BeamdaeError
        If there are none, as in Painleve's paradox.
    """
    e, pattern = own.equations, own.sums.saddle_pattern
    solver, c = create_factorization(pattern), (stiff_time**2, 0.0, 1.0)
    found = np.zeros(e.n + e.m)
    for _ in range(_FRICTION_ITERATIONS):
        a, lam = found[: e.n], found[e.n :]
        force = own.force(time, q, v, None, lam)
        nonzeros = own.saddle(time, q, v, None, c, lam)
        if not (np.isfinite(force).all() and np.isfinite(nonzeros).all()):
            break
        block = own.sums.block.matrix(nonzeros)
        parts = (own.gradients(time, q), own.sums.gradient_pattern.indices)
        g = sp.csc_array((*parts, own.sums.gradient_pattern.indptr), shape=(e.m, e.n))
        off = np.concatenate([block @ a + force + g.T @ lam, g @ a - gamma])
        try:
            solver.factorize(nonzeros)
        except SingularMatrixError:
            break
        change = solver.solve(-off)
        found = found + change
        size = float(np.max(np.abs(found), initial=0.0))
        if np.max(np.abs(change), initial=0.0) <= _FRICTION_TOLERANCE * size:
            return found[: e.n], found[e.n :]
    names = sorted({name.rpartition(".")[0] for name in _friction_multipliers(own)})
    raise BeamdaeError(
        f"{', '.join(names)}: no accelerations and reactions fit the friction at "
        f"t = {time[0]:g} s, it is too large for the mechanism to slide (Painleve's paradox); "
        "take a smaller coefficient of friction, or a larger regularization velocity."
    )


def _friction_multipliers(own: StateEvaluator) -> list[str]:
    """Names of the multipliers that forces depend on."""
    terms = (term.rows for term in own.equations.forces if term.rows is not None)
    return [own.equations.lam_names[k] for rows in terms for k in rows.indices]


_POSITION_ITERATIONS = 50
_POSITION_TOLERANCE = 1e-12
# Joints are closed by rigid motion before anything faster than this [s] is bent.
_RIGID_TIME = 1.0
# Of so many constraints it is told what motions they block: that takes their number cubed.
_MOST_EXPLAINED = 300

# Coefficients (c0, c1, c2) of stiffness, damping and mass.
_MASS = (0.0, 0.0, 1.0)
_CLOSING = (_RIGID_TIME**2, 0.0, 1.0)
# Numbers of a law that are rounded by hand do not meet exactly; this much [m or rad] is no jump.
_JUMP = 1e-3
# What rounding leaves of a mass matrix that is not what it should be, relative to its entries.
_SKEW = 1e-9
_MOST_MASSES = 300


@dataclass(frozen=True)
class ConsistencySolver:
    """Makes states of a mechanism consistent, at the start and at breakpoints."""

    equations: EquationsOfMotion

    @cached_property
    def _own(self) -> StateEvaluator:
        return StateEvaluator(self.equations)

    @cached_property
    def _solver(self) -> Factorization:
        return create_factorization(self._own.sums.saddle_pattern)

    def require_inertia(self) -> None:
        """Refuse a mass matrix that is not symmetric, or negative in some direction, at the start.

        Beyond `_MOST_MASSES` coordinates the signs of its diagonal alone are looked at.

        Raises
        ------
        BeamdaeError
            Naming the coordinate.
        """
        e, block = self.equations, self._own.sums.block
        nonzeros = self._own.saddle(np.zeros(2), e.q0, e.v0, None, _MASS)
        mass = nonzeros[block.entries]
        if not np.isfinite(mass).all():
            return
        size = float(np.max(np.abs(mass), initial=0.0))
        skew = np.abs(mass - block.transposed(mass))
        if np.max(skew, initial=0.0) > _SKEW * size:
            worst = int(np.argmax(skew))
            row = max(int(block.pattern.indices[worst]), int(block.columns[worst]))
            raise BeamdaeError(
                f"{e.q_names[row]}: the mass matrix must be symmetric, this row is not."
            )
        least, coordinate = _least_inertia(block.matrix(nonzeros))
        if least < -_SKEW * size:
            raise BeamdaeError(
                f"{e.q_names[coordinate]}: the mass matrix must not be negative in any direction, "
                f"along this coordinate it is {least:.3g}."
            )

    def forces(self, time: Array, state: State, a: Array) -> Array:
        """F at accelerations `a`, in place of those of the state."""
        return self._own.force(time, state.q, state.v, a)

    def linearize_forces(self, time: Array, state: State) -> tuple[sp.csc_array, ...]:
        """Stiffness dF/dq, damping dF/dv and mass dF/da, sparse (n, n) each."""
        own, (q, v, a, _) = self._own, state
        return tuple(
            own.sums.block.matrix(own.saddle(time, q, v, a, c)) for c in np.eye(3).tolist()
        )

    def mass_solver(self, time: Array, state: State) -> Callable[[Array], Array]:
        """Accelerations that forces bring about in the jointed mechanism: f -> a."""
        e = self.equations
        solver, _ = self._factorized(time, state.q, state.v, _MASS)
        return lambda force: solver.solve(np.concatenate([force, np.zeros(e.m)]))[: e.n]

    def levels(
        self, time: Array, q: Array, v: Array | None = None, a: Array | None = None
    ) -> Array:
        """g, g_dot and g_ddot at time = (t, branch), (3, m); zero stands for what is not given."""
        return self._own.constraint_levels(time, q, v, a)

    def rest_state(self, q: Array) -> State:
        """The state at positions `q` without motion and reactions."""
        still = np.zeros(self.equations.n)
        return State(q, still, still, np.zeros(self.equations.m))

    def constraint_matrix(self, time: Array, q: Array) -> sp.csc_array:
        """G = dg/dq, sparse (m, n)."""
        pattern, nonzeros = self._own.sums.gradient_pattern, self._own.gradients(time, q)
        return sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)

    def state(self, time: Array, q: Array, v: Array) -> State:
        """Consistent state nearest to (q, v) at time = (t, branch).

        Positions move as little as the joints allow, measured by inertia and stiffness; velocities
        are projected in the metric of the mass matrix; accelerations and multipliers solve
        [[M, G^T], [G, 0]] (a, lam) = (f, gamma).

        Raises
        ------
        BeamdaeError
            If joints contradict each other or cannot be closed.
        """
        q = self._close(time, np.array(q, float))
        self.require_independent(time, q)
        v = self._project(time, q, np.array(v, float))
        return State(q, v, *self.acceleration(time, q, v))

    def position_gaps(self, time: Array, q: Array) -> Array:
        """How far each joint is open, g."""
        return self._own.constraint_levels(time, q)[0]

    def require_independent(self, time: Array, q: Array) -> None:
        """Refuse joints that depend on each other at positions `q`, naming them."""
        e, pattern = self.equations, self._own.sums.gradient_pattern
        gradients = self._own.gradients(time, q) * e.position_scales[column_indices(pattern)]

        def what_they_block() -> str:
            if e.m > _MOST_EXPLAINED:
                return ""
            joints = analyze_constraint_rank(self, time, q)
            return describe_dependent_sets(
                find_dependent_sets(self, time, q, np.zeros(e.n), joints)
            )

        require_independent(pattern, gradients, e.lam_names, float(time[0]), what_they_block)

    def require_continuous(self, branch_before: float, time: Array, q: Array) -> None:
        """Refuse a law that makes positions jump at time = (t, branch) after `branch_before`."""
        e = self.equations
        before = self._own.constraint_levels(np.array([time[0], branch_before]), q)[0]
        jump = np.abs(self._own.constraint_levels(time, q)[0] - before)
        if e.m > 0 and np.max(jump) > _JUMP * min(1.0, e.length):
            name = e.lam_names[int(np.argmax(jump))]
            raise BeamdaeError(
                f"{name}: a law makes positions jump at t = {time[0]:g} s by {np.max(jump):.3g}, "
                "it must go on from where it was."
            )

    def acceleration(
        self, time: Array, q: Array, v: Array, stiff_time: float = 0.0
    ) -> tuple[Array, Array]:
        """Accelerations and multipliers of a consistent (q, v).

        With a `stiff_time` T [s], M + T^2 K stands for M: modes of frequency w respond by
        1 / (1 + (w T)^2) of their acceleration.
        """
        e = self.equations
        gamma = -self._own.constraint_levels(time, q, v)[2]
        solver, force = self._factorized(time, q, v, (stiff_time**2, 0.0, 1.0))
        if any(term.rows is not None for term in e.forces):
            return _solve_with_friction(self._own, time, q, v, gamma, stiff_time)
        solution = solver.solve(np.concatenate([-force, gamma]))
        return solution[: e.n], solution[e.n :]

    def evaluate_normal_jerk(
        self, time: Array, state: State, delta: float, of_positions: bool = False
    ) -> Array:
        """P j, P = M^-1 G^T (G M^-1 G^T)^-1 G: what the joints prescribe of the jerk j.

        G j follows from g_ddot alone, differentiated along the motion at constant a over
        +-`delta` [s]: stiff elastic forces do not enter. If `of_positions`, only what of g_ddot
        comes from constraints on positions.
        """
        e = self.equations
        if e.m == 0:
            return np.zeros(e.n)
        q, v, a, _ = state
        levels = [
            self._own.constraint_levels(
                time + np.array([d, 0.0]), q + d * v + 0.5 * d**2 * a, v + d * a, a
            )[2]
            for d in (delta, -delta)
        ]
        rate = (levels[0] - levels[1]) / (2.0 * delta)
        if of_positions:
            rate[e.nonholonomic_rows] = 0.0
        solver, _ = self._factorized(time, q, v, _MASS)
        return solver.solve(np.concatenate([np.zeros(e.n), -rate]))[: e.n]

    def _factorized(
        self, time: Array, q: Array, v: Array, c: tuple[float, float, float]
    ) -> tuple[Factorization, Array]:
        e, solver, pattern = self.equations, self._solver, self._own.sums.saddle_pattern
        force, nonzeros = self._own.force(time, q, v), self._own.saddle(time, q, v, None, c)
        if not np.all(np.isfinite(force)):
            raise BeamdaeError(
                f"{self._name(force)}: the forces are not finite at t = {time[0]:g}, "
                "a law or a start value is wrong."
            )
        if not np.isfinite(nonzeros).all():
            column = int(np.flatnonzero(~np.isfinite(nonzeros))[0])
            row = int(pattern.indices[column])
            raise BeamdaeError(
                f"{(*e.q_names, *e.lam_names)[row]}: a derivative of its forces is not finite at "
                f"t = {time[0]:g}, such as that of a root at zero; a small number under the root "
                "mends it."
            )
        try:
            solver.factorize(nonzeros)
        except SingularMatrixError:
            raise BeamdaeError(
                f"{self._massless(pattern, nonzeros)}: it can move without inertia "
                f"at t = {time[0]:g}, "
                "give it a mass or a joint."
            ) from None
        return solver, force

    def _name(self, force: Array) -> str:
        return self.equations.q_names[int(np.flatnonzero(~np.isfinite(force))[0])]

    def _massless(self, pattern: sp.csc_array, nonzeros: Array) -> str:
        """The coordinate that moves most in the motion no equation resists."""
        e = self.equations
        matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), pattern.shape).toarray()
        unresisted = la.svd(np.nan_to_num(matrix))[2][-1, : e.n]
        return e.q_names[int(np.argmax(np.abs(unresisted)))]

    def _close(self, time: Array, q: Array) -> Array:
        closed = self._closed(time, q)
        if closed is q:
            return q

        def held(at: Array) -> tuple[Array, sp.csc_array]:
            return self.position_gaps(time, at), self.constraint_matrix(time, at)

        return minimize_strain(self, time, q, closed, q, held, _RIGID_TIME**2)

    def _closed(self, time: Array, q: Array) -> Array:
        e = self.equations
        still = np.zeros(e.n)
        for _ in range(_POSITION_ITERATIONS):
            g = self._own.constraint_levels(time, q)[0]
            if not np.all(np.isfinite(g)):
                bad = e.lam_names[int(np.flatnonzero(~np.isfinite(g))[0])]
                raise BeamdaeError(f"{bad}: the constraint is not finite at t = {time[0]:g}.")
            if e.m == 0 or np.max(np.abs(g)) <= _POSITION_TOLERANCE * max(1.0, e.length):
                return q
            self.require_independent(time, q)
            solver, _ = self._factorized(time, q, still, _CLOSING)
            q = q + solver.solve(np.concatenate([still, -g]))[: e.n]
        worst = int(np.argmax(np.abs(g)))
        raise BeamdaeError(
            f"{e.lam_names[worst]}: the joints cannot be closed at t = {time[0]:g}, after "
            f"{_POSITION_ITERATIONS} iterations this one is still open by {abs(g[worst]):.3g}."
        )

    def _project(self, time: Array, q: Array, v: Array) -> Array:
        e = self.equations
        g_dot = self._own.constraint_levels(time, q, v)[1]
        if e.m == 0 or not np.any(g_dot):
            return v
        solver, _ = self._factorized(time, q, v, _MASS)
        return v + solver.solve(np.concatenate([np.zeros(e.n), -g_dot]))[: e.n]


def _least_inertia(mass: sp.csc_array) -> tuple[float, int]:
    """Smallest eigenvalue, or 0 if all are positive, and the coordinate that moves most in it.

    Of many coordinates the smallest of the diagonal.
    """
    if mass.shape[0] > _MOST_MASSES:
        diagonal = mass.diagonal()
        return float(diagonal.min()), int(diagonal.argmin())
    dense = mass.toarray()
    try:
        np.linalg.cholesky(dense)
    except np.linalg.LinAlgError:
        pass
    else:
        return 0.0, 0
    values, vectors = la.eigh(dense, subset_by_index=(0, 0))
    return float(values[0]), int(np.argmax(np.abs(vectors[:, 0])))
