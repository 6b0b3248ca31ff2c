"""Consistent initial conditions: positions, velocities, accelerations and multipliers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu, spsolve

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.closing import close_joints
from beamdae.equations.starts.dependent_constraints import (
    group_tied,
    require_independent_constraints,
)
from beamdae.equations.starts.rigid_motions import compute_rigid_motions
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.errors import BeamdaeError
from beamdae.symbolic.sparse_operators import build_selection

Array = np.ndarray

# Bodies can begin to move rigidly if at most this fraction of the velocities at which the joints
# open remains as an error.
_RIGID_START_TOLERANCE = 1e-6
_REGULARIZATION = 1e-13  # relative to 1 / largest weight; makes dependent rows solvable
_OPENING_TOLERANCE = 1e-12  # velocity of a closed joint, relative to the largest velocity
_ROUNDING = 1e-9  # smaller velocities, relative to the largest, are zero
_MAX_LAW_JUMP = 1e-3  # [rad], or relative to the length; allows for rounded numbers in laws
_ASYMMETRY_TOLERANCE = 1e-9  # rounding in a mass matrix, relative to its largest entry
_MAX_FRICTION_ITERATIONS = 50
_FRICTION_TOLERANCE = 1e-8  # relative change, whose square is the error of Newton's method


@dataclass(frozen=True)
class ConsistencySolver(StateEvaluator):
    """Makes states of a mechanism consistent, at the start and at breakpoints.

    Newton's method closes the joints with the least change of positions, velocities are projected
    in the metric of the mass matrix (but see `start_state`), and accelerations and multipliers
    solve the saddle-point system

        [[M, G^T], [G, 0]] (a, lam) = (f, gamma),

    where f = -F and gamma = -g_ddot at a = 0 and lam = 0. With friction in joints, F depends on
    lam, and Newton's method solves this system.

    The rates of first-order states x follow from the other coordinates: x' = f(t, q, v, x). Their
    second derivatives are set to zero: only generalized-alpha uses them, whose errors of order two
    are then smaller than with exact values, also for fast states off their slow motion.

    Times are arrays (t, branch) with t [s]. Do not share an instance between threads.
    """

    def state(self, time: Array, q: Array, v: Array) -> State:
        """Return the consistent state nearest to (q, v).

        Positions change as little as the joints allow, weighted by inertia and stiffness;
        velocities are projected in the metric of the mass matrix.

        Raises
        ------
        BeamdaeError
            If constraints depend on each other or cannot be closed, or no accelerations exist (see
            `acceleration`).
        """
        q = self.close_positions(time, np.array(q, float))
        require_independent_constraints(self, time, q)
        return self.complete(time, q, self.project_velocities(time, q, np.array(v, float)))

    def project_velocities(
        self, time: Array, q: Array, v: Array, prescribed: Sequence[int] = ()
    ) -> Array:
        """Return the velocities nearest to v, in the metric of the mass matrix, with g_dot = 0.

        Velocities with the indices `prescribed` stay, as far as joints allow it.
        """
        g_dot = self.constraint_levels(time, q, v)[1]
        if not g_dot.any():
            return v
        if not len(prescribed):
            return v + self.solve_saddle(time, q, v, 0.0, -g_dot)[0]
        gradients, fixed = self.constraint_matrix(time, q), build_selection(prescribed, len(v))
        return v + _solve_least_change(self.mass_matrix(time, q), gradients, -g_dot, fixed)

    def complete(self, time: Array, q: Array, v: Array) -> State:
        """Return the state at consistent (q, v), with the rates x' = f of first-order states."""
        if len(self.equations.states):
            # The rows of these states are x' - f.
            v = v - self._is_state * self.force(time, q, v)
        return State(q, v, *self.acceleration(time, q, v))

    def close_positions(
        self, time: Array, q: Array, requested: Mapping[int, float] | None = None
    ) -> Array:
        """Return the positions (n,) on the branch of `q` at which the joints are closed.

        `requested` are values of coordinates by index. See `close_joints`.
        """
        return close_joints(self, time, q, requested or {})

    @property
    def _is_state(self) -> Array:
        return 1.0 - self.equations.without_states(np.ones(self.equations.n))

    def start_state(self, time: Array, q: Array, v: Array) -> State:
        """Return the consistent state at the start of a run.

        Velocities follow `rigid_velocities`: bodies move rigidly with given velocities and drivers
        if the joints allow it, because a driver or body that moves only the root of a beam would
        make the beam whip. Other velocities are projected as in `state`.

        Raises
        ------
        BeamdaeError
            As `state`.
        """
        q = self.close_positions(time, np.array(q, float))
        return self.state(time, q, self.rigid_velocities(time, q, np.array(v, float)))

    def acceleration(
        self, time: Array, q: Array, v: Array, stiff_time: float = 0.0
    ) -> tuple[Array, Array]:
        """Return accelerations (n,) and multipliers (m,) for consistent q and v, (n,) each.

        With a `stiff_time` T [s], T^2 times the second derivative of the forces F(q) along the
        motion, K a + F''[v, v], is added to the forces. The accelerations of modes of angular
        frequency w are then multiplied by 1 / (1 + (w T)^2), but not those with which stiff parts
        keep their strains, such as the centripetal accelerations of a rotating beam. The term
        T^2 F''[v, v] is a second difference; see `evaluate_force_change`.

        Raises
        ------
        BeamdaeError
            If forces, or derivatives of forces or constraints, are not finite, a motion has no
            inertia, or no solution of the equations with friction is found.
        """
        if self.equations.has_friction:
            return self._solve_with_friction(time, q, v, stiff_time)
        coefficients = (stiff_time**2, 0.0, 1.0)
        force, gamma = self.force(time, q, v), -self.constraint_levels(time, q, v)[2]
        if stiff_time > 0.0 and v.any():
            force = force + self.evaluate_force_change(time, q, v, stiff_time)
        return self.solve_saddle(time, q, v, -force, gamma, coefficients)

    def unbalance(
        self, time: Array, q: Array, v: Array, a: Array, lam: Array, stiff_time: float
    ) -> tuple[Array, Array]:
        """Return the residuals (n,) and (m,) of the equations that `acceleration` solves."""
        force, levels = self.balance(time, q, v, a, lam)
        if stiff_time > 0.0:
            change = self.evaluate_force_change(time, q, v, stiff_time)
            stiffness = self.force_matrix(time, q, v, None, (1.0, 0.0, 0.0), lam)
            # The matrix has a unit diagonal for first-order states.
            force = force + change + stiffness @ (stiff_time**2 * a) + self._is_state * a
        return force, levels[2]

    def evaluate_normal_jerk(
        self, time: Array, state: State, delta: float, holonomic_only: bool = False
    ) -> Array:
        """Return P j, (n,), the part of the jerk j that the constraints determine.

        The projector is P = M^-1 G^T (G M^-1 G^T)^-1 G. -G j is the central difference of g_ddot
        over +-`delta` [s] along the motion at constant a, so that stiff elastic forces do not
        enter. With `holonomic_only`, G j is zero for nonholonomic constraints.
        """
        e = self.equations
        if e.m == 0:
            return np.zeros(e.n)
        q, v, a, _ = state
        ahead, behind = (
            self.constraint_levels(
                time + np.array([d, 0.0]), q + d * v + 0.5 * d**2 * a, v + d * a, a
            )[2]
            for d in (delta, -delta)
        )
        factor = np.full(e.m, 0.5 / delta)
        if holonomic_only:
            factor[e.nonholonomic_rows] = 0.0
        return self.solve_saddle(time, q, v, 0.0, factor * (behind - ahead))[0]

    def require_inertia(self) -> None:
        """Reject a mass matrix that is not symmetric or not positive semidefinite at the start.

        Raises
        ------
        BeamdaeError
            If the mass matrix is not symmetric or not positive semidefinite; the message names the
            coordinate.
        """
        e, mass = self.equations, self.mass_matrix(np.zeros(2), self.equations.q0)
        if not np.isfinite(mass.data).all():
            return
        size = float(np.max(np.abs(mass.data), initial=0.0))
        asymmetry = abs(mass - mass.T).tocoo()
        if np.max(asymmetry.data, initial=0.0) > _ASYMMETRY_TOLERANCE * size:
            worst = int(np.argmax(asymmetry.data))
            row = max(x[worst] for x in asymmetry.coords)
            raise BeamdaeError(
                f"{e.q_names[row]}: the mass matrix is not symmetric (entries of this "
                f"row and column differ by {asymmetry.data[worst]:.3g}); correct the inertia "
                "forces of the part."
            )
        # Pivots without inertia are positive, too.
        shift = _ASYMMETRY_TOLERANCE * (size or 1.0)
        shifted, options = sp.csc_array(mass + shift * sp.eye_array(e.n)), {"SymmetricMode": True}
        try:
            # All diagonal pivots of a positive definite matrix are positive.
            factors = splu(shifted, "MMD_AT_PLUS_A", 0.0, options=options)
            is_definite = bool(np.all(factors.U.diagonal() > 0.0))
        except RuntimeError:
            is_definite = False
        if not is_definite:
            (inertia,), vectors = la.eigh(mass.toarray(), subset_by_index=(0, 0))
            raise BeamdaeError(
                f"{e.q_names[int(np.argmax(np.abs(vectors)))]}: the mass matrix has a negative "
                f"eigenvalue of {inertia:.3g} along this coordinate; correct the inertia forces of "
                "the part."
            )

    def require_continuous(self, branch_before: float, time: Array, q: Array) -> None:
        """Reject laws that make positions jump at `time` = (t, branch).

        `branch_before` selects the branch of laws before t.

        Raises
        ------
        BeamdaeError
            If a constraint jumps by more than 1e-3 rad, or 1e-3 of the characteristic length.
        """
        e = self.equations
        before = self.position_gaps(np.array([time[0], branch_before]), q)
        jump = np.abs(self.position_gaps(time, q) - before)
        relative_jump = jump / e.constraint_scales
        if np.max(relative_jump, initial=0.0) > _MAX_LAW_JUMP:
            worst = int(np.argmax(relative_jump))
            raise BeamdaeError(
                f"{e.lam_names[worst]}: a law makes positions jump by {jump[worst]:.3g} (m or rad) "
                f"at t = {time[0]:g} s; make the law continuous there."
            )

    def rigid_velocities(
        self, time: Array, q: Array, v: Array, prescribed: Sequence[int] = ()
    ) -> Array:
        """Return velocities (n,) with which the bodies move rigidly and the joints stay closed.

        Velocities (as vectors) and angular velocities of bodies that are given, or are not zero in
        `v`, are kept; others are free, and their change has the least kinetic energy. Bodies that
        joints connect keep their velocities in `v` if their joints stay closed or if no such motion
        exists: a joint may stop a moving body by an impact.

        Parameters
        ----------
        time
            Time and branch, (2,).
        q, v
            Closed positions and requested velocities, (n,) each.
        prescribed
            Indices of velocities that never change.
        """
        e = self.equations
        g_dot = self.constraint_levels(time, q, v)[1]
        is_open = np.abs(g_dot) / e.constraint_scales > _OPENING_TOLERANCE * velocity_size(e, v)
        if not np.any(is_open):
            return v
        gradients = sp.csr_array(self.constraint_matrix(time, q))
        # Parts whose coordinates a constraint contains move together.
        ties = np.split(e.part_indices[gradients.indices], gradients.indptr[1:-1])
        groups, groups_of_rows = np.split(group_tied(len(e.parts), ties), [len(e.parts)])
        groups_of_coordinates = groups[e.part_indices]
        motions = sp.csc_array(e.position_scales[:, None] * compute_rigid_motions(e, q))
        # Number of the vector of each rigid motion: of a translation or of a rotation.
        columns = np.split(motions.indices, motions.indptr[1:-1])
        vectors = np.array([2 * e.part_indices[x[0]] + np.any(e.is_angle[x]) for x in columns])
        given_vectors = np.flatnonzero([part.given_velocities for part in e.parts])
        mass, prescribed_rows = self.mass_matrix(time, q), np.asarray(prescribed, int)
        for group in np.unique(groups_of_rows[is_open]):
            of_group, inside = groups_of_rows == group, groups[vectors // 2] == group
            shapes, numbers, opening = motions[:, inside], vectors[inside], g_dot[of_group]
            of_v = np.where(groups_of_coordinates == group, v, 0.0)
            amplitudes = spsolve(sp.csc_array(shapes.T @ shapes), shapes.T @ of_v)
            weight, rows = shapes.T @ mass @ shapes, sp.csr_array(gradients[of_group] @ shapes)
            # Independent of units; rows that no rigid motion affects are zero.
            lengths = sp.linalg.norm(rows, axis=1)
            lengths[lengths == 0.0] = 1.0
            rows = sp.diags_array(1.0 / lengths) @ rows
            kept = prescribed_rows[groups_of_coordinates[prescribed_rows] == group]
            fixed = sp.csr_array(shapes[kept])
            is_given = np.isin(numbers, given_vectors)
            is_given |= np.abs(amplitudes) > _ROUNDING * np.max(np.abs(amplitudes))
            is_given[fixed.indices] = False
            given = np.flatnonzero(np.isin(numbers, numbers[is_given]))
            fixed = sp.vstack([fixed, build_selection(given.tolist(), len(numbers))])
            weight = weight / abs(weight).max()
            change = shapes @ _solve_least_change(weight, rows, -opening / lengths, fixed)
            errors = np.abs(np.append(gradients[of_group] @ change + opening, change[kept]))
            # False also if no solution was found, for which the change is not finite.
            if np.max(errors) <= _RIGID_START_TOLERANCE * np.max(np.abs(opening)):
                v = v + change
        return v

    def _solve_with_friction(
        self, time: Array, q: Array, v: Array, stiff_time: float
    ) -> tuple[Array, Array]:
        """Return accelerations and multipliers by Newton's method from zero.

        The first iteration gives the solution if friction is proportional to the reactions.
        """
        e, coefficients = self.equations, (stiff_time**2, 0.0, 1.0)
        a, lam = np.zeros(e.n), np.zeros(e.m)
        for _ in range(_MAX_FRICTION_ITERATIONS):
            force, rates = self.unbalance(time, q, v, a, lam, stiff_time)
            try:
                correction = self.solve_saddle(time, q, v, -force, -rates, coefficients, lam)
            except BeamdaeError:
                if not lam.any():
                    raise
                break
            a, lam = a + correction[0], lam + correction[1]
            sizes = [np.max(np.abs(np.concatenate(x)), initial=0.0) for x in (correction, (a, lam))]
            if not np.isfinite(sizes[1]):
                break
            if sizes[0] <= _FRICTION_TOLERANCE * sizes[1]:
                return a, lam
        rows = [k for term in e.forces if term.rows is not None for k in term.rows.indices]
        joints = sorted({e.lam_names[k].rpartition(".")[0] for k in rows})
        radii = [f"{k}: {x.radius:g} m" for k, x in e.frictions.items() if x.radius is not None]
        check = f"check the radius ({', '.join(radii)}), " if radii else ""
        raise BeamdaeError(
            f"{', '.join(joints)}: with friction, no accelerations and reactions "
            f"satisfy the equations at t = {time[0]:g} s (Painleve's paradox); {check}reduce "
            "the coefficient of friction or increase the regularization velocity."
        )


def velocity_size(e: EquationsOfMotion, v: Array) -> float:
    """Return the largest relative velocity of v (n,), at least 1 per second [1/s].

    Errors of constraints, relative to `constraint_scales`, are compared to it.
    """
    return max(1.0, float(np.max(np.abs(v) / e.position_scales, initial=0.0)))


def _solve_least_change(weight: Any, rows: Any, values: Array, fixed: Any) -> Array:
    """Return the x with rows @ x = values and fixed @ x = 0 that minimizes x . weight x.

    All matrices are sparse, and `rows` and `fixed` may depend on each other. x is nan if `weight`
    is singular on their null space.
    """
    rows, size = sp.vstack([rows, fixed]), float(abs(weight).max()) or 1.0
    count, n = rows.shape
    regularization = sp.eye_array(count) * (_REGULARIZATION / size)
    matrix = sp.block_array([[weight, rows.T], [rows, -regularization]], format="csc")
    right = np.zeros(n + count)
    right[n : n + len(values)] = values
    try:
        return splu(matrix).solve(right)[:n]
    except RuntimeError:
        return np.full(n, np.nan)
