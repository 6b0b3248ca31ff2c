"""Curves of limit and branch points in the load factor and one parameter of a model.

A critical point solves F(x, mu, p) = 0, g = 0, where F_x is singular if and only if g is zero. At a
branch point, F_mu is in the range of F_x, too: t is zero. Both follow from F_x bordered by its
softest mode c (Griewank & Reddien, SIAM J. Numer. Anal. 21 (1984) 176; Govaerts, Numerical Methods
for Bifurcations of Dynamical Equilibria, SIAM (2000)):

    [F_x c; c^T 0] [v z; g t] = [0 -F_mu; 1 0],   [F_x c; c^T 0]^T [w; g] = [0; 1],
    dg = -w^T dF_x v,   dt = -w^T (dF_x z + dF_mu).

The equations of branch points contain a multiple of c as a further force, which is zero for
symmetric structures (Moore, Numer. Funct. Anal. Optim. 2 (1980) 441).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.continuation.critical import BRANCH, Count, critical_modes
from beamdae.analysis.continuation.engine import (
    CurveError,
    Linearization,
    Point,
    Problem,
    factorize_bordered,
)
from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.analysis.statics.pivot_signs import ASYMMETRY_TOLERANCE
from beamdae.analysis.statics.static_problem import StaticProblem
from beamdae.errors import BeamdaeError

Array = np.ndarray

# Size of a change of the parameter by its range, or of motion and load factor by five times those
# at the first point: small, because rounding errors of solutions are measured in these sizes, too.
CHANGE_SIZE = 0.05
_RELATIVE_CHANGE = 0.2 * CHANGE_SIZE
# Smallest motion, in natural sizes, to which others are relative: rounding errors are not measured.
_MIN_MOTION = 1e-6
# Differences of the tangent along a motion, in natural sizes: near the cube root of rounding, since
# places where the curve turns have relative errors of its square.
_DIFFERENCE = 1e-5
# Grid of shares of the range on which the equations are differenced, for the convergence only.
_GRID = 2.0**-10
# Work of the load in a mode, relative to its largest value, above which a mode has a limit.
_MIN_WORK = 1e-6
# Multiple of c, in natural sizes, up to which it is a rounding error.
_MAX_FORCE = 1e-12
# Models kept for parameters that are evaluated again.
_MAX_MODELS = 8


class _Equations(NamedTuple):
    """F, F_mu and F_x in natural sizes."""

    residual: Array
    by_factor: Array
    stiffness: sp.csc_array


# Static equations, and the unknowns (n + m,) of the drawing, for shares of a range.
Family = Callable[[float], tuple[StaticProblem, Array]]


def create_family(build: Callable[[float], LoadedEquations]) -> Family:
    """Return static equations as a function of the share of the range of a parameter.

    It raises CurveError if a model cannot be built, or has another number of unknowns.
    """

    @lru_cache(_MAX_MODELS)
    def at(share: float) -> tuple[StaticProblem, Array]:
        try:
            problem = StaticProblem(build(share))
        except BeamdaeError as error:
            raise CurveError(f"the model cannot be built ({error})") from None
        reference = problem.start(problem.system.equations.q0)
        if share and len(reference) != len(at(0.0)[1]):
            raise CurveError("the parameter changes the number of coordinates or joints")
        return problem, reference

    return at


class CriticalCurve(Problem):
    """Equations of limit or branch points for the curve engine; the parameter is a share.

    The unknowns are the displacements from the drawing (n + m,) in natural sizes, the load factor
    and, for branch points, the multiple of c.

    Parameters
    ----------
    family
        Static equations as a function of the parameter.
    kind
        `LIMIT` or `BRANCH`.
    first
        Critical point of the first member.
    """

    def __init__(self, family: Family, kind: str, first: Point) -> None:
        self.family, self.kind = family, kind
        problem, reference = family(0.0)
        self._scales, self._n, self._size = problem.scales, problem.n, len(reference)
        self._energy = abs(problem.matrix(first.x, first.p)).max()
        self._first_mode = (critical_modes(first)[:, 0] / self._scales)[: self._n]
        u, weights = (first.x - reference) / self._scales, problem.weights * self._scales
        self.first = np.append(u, [first.p, 0.0][: 1 + (kind == BRANCH)])
        self._weights = np.zeros_like(self.first)
        motion = max(np.max(np.abs(u * weights)), _MIN_MOTION)
        self._weights[: self._size] = _RELATIVE_CHANGE / motion * weights
        self._weights[self._size] = _RELATIVE_CHANGE / (abs(first.p) or 1.0)

    @property
    def weights(self) -> Array:
        """Inverse natural sizes of the unknowns, and 0 for multipliers."""
        return self._weights

    def state(self, x: Array, share: float) -> tuple[Array, float]:
        """Return the static unknowns (n + m,) and the load factor."""
        u = x[: self._size]
        return self.family(share)[1] + self._scales * u, float(x[self._size])

    def _evaluate(self, x: Array, share: float) -> _Equations:
        problem, _ = self.family(share)
        state, sizes = self.state(x, share), self._scales / self._energy
        residual, by_factor = problem.residual(*state)
        own = self._scales / problem.scales
        stiffness = sp.csc_array(problem.matrix(*state) * own * own[:, None] / self._energy)
        return _Equations(sizes * residual, sizes * by_factor, stiffness)

    def _border(self, stiffness: sp.csc_array) -> tuple[Array, Any]:
        """Return the softest mode (n + m,) and factors of the stiffness bordered by it.

        It contains no multipliers, which may far exceed the coordinates of the mode.
        """
        border, end = np.zeros(self._size), np.append(np.zeros(self._size), 1.0)
        border[: self._n] = self._first_mode
        mode = factorize_bordered(stiffness, border, border).solve(end)[: self._n]
        border[: self._n] = mode / np.linalg.norm(mode)
        return border, factorize_bordered(stiffness, border, border)

    def linearize(self, x: Array, p: float, last: Any = None) -> Linearization:
        """Return the equations, linearized about a point."""
        here, n, is_branch = self._evaluate(x, p), self._size, self.kind == BRANCH
        # Toward the middle, because no model may exist beyond the ends of the range.
        beside = _GRID * float(np.round(p / _GRID + np.copysign(0.75, 0.5 - p)))
        near, shift = self._evaluate(x, beside), beside - p
        unit = np.zeros_like(x)
        unit[n] = 1.0
        # The tangent is linear in the load factor.
        by_factor = self._evaluate(x + unit, p).stiffness - here.stiffness
        mode, factors = self._border(here.stiffness)
        end = np.append(np.zeros(n), 1.0)
        left = factors.solve(end, "T")[:n]
        residual, column = here.residual, here.by_factor[:, None]
        rights = [(end, 0.0)]
        if is_branch:
            residual, column = residual + x[n + 1] * mode, np.stack([here.by_factor, mode], axis=1)
            rights.append((np.append(-here.by_factor, 0.0), 1.0))
        tests, rows, rates = [], [], []
        for right, along_load in rights:
            solution = factors.solve(right)
            motion = solution[:n]
            step = along_load * unit
            step[:n] = motion
            size = _DIFFERENCE / np.max(np.abs(motion[: self._n]))
            ahead, behind = (self._evaluate(x + d * step, p).stiffness for d in (size, -size))
            by_x = -left @ (ahead - behind) / (2.0 * size)
            rows.append(np.append(by_x, [-left @ by_factor @ motion, 0.0][: 1 + is_branch]))
            change = (near.stiffness - here.stiffness) @ motion
            rates.append(-left @ (change + along_load * (near.by_factor - here.by_factor)) / shift)
            tests.append(solution[-1])
        jacobian = sp.vstack([sp.hstack([here.stiffness, column]), np.array(rows)])
        return Linearization(
            np.append(residual, tests),
            np.append((near.residual - here.residual) / shift, rates),
            sp.csc_array(jacobian),
        )

    def _second_mode(self, point: Point) -> tuple[int, float]:
        """Return the number of negative eigenvalues and the work of the load in the softest mode.

        The critical mode is excluded, and the work is relative to its largest value.
        """
        equations = self._evaluate(point.x, point.p)
        border = sp.csc_array(self._border(equations.stiffness)[0][:, None])
        bordered = sp.block_array([[equations.stiffness, border], [border.T, None]])
        values, vectors = np.linalg.eigh(bordered.toarray())
        mode = vectors[: self._n, np.argmin(np.abs(values))]
        load = equations.by_factor[: self._n]
        size = max(np.linalg.norm(load) * np.linalg.norm(mode), np.finfo(float).tiny)
        return int(np.sum(values < 0.0)) - self._size + self._n - 1, abs(load @ mode) / size

    def has_limit(self, point: Point) -> bool:
        """Return True if the load does work in the softest mode besides the critical one."""
        return self._second_mode(point)[1] > _MIN_WORK

    def monitor(self, point: Point) -> Count:
        """Return the number of unstable directions besides the critical one; -1 if unknown.

        Raises
        ------
        CurveError
            If a branch point requires a further force.
        """
        if self.kind == BRANCH and abs(point.x[-1]) > _MAX_FORCE:
            raise CurveError("the structure loses its symmetry, and the branch point vanishes")
        signs = self.family(point.p)[0].signs(*self.state(point.x, point.p))
        has_potential = signs.asymmetry <= ASYMMETRY_TOLERANCE * signs.size
        return Count(self._second_mode(point)[0] if has_potential else -1, 0)
