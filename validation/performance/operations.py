"""Times of the operations of integrators: residuals, matrices, factorizations and solutions.

`time_step_operations` returns those of generalized-alpha, `time_first_order_operations` those of
Ida and, with real and complex matrices, of Radau. Each timer calls one operation of the core.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

import numpy as np
from linear_system import LinearSystem

import beamdae as bd
from beamdae.core.return_codes import NEW_PIVOTS
from beamdae.core.tables import Loop, Workspace
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.formulations.step_equations import StepPrediction, formulate_step
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_time

Array = np.ndarray
OperationTimers = dict[str, Callable[[], float]]

# Time and branch at which operations are evaluated.
TIME_AND_BRANCH = np.array([0.1, 0.5])
OPERATIONS = ("residual", "matrix", "factorize", "solve")


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

    inputs = np.concatenate([*start, start.q, np.zeros(equations.m)])
    sums = zip(OPERATIONS, form.sums[::2], (form.size, form.pattern.nnz), strict=False)
    return _make_timers(equations, sums, inputs, matrix, right, repeats)


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

    sizes = (form.size, form.pattern.nnz)
    sums = () if isinstance(rate, complex) else zip(OPERATIONS, form.sums, sizes, strict=False)
    return _make_timers(equations, sums, np.concatenate([y, yp]), matrix, right, repeats)


def _make_timers(
    equations: bd.results.EquationsOfMotion,
    sums: Iterable[tuple[str, SumPlan, int]],
    inputs: Array,
    matrix: FactorizedMatrix,
    right: Array,
    repeats: int,
) -> OperationTimers:
    calls = {}
    for name, plan, size in sums:
        total = plan.sum(True, equations.p)
        set_time(total, *TIME_AND_BRANCH)
        run = Workspace("Evaluation", total=total, x=inputs, result=np.zeros(size))
        calls[name] = Loop("run_evaluation", run).call_loaded
    linear = matrix.make_solver()
    system = LinearSystem(linear, matrix.nonzeros, right)
    while system.factorize() == NEW_PIVOTS:
        matrix.renew_pivots(linear)
    for name in OPERATIONS[2:]:
        calls[name] = LinearSystem(linear, matrix.nonzeros, right).bind(name)

    def make_timer(call: Callable[[], int]) -> Callable[[], float]:
        def time_of_one() -> float:
            begin = time.process_time()
            for _ in range(repeats):
                call()
            return (time.process_time() - begin) / repeats

        return time_of_one

    return {name: make_timer(call) for name, call in calls.items()}
