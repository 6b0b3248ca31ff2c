"""Times of the operations of integrators: residuals, matrices, factorizations and solutions.

`time_step_operations` returns those of generalized-alpha, `time_first_order_operations` those of
Ida and, with real and complex matrices, of Radau. Each timer runs a compiled loop over one
operation.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from beamdae.native.loop_functions import combine, factorize, solve
from beamdae.native.return_codes import DONE

import beamdae as bd
from beamdae.equations.formulations.first_order import (
    FirstOrderBuffers,
    evaluate_jacobian,
    evaluate_residual,
    formulate_first_order,
)
from beamdae.equations.formulations.step_equations import (
    StepBuffers,
    StepPrediction,
    evaluate_step_matrix,
    evaluate_step_residual,
    formulate_step,
)
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop

Array = np.ndarray
OperationTimers = dict[str, Callable[[], float]]

# Time and branch at which operations are evaluated.
TIME_AND_BRANCH = np.array([0.1, 0.5])
OPERATIONS = ("residual", "matrix", "factorize", "solve")


@dataclass(slots=True)
class StepWork:
    """Equations of a step at a prediction, and their buffers."""

    form: StepBuffers
    linear: Any
    at: StepPrediction
    x: Array
    right: Array
    change: Array
    nonzeros: Array
    repeats: int


@dataclass(slots=True)
class FirstOrderWork:
    """First-order equations at a state, and their buffers."""

    form: FirstOrderBuffers
    linear: Any
    y: Array
    yp: Array
    rate: float
    right: Array
    change: Array
    nonzeros: Array
    repeats: int


def step_residuals(work: StepWork) -> int:
    for _ in range(work.repeats):
        evaluate_step_residual(work.form, 0.1, 0.5, work.at, work.x, work.change)
    return DONE


def step_matrices(work: StepWork) -> int:
    for _ in range(work.repeats):
        evaluate_step_matrix(work.form, 0.1, 0.5, work.at, work.x, work.nonzeros)
    return DONE


def first_order_residuals(work: FirstOrderWork) -> int:
    for _ in range(work.repeats):
        evaluate_residual(work.form, 0.1, 0.5, work.y, work.yp, work.change)
    return DONE


def first_order_jacobians(work: FirstOrderWork) -> int:
    for _ in range(work.repeats):
        evaluate_jacobian(work.form, 0.1, 0.5, work.rate, work.y, work.yp, work.nonzeros)
    return DONE


def factorizations(work: Any) -> int:
    for _ in range(work.repeats):
        code = factorize(work.linear, work.nonzeros)
        if code != DONE:
            return code
    return DONE


def solutions(work: Any) -> int:
    for _ in range(work.repeats):
        combine(work.change, (1.0,), (work.right,))
        solve(work.linear, work.change)
    return DONE


def time_step_operations(
    equations: bd.results.EquationsOfMotion, step: float, repeats: int
) -> OperationTimers:
    """Return timers of generalized-alpha on index 3: each returns the time of one call [s]."""
    form, member = formulate_step(equations, False), bd.GeneralizedAlpha(step)
    start = ConsistencySolver(equations).state(TIME_AND_BRANCH, equations.q0, equations.v0)
    c_f = step**2 * member.beta
    share = (1.0 - member.alpha_f) / (1.0 - member.alpha_m)
    coefficients = np.array([member.gamma / (step * member.beta), 1.0 / (c_f * share), c_f])
    at = StepPrediction(start.q, start.v, start.a, start.q.copy(), coefficients)
    x = np.concatenate([np.zeros(equations.n), c_f * start.lam])
    matrix = FactorizedMatrix.from_pattern(form.pattern)
    matrix.nonzeros[:] = form.jacobian(TIME_AND_BRANCH, at, x)
    right = np.full(form.size, 1e-3)

    def make(native: bool) -> StepWork:
        linear = matrix.make_solver(native, "auto")
        return StepWork(
            form.buffers(native), linear, at, x, right, right.copy(), matrix.nonzeros, repeats
        )

    functions = (step_residuals, step_matrices, factorizations, solutions)
    return _make_timers(make, functions, matrix, repeats)


def time_first_order_operations(
    equations: bd.results.EquationsOfMotion, rate: complex, repeats: int
) -> OperationTimers:
    """Return timers of Ida or, with a complex rate, of Radau's pair of linear systems."""
    form = formulate_first_order(equations, "stabilized-index1")
    y, yp = form.pack(
        ConsistencySolver(equations).state(TIME_AND_BRANCH, equations.q0, equations.v0)
    )
    matrix = FactorizedMatrix.from_pattern(form.pattern, type(rate))
    # dR/dy + rate dR/dy'; the Jacobian function takes real rates only.
    at_zero, at_one = (form.jacobian(TIME_AND_BRANCH, y, yp, c) for c in (0.0, 1.0))
    matrix.nonzeros[:] = at_zero + rate * (at_one - at_zero)
    right = np.full(form.size, 1e-3, type(rate))

    def make(native: bool) -> FirstOrderWork:
        return FirstOrderWork(
            form.buffers(native),
            matrix.make_solver(native, "auto"),
            y,
            yp,
            rate.real,
            right,
            right.copy(),
            matrix.nonzeros,
            repeats,
        )

    if isinstance(rate, complex):
        return _make_timers(make, (None, None, factorizations, solutions), matrix, repeats)
    functions = (first_order_residuals, first_order_jacobians, factorizations, solutions)
    return _make_timers(make, functions, matrix, repeats)


def _make_timers(
    make: Callable[[bool], Any],
    functions: tuple[Callable[[Any], int] | None, ...],
    matrix: FactorizedMatrix,
    repeats: int,
) -> OperationTimers:
    def list_linear_systems(work: Any) -> list[tuple[Any, FactorizedMatrix]]:
        return [(work.linear, matrix)]

    work = make(True)
    timers = {}
    # Solutions need the factors, so the factorization comes first.
    order = sorted(zip(OPERATIONS, functions, strict=True), key=lambda x: x[0] != "factorize")
    for name, function in order:
        if function is None:
            continue
        running = StepLoop(function, lambda native: work, list_linear_systems, True)
        assert running.is_native, name
        assert running() == DONE, name

        def time_of_one(running: StepLoop = running) -> float:
            begin = time.process_time()
            running()
            return (time.process_time() - begin) / repeats

        timers[name] = time_of_one
    return timers
