"""Derivatives of equilibria, critical points and modes by the implicit function theorem.

EQUILIBRIA F(x, mu; p) = 0: x are coordinates, multipliers and the forces of stiff parts, mu is the
load factor. With a prescribed control s(x, mu; p), such as the load factor, derivatives solve

    [F_x F_mu; s_x s_mu] (dx, dmu) = -(F_p, s_p) dp.

At limit and branch points, F_x is singular. With a vector b near its null vectors, the bordered
equations F(x, mu; p) + h b = 0, b^T x = xi define h(xi, mu; p), all of whose derivatives follow
from solutions with [F_x b; b^T 0]: the last component of (x', h') for the right-hand side
-(F_mu, 0) is h_mu, and that for -(dF_x v + dF_mu u, 0), with the change of the tangent along one
direction and another direction (v, u), is the mixed second derivative. A limit point solves
h = h_xi = 0. A branch point solves h_xi = h_mu = 0 together with h = 0, which holds for all values
of a parameter that preserves the branch point, such as those of symmetric structures. Cf. Godoy,
Theory of Elastic Stability: Analysis and Sensitivity, Taylor & Francis (1999); Wriggers & Simo,
Int. J. Numer. Meth. Eng. 30 (1990) 155, doi:10.1002/nme.1620300110.

EIGENPAIRS A(l; p) z = 0, with the matrix A of `LinearizedEquations.pencil` and z = (x, multipliers,
forces of stiff parts): the derivatives along a change dA solve

    [A A'(l) z; z^H M 0] (dz, dl) = -(dA z, 0)

for simple eigenvalues (Fox & Kapoor, AIAA J. 6 (1968) 2426, doi:10.2514/3.5008; Nelson, AIAA J. 14
(1976) 1201, doi:10.2514/3.7211, who deletes an equation in place of the border). The part of dz
along z follows from the normalization. At a flutter point, an eigenvalue has no real part, or
coalesces with another one.

F_p follows from the numbers of neighboring models and the exact derivatives of F by these numbers.
s and products with the matrices of F and A are differenced along the neighboring models, or along a
direction of x and mu.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.continuation.critical import critical_modes
from beamdae.analysis.continuation.engine import (
    Control,
    CurveError,
    Point,
    RefinedFactors,
    factorize_bordered,
    prescribe_parameter,
)
from beamdae.analysis.eigenproblems.eigensolution import solve_eigenproblem
from beamdae.analysis.eigenproblems.linearized_equations import (
    LinearizedEquations,
)
from beamdae.analysis.sensitivities.neighbors import (
    CENTRAL,
    RELATIVE_DIFFERENCE,
    Difference,
    Neighbors,
)
from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.analysis.statics.load_scaling import build_loading
from beamdae.analysis.statics.static_problem import StaticProblem
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.compliant_equations import introduce_resultants
from beamdae.equations.formulations.static_equations import (
    StaticEquations,
    find_idle_forces,
    plan_static_sums,
)
from beamdae.equations.structure import Structure
from beamdae.linear.factorizations import invert_to_power_of_two
from beamdae.parts.mechanism import EQUILIBRIUM
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_time
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator

Array = np.ndarray

# Newton corrections of critical points, which paths locate up to 1e-7 of the load factor.
_REFINEMENTS = 2
# A parameter preserves a branch point if its forces along the critical mode, in the neighboring
# models, are below this fraction of those that the load exerts on the mode at its natural size.
_MAX_IMPERFECTION = 1e-8
# Eigenvalues with a smaller imaginary part, relative to their magnitude, do not oscillate.
_MIN_OSCILLATION = 1e-3
# Inverse iterations for the next eigenvalue.
_GAP_ITERATIONS = 5


@dataclass(frozen=True, eq=False)
class Eigenpair:
    """Eigenvalue that is not zero, and its shape.

    Attributes
    ----------
    lin
        Linearized equations in mixed form.
    value, shape
        Eigenvalue l [1/s] and shape x (n,), with x^H M x = 1.
    """

    lin: LinearizedEquations
    value: complex
    shape: Array

    @cached_property
    def vector(self) -> Array:
        """Shape with its multipliers and forces, z."""
        return self._solve(np.zeros(len(self._row)), 1.0)[:-1]

    def derivative(self, change: Array, mass_change: Array) -> tuple[complex, Array]:
        """Return the derivatives of the eigenvalue and of the normalized shape.

        `change` and `mass_change` are dA z and dM x.
        """
        x, mass, solution = self.shape, self.lin.tangent.mass, -self._solve(change)
        response = solution[: len(x)]
        # The shape keeps x^H M x = 1 and the phase of x^T M x.
        share, size = complex(-0.5 * np.real(x.conj() @ mass_change)), x @ (mass @ x)
        if abs(size) > np.sqrt(np.finfo(float).eps):
            plain = x @ (2.0 * (mass @ response) + mass_change)
            share -= 0.5j * float(np.imag(plain)) / float(np.real(size))
        return complex(solution[-1]), response + share * x

    @cached_property
    def gap(self) -> float:
        """Distance to the nearest other eigenvalue, relative to |l|, if it is small."""
        vector, size = np.cos(np.arange(len(self._row)) ** 2.0), 1.0
        try:
            for _ in range(_GAP_ITERATIONS):
                vector = self._solve(self._slope @ vector / size)[:-1]
                size = float(np.linalg.norm(vector)) or 1.0
        except CurveError:
            return 0.0
        return 1.0 / (size * abs(self.value))

    @cached_property
    def _slope(self) -> sp.csc_array:
        """Derivative of A with respect to l."""
        _, *others = self.lin.pencil.matrices
        terms = (k * self.value ** (k - 1) * x for k, x in enumerate(others, 1))
        return sp.csc_array(sum(terms, sp.csc_array(others[0].shape)))

    @cached_property
    def _row(self) -> Array:
        """Row x^H M of the border."""
        return self._extend(self.lin.tangent.mass.T @ self.shape.conj())

    def _extend(self, x: Array) -> Array:
        """Return a vector with zeros for multipliers and forces, on which A' does not act."""
        return np.append(x, np.zeros(self.lin.pencil.matrices[0].shape[0] - len(x)))

    @cached_property
    def _bordered(self) -> tuple[Array, RefinedFactors]:
        """Scales of the rows of A, and factors of the bordered matrix."""
        matrix = sp.csc_array(
            sum(self.value**k * x.astype(complex) for k, x in enumerate(self.lin.pencil.matrices))
        )
        scales = invert_to_power_of_two(abs(matrix).max(axis=1).toarray().ravel())
        column = scales * (self._slope @ self._extend(self.shape))
        scaled = sp.csc_array(sp.diags_array(scales) @ matrix)
        return scales, factorize_bordered(scaled, column, self._row)

    def _solve(self, right: Array, last: float = 0.0) -> Array:
        """Return the solution of [A A' z; z^H M 0] (u, s) = (right, last)."""
        scales, factors = self._bordered
        return factors.solve(np.append(scales * right, last).astype(complex))


def apply_pencil(lin: LinearizedEquations, value: complex, z: Array) -> Array:
    """Return A(l) z."""
    return np.asarray(sum(value**k * (x @ z) for k, x in enumerate(lin.pencil.matrices)))


@dataclass(frozen=True)
class Direction(Neighbors):
    """Direction of a parameter, or of the unknowns.

    Attributes
    ----------
    models
        Pairs of static equations next to a point along it, and of the quantity that is prescribed.
    change
        Derivatives of (x, mu) along the direction, (n + m + 1,) or zero.
    parts
        Derivatives of the unloaded and of the loaded equations along a parameter, see
        `differentiate_equations`.
    """

    change: Array
    parts: Sequence[Callable[[Array], Array]] = ()

    @classmethod
    def of_unknowns(cls, point: Point, change: Array) -> Direction:
        """Return a direction of x and mu at a point, differenced in natural sizes."""
        step = RELATIVE_DIFFERENCE / (point.problem.measure(change[:-1]) or 1.0)
        models = [(point.problem, prescribe_parameter)] * len(CENTRAL)
        return cls(models, CENTRAL, step, change)

    def differentiate(
        self, point: Point, function: Callable[[StaticProblem, Array, float], Array]
    ) -> Array:
        """Return the derivative of a function of the equations, x and mu along the direction."""

        def evaluate(model: tuple[StaticProblem, Control], unknowns: Array) -> Array:
            return function(model[0], unknowns[:-1], float(unknowns[-1]))

        return np.asarray(self.along(evaluate, (np.append(point.x, point.p), self.change)))

    def residual(self, point: Point) -> Array:
        """Return the derivatives of F and of the prescribed quantity at constant x and mu."""
        unloaded, loaded = (part(point.x) for part in self.parts)
        rate = self.combine(control(point.x, point.p).value for _, control in self.models)
        return np.append(unloaded + point.p * (loaded - unloaded), rate)


def differentiate_equations(
    difference: Difference, here: StaticEquations, neighbors: Sequence[EquationsOfMotion]
) -> Callable[[Array], Array]:
    """Return the derivative of static equations along a parameter, as a function of (q, lam).

    It is exact: differences of small deformations would contain rounding errors that observed axial
    and shear forces enlarge.
    """
    part = difference.between(here.equations, neighbors)
    base = part.base
    n, size, dp = base.n, 2 * base.n + base.m, part.along(lambda e: e.p)
    total = SumEvaluator(StartDerivatives.of(part).plan_along(_plan_residual, size), base.p)
    set_time(total, *here.time)

    def differentiate(x: Array) -> Array:
        inputs = np.concatenate([x[:n], np.zeros(n), x[n:], np.zeros(size), dp])
        with np.errstate(invalid="ignore"):
            change = total(inputs, n + base.m)
        if np.all(np.isfinite(change)):
            return change
        # The root of a stiffness has no derivative at zero.
        residuals = (StaticEquations(e, here.time).residual(x[:n], x[n:]) for e in neighbors)
        return np.where(np.isfinite(change), change, difference.combine(residuals))

    return differentiate


def _plan_residual(structure: Structure) -> SumPlan:
    return plan_static_sums(structure).residual


@dataclass(frozen=True, eq=False)
class RegularPoint:
    """Point of a path at which a control is prescribed."""

    point: Point
    control: Control

    def derivative(self, direction: Direction) -> Array:
        """Return (dx, dmu)."""
        change = direction.residual(self.point)
        if self.control is prescribe_parameter:  # although the path prescribes a column at its end
            change[-1] = 0.0
        return self.respond(change)

    def respond(self, change: Array) -> Array:
        """Return the change of the unknowns that balances a change of the equations and control.

        Raises
        ------
        CurveError
            If the tangent is singular.
        """
        solution = self._factors.solve(-change)
        if not np.all(np.isfinite(solution)):
            raise CurveError("its tangent stiffness is singular")
        return np.asarray(solution)

    @property
    def is_regular(self) -> bool:
        """False if a motion has no stiffness."""
        return self._factors.is_regular

    @cached_property
    def _factors(self) -> RefinedFactors:
        row, column = (
            self.control(self.point.x, self.point.p),
            self.point.linearization.by_parameter,
        )
        return self.point.bordered(column, row.gradient[:-1], row.gradient[-1])


def find_unique_equilibrium(equations: EquationsOfMotion) -> RegularPoint | None:
    """Return the equilibrium in which a run starts, under all loads.

    Return None if it starts otherwise, or if a motion has no stiffness.
    """
    if equations.start is None or equations.start.description != EQUILIBRIUM:
        return None
    system, control = build_loading(equations, equations, None, 0.0).systems[0], prescribe_parameter
    problem = StaticProblem(system, idle=find_idle_forces(system.loaded))
    try:
        x = problem.point_at(equations.q0, 1.0).x
        result = RegularPoint(problem.correct(control, 1.0, x, 1.0), control)
        return result if result.is_regular else None
    except CurveError:
        return None


def differentiate_equilibrium(equilibrium: RegularPoint, difference: Difference) -> Array:
    """Return the derivatives of the positions of a `find_unique_equilibrium` along a parameter."""
    problem = equilibrium.point.problem
    assert isinstance(problem, StaticProblem)
    models = [introduce_resultants(e, problem.idle).equations for e in difference.models]
    forces = differentiate_equations(difference, problem.mixed.last, models)(equilibrium.point.x)
    return equilibrium.respond(np.append(forces, 0.0))[: problem.n]


class SingularPoint:
    """Limit or branch point of a path.

    Parameters
    ----------
    point
        The point, or one nearby.
    is_limit
        True for a limit point.
    """

    def __init__(self, point: Point, is_limit: bool) -> None:
        self.point, self._is_limit = point, is_limit
        border = point.problem.mode_weights**2 * critical_modes(point)[:, 0]
        self._factors, linear = point.bordered(border, border, 0.0), point.linearization
        # Derivatives of x and h by xi and mu.
        mode, self._by_xi = self._solve(np.zeros_like(point.x), 1.0)
        response, self._by_mu = self._solve(-linear.by_parameter)
        self._basis = np.array([np.append(mode, 0.0), np.append(response, 1.0)])
        directions = [Direction.of_unknowns(point, x) for x in self._basis]
        self._hessian = np.array([self._slopes(x) for x in directions])

    @classmethod
    def find(cls, problem: StaticProblem, q: Array, mu: float, is_limit: bool) -> SingularPoint:
        """Return the singular point next to these positions and this load factor."""
        found = cls(problem.point_at(q, mu), is_limit)
        found = found._move(np.append(found._unbalance()[0], 0.0))
        for _ in range(_REFINEMENTS):
            response, h = found._unbalance()
            direction = Direction.of_unknowns(found.point, np.append(response, 0.0))
            found = found._move(found._change(direction, h, (found._by_xi, found._by_mu)))
        if not found._factors.is_regular:
            raise CurveError("its critical mode is not unique")
        return found

    def derivative(self, direction: Direction) -> Array | None:
        """Return (dx, dmu); None if the parameter does not preserve a branch point."""
        response, h = self._solve(-direction.residual(self.point)[:-1])
        by_load, reach = self._hessian[0, 1] * self.point.p, max(map(abs, direction.steps))
        if not self._is_limit and abs(h) * reach > _MAX_IMPERFECTION * abs(by_load):
            return None
        return self._change(replace(direction, change=np.append(response, 0.0)), h)

    def _change(
        self, direction: Direction, h: float, slopes: tuple[float, float] = (0.0, 0.0)
    ) -> Array:
        """Return the change of x and mu after which the equations of the point hold.

        `direction` and `h` are the changes at constant xi and mu; `slopes` are added to those of
        the derivatives of h.
        """
        matrix, right = self._hessian, slopes + self._slopes(direction)
        if self._is_limit:
            matrix = np.array([(self._by_xi, self._by_mu), matrix[0]])
            right = np.array([h, right[0]])
        try:
            shares = np.linalg.solve(matrix, -right)
        except np.linalg.LinAlgError:
            raise CurveError("its critical mode is not unique") from None
        return direction.change + shares @ self._basis

    def _slopes(self, direction: Direction) -> Array:
        """Return the changes of the derivatives of h by xi and mu along a direction."""
        products = (partial(StaticProblem.product, along=x) for x in self._basis)
        changes = (direction.differentiate(self.point, product) for product in products)
        return np.array([self._solve(-x)[1] for x in changes])

    def _unbalance(self) -> tuple[Array, float]:
        return self._solve(-self.point.linearization.residual)

    def _move(self, change: Array) -> SingularPoint:
        return SingularPoint(self.point.plus(change), self._is_limit)

    def _solve(self, right: Array, last: float = 0.0) -> tuple[Array, float]:
        solution = self._factors.solve(np.append(right, last))
        if not np.all(np.isfinite(solution)):
            raise CurveError("its critical mode is not unique")
        return solution[:-1], float(solution[-1])


@dataclass(frozen=True, eq=False)
class FlutterPoint(RegularPoint):
    """Point of a path at which oscillations begin to grow.

    With damping, the real part of the critical eigenvalue is zero. Without damping, two eigenvalues
    coalesce, where the ratio of their derivatives by parameter and load remains finite. The result
    is averaged over both, because the point is located up to a small error.
    """

    def derivative(self, direction: Direction) -> Array:
        """Return (dx, dmu)."""
        load = self.respond(np.append(np.zeros_like(self.point.x), -1.0))
        response = replace(direction, change=super().derivative(direction))
        by_parameter = self._growth(response)
        by_load = self._growth(Direction.of_unknowns(self.point, load))
        return response.change - float(np.mean(np.real(by_parameter / by_load))) * load

    def _growth(self, direction: Direction) -> Array:
        """Return the derivatives of the eigenvalues, of their real parts with damping."""

        def apply(problem: StaticProblem, x: Array, mu: float) -> Array:
            lin = problem.system.linearize_motion(x, mu, problem.idle)
            return np.array([apply_pencil(lin, pair.value, pair.vector) for pair in self._pairs])

        changes = zip(self._pairs, direction.differentiate(self.point, apply), strict=True)
        rates = np.array([pair.derivative(x, 0.0 * pair.shape)[0] for pair, x in changes])
        return rates.real if self._is_damped else rates

    @cached_property
    def _motion(self) -> LinearizedEquations:
        """Motion in mixed form; its tangent contains the stiff forces, which couple parts."""
        point, problem = self.point, self.point.problem
        system, n = problem.system, problem.n
        state = State(point.x[:n], np.zeros(n), np.zeros(n), point.x[n:])
        tangent = system.motion_tangent(point.p, state)
        return replace(system.linearize_motion(point.x, point.p, problem.idle), tangent=tangent)

    @property
    def _is_damped(self) -> bool:
        damping = self._motion.tangent.damping
        return bool(damping.nnz) and abs(damping).max() > 0.0

    @cached_property
    def _pairs(self) -> list[Eigenpair]:
        """Critical eigenpair with damping, and the two that coalesce without."""
        # All modes, because the critical one may be faster than many decays.
        modes = solve_eigenproblem(self._motion, None)
        pairs = zip(modes.values.tolist(), modes.shapes.T, strict=True)
        found = [Eigenpair(self._motion, *pair) for pair in pairs]
        found = [x for x in found if abs(x.value.imag) > _MIN_OSCILLATION * abs(x.value)]
        if self._is_damped:
            return [min(found, key=lambda x: abs(x.value.real / x.value))]
        found.sort(key=lambda x: abs(x.value))
        ratios = [one.value / other.value for one, other in pairwise(found)]
        first = int(np.argmin(np.abs(1.0 - np.array(ratios))))
        return found[first : first + 2]
