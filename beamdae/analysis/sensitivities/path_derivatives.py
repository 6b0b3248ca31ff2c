"""Derivatives of points of an equilibrium path, including its critical points.

Where a quantity s(x, mu) is prescribed, such as the load factor mu, the derivatives of a point
solve

    [R_x R_mu; s_x s_mu] (dx, dmu) = -(R_p, s_p) dp.

At limit and branch points, R_x is singular. With vectors b and c near its null vectors, the
bordered system R(x, mu, p) + h b = 0, c^T x = xi defines the reduced function h(xi, mu, p), whose
derivatives are h_xi = g and, for example,

    [R_x b; c^T 0] (x_mu, h_mu) = -(R_mu, 0),    [R_x b; c^T 0]^T (w, g) = (0, 1),
    dg = -w^T dR_x v,    d(w^T R_mu) = w^T (dR_x x_mu + dR_mu).

A limit point solves h = g = 0, so that dmu = -h_p / h_mu dp = -w^T R_p / w^T R_mu dp. A branch
point solves g = h_mu = 0 together with h = 0, which holds for all values of a parameter that
preserves the branch point, such as those of symmetric structures. At a flutter point, the real part
of an eigenvalue of the linearized motion is zero with damping, and two eigenvalues coalesce without
damping. Cf. Godoy, Theory of Elastic Stability: Analysis and Sensitivity, Taylor & Francis (1999);
Wriggers & Simo, Int. J. Numer. Meth. Eng. 30 (1990) 155, doi:10.1002/nme.1620300110.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from beamdae.analysis.continuation.critical import BRANCH, LIMIT
from beamdae.analysis.eigenproblems.eigensolution import EigenSolution, solve_eigenproblem
from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.analysis.sensitivities.eigen_derivatives import EigenpairDerivatives, Pencil
from beamdae.analysis.sensitivities.singularity import SingularityTest, natural_scales
from beamdae.analysis.sensitivities.static_derivatives import LoadDerivatives
from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import Tangent
from beamdae.errors import BeamdaeError

Array = np.ndarray

# Newton corrections of critical points, which converge quadratically.
_REFINEMENTS = 2
# Number of modes among which critical ones are sought. Modes with a larger damping ratio are not
# about to grow and do not count: strong damping slows many modes down to nearly the same rate.
_MODE_COUNT = 12
_MAX_GROWTH_DAMPING = 0.5
# Eigenvalues with a smaller imaginary part, relative to their magnitude, do not oscillate.
_MIN_OSCILLATION = 1e-3
# A parameter preserves a branch point if the part of its forces along the critical mode is below
# this fraction.
_MAX_IMPERFECTION = 1e-6
# Smaller forces, relative to the stiffness, are rounding errors of symmetric structures.
_NEGLIGIBLE_FORCE = 1e-10


@dataclass(frozen=True)
class PrescribedPoint:
    """Regular point of a path at which a quantity is prescribed.

    Attributes
    ----------
    system
        Static equations.
    x, mu
        Equilibrium (q, lam) and its load factor.
    gradient
        Derivatives of the prescribed quantity with respect to x and mu.
    """

    system: LoadedEquations
    x: Array
    mu: float
    gradient: tuple[Array, float]

    def derivative(self, loads: LoadDerivatives, rate: float) -> tuple[Array, float]:
        """Return dx and dmu; `rate` is the derivative of the quantity at constant (x, mu).

        Raises
        ------
        BeamdaeError
            If the tangent is singular.
        """
        return self.solve(loads.residual(self.x, self.mu)[0], rate)

    def solve(self, forces: Array, rate: float) -> tuple[Array, float]:
        """Return dx and dmu for the change of the residual `forces` and of the quantity `rate`."""
        unknowns, energy, load, control = self._scales
        right = -np.append(unknowns / energy * forces, rate / control)
        solution = self._factors.solve(right)
        solution += self._factors.solve(right - self._matrix @ solution)
        if not np.all(np.isfinite(solution)):
            raise singular_error(self.mu)
        return unknowns * solution[:-1], load * float(solution[-1])

    @cached_property
    def _scales(self) -> tuple[Array, float, float, float]:
        """Scales of the unknowns, the energy, the load factor and the prescribed quantity."""
        unknowns, energy = natural_scales(self.system, self.x, self.mu)
        by_factor = unknowns / energy * self.system.residual(self.x, self.mu)[1]
        load = 1.0 / (np.max(np.abs(by_factor), initial=0.0) or 1.0)
        by_x, by_mu = self.gradient
        control = max(np.max(np.abs(unknowns * by_x), initial=0.0), load * abs(by_mu)) or 1.0
        return unknowns, energy, float(load), float(control)

    @cached_property
    def _matrix(self) -> sp.csc_matrix:
        unknowns, energy, load, control = self._scales
        system, (by_x, by_mu) = self.system, self.gradient
        tangent = system.matrix(self.x, self.mu) * unknowns * unknowns[:, None]
        by_factor = unknowns * system.residual(self.x, self.mu)[1] * load
        last = np.array([[by_mu * load / control]])
        blocks = [
            [tangent / energy, sp.csc_array(by_factor[:, None] / energy)],
            [sp.csc_array((unknowns * by_x / control)[None]), sp.csc_array(last)],
        ]
        return sp.csc_matrix(sp.block_array(blocks, format="csc"))

    @cached_property
    def _factors(self) -> SuperLU:
        try:
            return splu(self._matrix)
        except RuntimeError:
            raise singular_error(self.mu) from None


@dataclass(frozen=True)
class FlutterPoint:
    """Point of a path at which oscillations begin to grow.

    With damping, the real part of the critical eigenvalue l is zero. Without damping, two
    eigenvalues l coalesce, where w^T P'(l) z is zero, see `eigen_derivatives`: then,
    w^T (P_mu dmu + P_p dp) z is zero, which is averaged over both eigenvalues, because the point is
    located up to a small error.

    Attributes
    ----------
    system
        Static equations.
    x, mu
        Equilibrium (q, lam) and its load factor.
    """

    system: LoadedEquations
    x: Array
    mu: float

    def derivative(self, loads: LoadDerivatives) -> tuple[Array, float]:
        """Return dx and dmu."""
        dx, _ = self._point.derivative(loads, 0.0)
        change = self._pencil(loads.motion_tangent(self.x, self.mu, dx))
        if self._is_damped:
            (pair,) = self._pairs
            by_parameter, by_load = (
                (pair.work(x) / pair.slope_work).real for x in (change, self._by_load)
            )
            rate = -by_parameter / by_load
        else:
            ratios = [pair.work(change) / pair.work(self._by_load) for pair in self._pairs]
            rate = -float(np.mean(np.real(ratios)))
        return dx + rate * self._load_response, rate

    @cached_property
    def _point(self) -> PrescribedPoint:
        return PrescribedPoint(self.system, self.x, self.mu, (np.zeros_like(self.x), 1.0))

    @cached_property
    def _load_response(self) -> Array:
        return self._point.solve(np.zeros_like(self.x), -1.0)[0]

    @cached_property
    def _by_load(self) -> Pencil:
        """Change of the linearized motion along the path, by the load factor."""
        constant, x = LoadDerivatives(self.system), self.x
        along = constant.motion_tangent(x, self.mu, self._load_response)
        n, system = self.system.equations.n, self.system
        state = State(x[:n], np.zeros(n), np.zeros(n), x[n:])
        ends = [system.motion_tangent(factor, state) for factor in (0.0, 1.0)]
        added = {
            name: getattr(along, name) + getattr(ends[1], name) - getattr(ends[0], name)
            for name in ("damping", "stiffness", "reactions")
        }
        return self._pencil(along._replace(**added))

    def _pencil(self, tangent: Tangent) -> Pencil:
        return Pencil.of(self.system.equations, tangent, True)

    @cached_property
    def _linearized(self) -> LinearizedEquations:
        e, x = self.system.equations, self.x
        state = State(x[: e.n], np.zeros(e.n), np.zeros(e.n), x[e.n :])
        return LinearizedEquations(e, self.system.motion_tangent(self.mu, state))

    @cached_property
    def _is_damped(self) -> bool:
        damping = self._linearized.tangent.damping
        return bool(damping.nnz) and abs(damping).max() > 0.0

    @cached_property
    def _pairs(self) -> list[EigenpairDerivatives]:
        """Critical eigenpair with damping, and the two that coalesce without."""
        e = self.system.equations
        solution = _merge_modes(_solve_slowest_modes(self._linearized, e))
        values = solution.values
        oscillating = np.flatnonzero(np.abs(values.imag) > _MIN_OSCILLATION * np.abs(values))
        if self._is_damped:
            ratios = np.abs(values[oscillating].real / values[oscillating])
            selected = oscillating[[int(np.argmin(ratios))]]
        else:
            order = oscillating[np.argsort(np.abs(values[oscillating]))]
            first = int(np.argmin(np.abs(np.diff(values[order]) / values[order[1:]])))
            selected = order[first : first + 2]
        pencil = self._pencil(self._linearized.tangent)
        return [
            EigenpairDerivatives(
                pencil, e.position_scales, complex(values[k]), solution.shapes[:, k]
            )
            for k in selected
        ]


def _solve_slowest_modes(
    linearized: LinearizedEquations, e: EquationsOfMotion
) -> list[EigenSolution]:
    """Return the slowest modes of each group of coupled parts of `e`.

    They contain `_MODE_COUNT` of those that do not decay strongly. All modes of a small structure
    may be faster than as many modes of a large one.

    Raises
    ------
    BeamdaeError
        If the equations are singular, or if they are too many to compute these modes.
    """
    solutions = []
    for group, rows in linearized.split(e.parts):
        modes = solve_eigenproblem(group, _MODE_COUNT, max_damping_ratio=_MAX_GROWTH_DAMPING)
        shapes = np.zeros((e.n, modes.shapes.shape[1]), complex)
        shapes[rows] = modes.shapes
        solutions.append(EigenSolution(modes.values, shapes))
    return solutions


def _merge_modes(solutions: list[EigenSolution]) -> EigenSolution:
    """Return all modes in ascending order of |eigenvalue|."""
    values = np.concatenate([modes.values for modes in solutions])
    shapes = np.hstack([modes.shapes for modes in solutions])
    order = np.argsort(np.abs(values), kind="stable")
    return EigenSolution(values[order], shapes[:, order])


def singular_error(mu: float) -> BeamdaeError:
    """Return the error for a singular tangent at the load factor `mu`."""
    return BeamdaeError(
        f"equilibrium_sensitivities: the equilibrium at load factor {mu:g} is not unique, because "
        "its tangent stiffness is singular; add a spring or a joint, or end the path before this "
        "load factor."
    )


@dataclass(frozen=True)
class SingularPoint:
    """Limit or branch point of a path.

    Attributes
    ----------
    system
        Static equations.
    x, mu
        Equilibrium (q, lam) and its load factor.
    kind
        `LIMIT` or `BRANCH`.
    """

    system: LoadedEquations
    x: Array
    mu: float
    kind: str

    def refine(self) -> SingularPoint:
        """Return the point after Newton's method for the conditions that determine it.

        Paths interpolate their critical points, with errors near 1e-7 of the load factor.
        """
        point = self
        for _ in range(_REFINEMENTS):
            change = point._newton_change()
            if not np.all(np.isfinite(change[0])):
                return self
            point = replace(point, x=point.x + change[0], mu=point.mu + change[1])
        return point

    def _newton_change(self) -> tuple[Array, float]:
        unknowns, energy = self._test.scales
        forces, by_factor = (unknowns / energy * x for x in self.system.residual(self.x, self.mu))
        left, singularity = self._null_vectors[0], self._singularity
        response, work = self._solve(-forces)
        along = self._scale(self._constant.tangent(self.x, self.mu, unknowns * response))
        return self._reduce(along, response, work, -singularity, left @ by_factor)

    def derivative(self, loads: LoadDerivatives) -> tuple[Array, float] | None:
        """Return dx and dmu; None if the parameter does not preserve a branch point."""
        unknowns, energy = self._test.scales
        left, _ = self._null_vectors
        forces, by_factor = (unknowns / energy * x for x in loads.residual(self.x, self.mu))
        limit = _MAX_IMPERFECTION * max(float(np.linalg.norm(forces)), _NEGLIGIBLE_FORCE)
        if self.kind == BRANCH and abs(left @ forces) > limit * np.linalg.norm(left):
            return None
        response, work = self._solve(-forces)
        along = self._scale(loads.tangent(self.x, self.mu, unknowns * response))
        return self._reduce(along, response, work, 0.0, left @ by_factor)

    def _reduce(
        self,
        along: sp.csc_array,
        response: Array,
        work: float,
        singularity: float,
        by_factor: float,
    ) -> tuple[Array, float]:
        """Return the changes of x and mu that satisfy the linearized conditions.

        `response` and `work` are the changes of x and h at constant xi and mu, and `along` that of
        the tangent. `singularity` and `by_factor` are added to the changes of w^T R_x v and
        w^T R_mu.
        """
        left, mode = self._null_vectors
        load_response, load_work = self._load_response
        curvature, mixed = left @ (self._along_mode @ mode), left @ (self._along_load @ mode)
        change = left @ (along @ mode) + singularity
        if self.kind == LIMIT:
            rate = -work / load_work
            share = -(change + rate * mixed) / curvature
        else:
            second = left @ (along @ load_response + self._by_factor @ response) + by_factor
            both = self._along_load @ load_response + self._by_factor @ load_response
            matrix = np.array([[curvature, mixed], [mixed, left @ both]])
            share, rate = np.linalg.solve(matrix, -np.array([change, second]))
        dx = response + rate * load_response + share * mode
        return self._test.scales.unknowns * dx, float(rate)

    @cached_property
    def _test(self) -> SingularityTest:
        return SingularityTest.near(self.system, self.x, self.mu)

    def _scale(self, matrix: sp.csc_array) -> sp.csc_array:
        unknowns, energy = self._test.scales
        return sp.csc_array(matrix * unknowns * unknowns[:, None] / energy)

    @cached_property
    def _factors(self) -> SuperLU:
        return self._test.factorize(self.system, self.x, self.mu)[0]

    @cached_property
    def _null_vectors(self) -> tuple[Array, Array]:
        """Left and right null vector w and v of the scaled tangent."""
        unit = np.append(np.zeros(len(self.x)), 1.0)
        return self._factors.solve(unit, "T")[:-1], self._factors.solve(unit)[:-1]

    @cached_property
    def _singularity(self) -> float:
        """Value of g."""
        return float(self._factors.solve(np.append(np.zeros(len(self.x)), 1.0))[-1])

    def _solve(self, right: Array) -> tuple[Array, float]:
        """Return the solution of the bordered system for (`right`, 0)."""
        solution = self._factors.solve(np.append(right, 0.0))
        return solution[:-1], float(solution[-1])

    @cached_property
    def _load_response(self) -> tuple[Array, float]:
        """Derivatives x_mu and h_mu."""
        unknowns, energy = self._test.scales
        return self._solve(-unknowns / energy * self.system.residual(self.x, self.mu)[1])

    @cached_property
    def _constant(self) -> LoadDerivatives:
        """Derivatives along directions of x alone."""
        return LoadDerivatives(self.system)

    @cached_property
    def _by_factor(self) -> sp.csc_array:
        """Derivative of the tangent with respect to mu at constant x."""
        return self._scale(self._constant.tangent_by_factor(self.x))

    @cached_property
    def _along_mode(self) -> sp.csc_array:
        direction = self._test.scales.unknowns * self._null_vectors[1]
        return self._scale(self._constant.tangent(self.x, self.mu, direction))

    @cached_property
    def _along_load(self) -> sp.csc_array:
        direction = self._test.scales.unknowns * self._load_response[0]
        along = self._scale(self._constant.tangent(self.x, self.mu, direction))
        return sp.csc_array(along + self._by_factor)
