"""Smooth problems with inequality constraints and bounds, and their solution by SLSQP."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, minimize

Array = np.ndarray


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


def solve(problem: SmoothProblem, tolerance: float, iterations: int) -> None:
    """Evaluate a problem until the solver ends, whether it converged or not."""
    constraint = {
        "type": "ineq",
        "fun": lambda x: problem.values(x)[1],
        "jac": lambda x: problem.gradients(x)[1],
    }
    with warnings.catch_warnings():
        # SciPy warns if rounding moves a variable out of its bounds.
        warnings.simplefilter("ignore", RuntimeWarning)
        minimize(
            lambda x: problem.values(x)[0],
            problem.begin,
            jac=lambda x: problem.gradients(x)[0],
            method="SLSQP",
            bounds=Bounds(problem.lower, problem.upper),
            constraints=constraint if problem.count else (),
            options={"maxiter": iterations, "ftol": tolerance},
        )
