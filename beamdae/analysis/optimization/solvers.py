"""Solvers of smooth problems with inequality constraints and bounds: SLSQP and IPOPT."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from scipy.optimize import Bounds, minimize

Array = np.ndarray
Method = Literal["SLSQP", "IPOPT"]
METHODS = ("SLSQP", "IPOPT")

# Relative distances from bounds and limits to which IPOPT moves the first design.
_DISTANCES = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
_FIRST_DISTANCE = 1e-3


@dataclass(frozen=True)
class SmoothProblem:
    """Minimize f(x) with margins g(x) >= 0 and bounds.

    Attributes
    ----------
    values, gradients
        f and g (C,), and the derivatives of both, (k,) and (C, k), at x (k,). f is infinite where
        a function is not defined. Exceptions end a search.
    count
        Number C of margins.
    begin, lower, upper
        First variables and bounds (k,).
    """

    values: Callable[[Array], tuple[float, Array]]
    gradients: Callable[[Array], tuple[Array, Array]]
    count: int
    begin: Array
    lower: Array
    upper: Array


def relax_limits(problem: SmoothProblem) -> SmoothProblem:
    """Return the problem of the smallest violation of a limit, which is the last variable."""

    def values(x: Array) -> tuple[float, Array]:
        value, margins = problem.values(x[:-1])
        return float(x[-1]) if np.isfinite(value) else np.inf, margins + x[-1]

    def gradients(x: Array) -> tuple[Array, Array]:
        gradient, jacobian = problem.gradients(x[:-1])
        return np.append(0.0 * gradient, 1.0), np.insert(jacobian, len(gradient), 1.0, axis=1)

    points = problem.begin, problem.lower, problem.upper
    ends = np.max(-problem.values(problem.begin)[1]), 0.0, np.inf
    return SmoothProblem(values, gradients, problem.count, *map(np.append, points, ends))


def solve(problem: SmoothProblem, method: Method, tolerance: float, iterations: int) -> Array:
    """Return the variables (k,) at which a solver ends, whether it converged or not."""
    solver = {"SLSQP": _solve_by_slsqp, "IPOPT": _solve_by_ipopt}[method]
    return solver(problem, tolerance, iterations)


def _solve_by_slsqp(problem: SmoothProblem, tolerance: float, iterations: int) -> Array:
    constraint = {
        "type": "ineq",
        "fun": lambda x: problem.values(x)[1],
        "jac": lambda x: problem.gradients(x)[1],
    }
    with warnings.catch_warnings():
        # SciPy warns if rounding moves a variable out of its bounds.
        warnings.simplefilter("ignore", RuntimeWarning)
        result = minimize(
            lambda x: problem.values(x)[0],
            problem.begin,
            jac=lambda x: problem.gradients(x)[0],
            method="SLSQP",
            bounds=Bounds(problem.lower, problem.upper),
            constraints=constraint if problem.count else (),
            options={"maxiter": iterations, "ftol": tolerance},
        )
    return np.asarray(result.x)


def _solve_by_ipopt(problem: SmoothProblem, tolerance: float, iterations: int) -> Array:
    size, count, errors = len(problem.begin), problem.count, list[BaseException]()
    outputs = (1, 1), (count, 1)
    jacobian = _Function(problem.gradients, [size, 1, count], [(1, size), (count, size)], errors)
    functions = _Function(problem.values, [size], outputs, errors, jacobian)
    x = ca.MX.sym("x", size)
    objective, margins = functions(x)
    options: dict[str, Any] = {
        "ipopt.hessian_approximation": "limited-memory",
        "ipopt.tol": tolerance,
        "ipopt.max_iter": iterations,
        # The mean of both estimates of the curvature; the default takes up to five times as long.
        "ipopt.limited_memory_initialization": "scalar3",
        **{f"ipopt.{x}": _FIRST_DISTANCE for x in _DISTANCES},
        "ipopt.bound_relax_factor": 0.0,
        "ipopt.nlp_scaling_method": "none",
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": False,
        "show_eval_warnings": False,
    }
    statement: dict[str, Any] = {"x": x, "f": objective, "g": margins}
    solver = ca.nlpsol("search", "ipopt", statement, options)
    result = solver(x0=problem.begin, lbx=problem.lower, ubx=problem.upper, lbg=0.0, ubg=np.inf)
    if errors:
        raise errors[0]
    return np.asarray(result["x"]).ravel()


class _Function(ca.Callback):
    """Function of x with two results for CasADi, and the function of its derivatives.

    CasADi discards exceptions of its callbacks: the first one is kept in `errors`, and all further
    values are NaN, so that the solver ends.
    """

    def __init__(
        self,
        call: Callable[[Array], tuple[Any, Any]],
        inputs: Sequence[int],
        outputs: Sequence[tuple[int, int]],
        errors: list[BaseException],
        jacobian: _Function | None = None,
    ) -> None:
        super().__init__()
        self.call_, self.inputs, self.outputs, self.errors = call, inputs, outputs, errors
        self.jacobian_ = jacobian
        self.construct("functions" if jacobian else "derivatives", {})

    def get_n_in(self) -> int:
        return len(self.inputs)

    def get_n_out(self) -> int:
        return 2

    def get_sparsity_in(self, k: int) -> Any:
        return ca.Sparsity.dense(self.inputs[k], 1)

    def get_sparsity_out(self, k: int) -> Any:
        return ca.Sparsity.dense(*self.outputs[k])

    def has_jacobian(self) -> bool:
        return self.jacobian_ is not None

    def get_jacobian(self, *names: Any) -> Any:
        return self.jacobian_

    def eval(self, arguments: Any) -> list[Any]:
        if not self.errors:
            try:
                first, others = self.call_(np.asarray(arguments[0]).ravel())
                return [ca.DM(np.atleast_2d(first)), ca.DM(np.asarray(others))]
            except BaseException as error:
                self.errors.append(error)
        return [ca.DM(np.full(shape, np.nan)) for shape in self.outputs]
