"""Consistent start: positions, velocities, accelerations and multipliers that fit the joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.assembly import SparseSum
from beamdae.compiled import Compiled
from beamdae.equations import EquationsOfMotion
from beamdae.errors import BeamdaeError
from beamdae.formulations import State
from beamdae.linear import Factorization, SingularMatrix, factorization

Array = np.ndarray
MX = ca.MX

_POSITION_ITERATIONS = 50
_POSITION_TOLERANCE = 1e-12
# Elastic coordinates slower than this are moved as readily as rigid ones when joints are closed.
_RIGID_TIME = 1e-2


@dataclass(frozen=True)
class Starter:
    """Makes states of a mechanism consistent; compiled once, used at the start and at breakpoints."""

    equations: EquationsOfMotion

    @cached_property
    def _constraints(self) -> Compiled:
        """(time, q, v, a, p) -> g, g_dot, g_ddot and G."""
        e = self.equations
        time, q, v, a = MX.sym("time", 2), *(MX.sym(x, e.n) for x in "qva")
        p = MX.sym("p", len(e.p))
        levels = [ca.densify(e.level(k, time, q, v, a, p)) for k in range(3)]
        total = SparseSum((e.m, e.n))
        for block in e.constraint_blocks(time, q, v, p, MX.zeros(e.m))[0]:
            total.add(block)
        outputs = [*levels, ca.densify(total.matrix())]
        return Compiled(ca.Function("constraints", [time, q, v, a, p], outputs), e.p)

    @cached_property
    def _saddle(self) -> tuple[Compiled, Factorization]:
        """(time, q, v, a, p, c_q) -> F and non-zeros of [[c_q K + M, G^T], [G, 0]]."""
        e = self.equations
        time, q, v, a = MX.sym("time", 2), *(MX.sym(x, e.n) for x in "qva")
        p, c_q = MX.sym("p", len(e.p)), MX.sym("c_q")
        total = SparseSum((e.n + e.m, e.n + e.m))
        stiffness, mass = e.tangent(time, q, v, a, p, MX(0), MX(1))
        for block in stiffness:
            total.add(block.scaled(c_q))
        for block in mass:
            total.add(block)
        for block in e.constraint_blocks(time, q, v, p, MX.zeros(e.m))[0]:
            total.add(block, e.n, 0)
            total.add(block.transposed, 0, e.n)
        pattern, nonzeros = total.assemble()
        force = ca.densify(e.force(time, q, v, a, p))
        function = ca.Function("saddle", [time, q, v, a, p, c_q], [force, nonzeros])
        return Compiled(function), factorization(pattern)

    def constraint_matrix(self, time: Array, q: Array) -> Array:
        """G = dg/dq, dense (m, n)."""
        e = self.equations
        still = np.zeros(e.n)
        return self._constraints(time, q, still, still)[3].reshape(e.m, e.n, order="F").copy()

    def state(self, time: Array, q: Array, v: Array) -> State:
        """Consistent state nearest to (q, v) at time = (t, phase).

        Positions move as little as the joints allow, measured by inertia and stiffness; velocities
        are projected in the metric of the mass matrix; accelerations and multipliers solve
        [[M, G^T], [G, 0]] (a, lam) = (f, gamma).

        Raises
        ------
        BeamdaeError
            If joints contradict each other or cannot be closed.
        """
        q = self._close(time, np.array(q, float))
        self._check_rank(time, q)
        v = self._project(time, q, np.array(v, float))
        return State(q, v, *self.acceleration(time, q, v))

    def acceleration(self, time: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Accelerations and multipliers of a consistent (q, v)."""
        e = self.equations
        gamma = -self._constraints(time, q, v, np.zeros(e.n))[2].copy()
        solver, force = self._factorized(time, q, v, 0.0)
        solution = solver.solve(np.concatenate([-force, gamma]))
        return solution[: e.n], solution[e.n :]

    def normal_jerk(self, time: Array, state: State, delta: float) -> Array:
        """P j, P = M^-1 G^T (G M^-1 G^T)^-1 G: what the joints prescribe of the jerk j.

        G j follows from g_ddot alone, differentiated along the motion at constant a over
        +-`delta` [s]: stiff elastic forces do not enter.
        """
        e = self.equations
        if e.m == 0:
            return np.zeros(e.n)
        q, v, a, _ = state
        levels = [
            self._constraints(time + np.array([d, 0.0]), q + d * v + 0.5 * d**2 * a, v + d * a, a)[
                2
            ].copy()
            for d in (delta, -delta)
        ]
        rate = (levels[0] - levels[1]) / (2.0 * delta)
        solver, _ = self._factorized(time, q, v, 0.0)
        return solver.solve(np.concatenate([np.zeros(e.n), -rate]))[: e.n]

    def _factorized(
        self, time: Array, q: Array, v: Array, c_q: float
    ) -> tuple[Factorization, Array]:
        e = self.equations
        function, solver = self._saddle
        force, nonzeros = function(time, q, v, np.zeros(e.n), e.p, c_q)
        if not np.all(np.isfinite(force)):
            raise BeamdaeError(
                f"{self._name(force)}: the forces are not finite at t = {time[0]:g}, "
                "a law or a start value is wrong."
            )
        try:
            solver.factorize(nonzeros)
        except SingularMatrix:
            raise BeamdaeError(
                f"{self._massless(time, q)}: it can move without inertia at t = {time[0]:g}, "
                "give it a mass or a joint."
            ) from None
        return solver, force

    def _name(self, force: Array) -> str:
        return self.equations.q_names[int(np.flatnonzero(~np.isfinite(force))[0])]

    def _massless(self, time: Array, q: Array) -> str:
        e = self.equations
        function, _ = self._saddle
        unit = np.zeros(e.n)
        rest = function(time, q, unit, unit, e.p, 0.0)[0].copy()
        moved = function(time, q, unit, unit + 1.0, e.p, 0.0)[0] - rest
        return e.q_names[int(np.argmin(np.abs(moved)))]

    def _close(self, time: Array, q: Array) -> Array:
        e = self.equations
        still = np.zeros(e.n)
        for _ in range(_POSITION_ITERATIONS):
            g = self._constraints(time, q, still, still)[0].copy()
            if not np.all(np.isfinite(g)):
                bad = e.lam_names[int(np.flatnonzero(~np.isfinite(g))[0])]
                raise BeamdaeError(f"{bad}: the constraint is not finite at t = {time[0]:g}.")
            if e.m == 0 or np.max(np.abs(g)) <= _POSITION_TOLERANCE * max(1.0, e.length):
                return q
            self._check_rank(time, q)
            solver, _ = self._factorized(time, q, still, _RIGID_TIME**2)
            q = q + solver.solve(np.concatenate([still, -g]))[: e.n]
        worst = int(np.argmax(np.abs(g)))
        raise BeamdaeError(
            f"{e.lam_names[worst]}: the joints cannot be closed at t = {time[0]:g}, after "
            f"{_POSITION_ITERATIONS} iterations this one is still open by {abs(g[worst]):.3g}."
        )

    def _project(self, time: Array, q: Array, v: Array) -> Array:
        e = self.equations
        g_dot = self._constraints(time, q, v, np.zeros(e.n))[1].copy()
        if e.m == 0 or not np.any(g_dot):
            return v
        solver, _ = self._factorized(time, q, v, 0.0)
        return v + solver.solve(np.concatenate([np.zeros(e.n), -g_dot]))[: e.n]

    def _check_rank(self, time: Array, q: Array) -> None:
        e = self.equations
        if e.m == 0:
            return
        matrix = self.constraint_matrix(time, q) * e.position_scales
        size = np.linalg.norm(matrix, axis=1, keepdims=True)
        matrix = matrix / np.where(size > 0.0, size, 1.0)
        left, singular, _ = la.svd(matrix, full_matrices=False)
        rank = int(np.sum(singular > 1e-10))
        if rank == e.m:
            return
        involved = np.max(np.abs(left[:, rank:]), axis=1) > 1e-6
        names = ", ".join(name for name, one in zip(e.lam_names, involved, strict=True) if one)
        raise BeamdaeError(
            f"{names}: these constraints depend on each other at t = {time[0]:g}, "
            f"remove {e.m - rank} of them."
        )
