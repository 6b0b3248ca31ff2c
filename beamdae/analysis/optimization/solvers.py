"""Solvers of smooth problems with inequality constraints and bounds: SLSQP and IPOPT."""

from __future__ import annotations

import warnings
from collections.abc import Callable
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
    functions = _Functions(problem, [])
    x = ca.MX.sym("x", len(problem.begin))
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
    if functions.errors:
        raise functions.errors[0]
    return np.asarray(result["x"]).ravel()


class _Functions(ca.Callback):
    """Objective and margins for CasADi, or their derivatives.

    CasADi discards exceptions of its callbacks: the first one is kept in `errors`, and all further
    values are NaN, so that the solver ends.
    """

    def __init__(self, problem: SmoothProblem, errors: list[BaseException], name: str = "") -> None:
        super().__init__()
        self.problem, self.errors, self.is_jacobian = problem, errors, bool(name)
        self.jacobians: list[_Functions] = []  # CasADi does not keep them alive
        self.construct(name or "functions", {})

    def get_n_in(self) -> int:
        return 3 if self.is_jacobian else 1

    def get_n_out(self) -> int:
        return 2

    def get_sparsity_in(self, k: int) -> Any:
        return ca.Sparsity.dense((len(self.problem.begin), 1, self.problem.count)[k], 1)

    def get_sparsity_out(self, k: int) -> Any:
        columns = len(self.problem.begin) if self.is_jacobian else 1
        return ca.Sparsity.dense((1, self.problem.count)[k], columns)

    def has_jacobian(self) -> bool:
        return not self.is_jacobian

    def get_jacobian(self, name: str, *others: Any) -> Any:
        self.jacobians.append(_Functions(self.problem, self.errors, name))
        return self.jacobians[-1]

    def eval(self, arguments: Any) -> list[Any]:
        function = self.problem.gradients if self.is_jacobian else self.problem.values
        if not self.errors:
            try:
                first, others = function(np.asarray(arguments[0]).ravel())
                return [ca.DM(np.atleast_2d(first)), ca.DM(np.asarray(others))]
            except BaseException as error:
                self.errors.append(error)
        shapes = (self.get_sparsity_out(k).shape for k in range(2))
        return [ca.DM(np.full(shape, np.nan)) for shape in shapes]
