"""Backward sweep over the steps of a generalized-alpha run: the transpose of `alpha_replay`.

The loop is plain Python over arrays; `native.loops` compiles it if possible.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.gradients.weighted_residuals import (
    WeightedResidual,
    add_numbers,
    prepare_weights,
    weigh_residual,
)
from beamdae.analysis.sensitivities.alpha_replay import plan_step_residual
from beamdae.analysis.sensitivities.alpha_steps import (
    AlphaSteps,
    copy_state,
    factorize_ahead,
    group_equal_steps,
    prepare_steps,
    step_length,
)
from beamdae.analysis.sensitivities.model_differences import derivative_call
from beamdae.analysis.sensitivities.recorded_maps import Gradient
from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.step_equations import formulate_step, plan_step_sums
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.errors import BeamdaeError
from beamdae.integrators.alpha.family import (
    AlphaStart,
    family_parameters,
)
from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.native.loop_functions import combine, solve
from beamdae.native.return_codes import DONE
from beamdae.results.trajectory import Interval
from beamdae.symbolic.sparse_operators import transpose_pattern
from beamdae.symbolic.sums.kernel_sums import SumPlan

Array = np.ndarray


@dataclass(slots=True, kw_only=True)
class AdjointWorkspace(AlphaSteps):
    """Work arrays of `sweep_backwards`.

    Attributes
    ----------
    form, lanes, linear, nonzeros
        As in `AlphaSteps`, for the transposed matrix.
    residual
        Gradient of the weighted residual.
    seeds, seeded, seed
        Derivatives of the objective with respect to (q, v, lam) after the steps, (steps, k), for
        the k entries `seeded` that the objective depends on, and work array for all entries of one
        step, (2n + m,).
    q, v, ddq, a
        Derivatives of the objective with respect to the motion at the end of the current step, as
        far as it acts through later steps, (n,) each. `a` is the algorithmic acceleration.
    first
        Number of steps before the steps of equal length that are transposed together.
    step
        Number of steps that remain.
    """

    residual: WeightedResidual
    seeds: Array
    seeded: Array
    seed: Array
    q: Array
    v: Array
    ddq: Array
    a: Array
    first: int = 0
    step: int


def sweep_backwards(run: AdjointWorkspace) -> int:
    """Transpose steps of equal length, the last one first; return DONE, NEW_PIVOTS or SINGULAR.

    Each step solves a linear system with the transposed iteration matrix at the end of the step.
    The solution weights the residual, whose gradient contributes to the derivatives with respect to
    p and to the motion before the step.
    """
    n, m, h, beta, gamma = run.form.n, run.form.m, run.h, run.beta, run.gamma
    c = run.coefficients
    inputs, outputs, change, seed = run.residual.inputs, run.residual.outputs, run.change, run.seed
    q, v, ddq, a, a_predicted = run.q, run.v, run.ddq, run.a, run.a_predicted
    factor = 1.0 / (1.0 - run.alpha_m)
    while run.step > run.first:
        code = factorize_ahead(run, run.step, -1, run.step - run.first)
        if code != DONE:
            return code
        t, at = run.times[run.step], run.seeded
        copy_state(run, run.step, inputs[: 3 * n + m])
        for j in range(at.size):
            seed[at[j]] = run.seeds[run.step - 1, j]
        combine(q, (1.0, 1.0), (q, seed[:n]))
        combine(v, (1.0, 1.0), (v, seed[n : 2 * n]))
        combine(change[:n], (-1.0, -c[0], -c[1], -1.0 / c[2]), (q, v, ddq, a))
        combine(change[n:], (-1.0 / c[2],), (seed[2 * n :],))
        solve(run.linear, change)
        combine(change[:n], (c[2],), (change[:n],))
        for i in run.form.velocity_rows:
            change[i] /= c[0]
        weigh_residual(run.residual, t, run.branch, change)
        combine(q, (1.0, 1.0), (q, outputs[:n]))
        combine(v, (1.0, 1.0), (v, outputs[n : 2 * n]))
        add_numbers(run.residual)
        # From the predicted motion to the motion before the step.
        combine(a_predicted, (1.0, h * h * beta, h * gamma), (a, q, v))
        rate = factor * run.alpha_m
        combine(a, (h * h * (0.5 - beta), h * (1.0 - gamma), -rate), (q, v, a_predicted))
        combine(ddq, (factor * run.alpha_f,), (a_predicted,))
        combine(v, (1.0, h), (v, q))
        run.step -= 1
    return DONE


@cache_on_owner
def _plan_transposed_matrix(structure: Structure) -> tuple[SumPlan, sp.csc_array]:
    """Return the sum and the pattern of the transposed matrix."""
    pattern, (*_, matrix) = plan_step_sums(structure, False)
    pattern, positions = transpose_pattern(pattern)
    plan = replace(
        matrix,
        add_targets=positions[matrix.add_targets],
        weighted_targets=positions[matrix.weighted_targets],
    )
    return plan, pattern


def transpose_alpha_steps(
    method: GeneralizedAlpha,
    start: StartDerivatives,
    interval: Interval,
    seeds: Array,
    matrices: dict[int, FactorizedMatrix],
) -> Gradient:
    """Return the gradient of an objective with respect to the state at the start of an interval.

    Parameters
    ----------
    method
        Settings of the run, in the index-3 form.
    start
        Maps to the starting values and to the jerk, which corrects velocities where the length of
        the step changes.
    interval
        States of the run.
    seeds
        Derivatives of the objective with respect to (q, v, lam) after the steps, (steps, 2n + m).
    matrices
        Matrices of later intervals of the run by id of their pattern, whose pivots are tried first;
        the matrix of this interval is added.

    Raises
    ------
    BeamdaeError
        If the iteration matrix is singular at a step.
    """
    equations, times, states = start.equations, interval.t, interval.state
    n, m, steps = equations.n, equations.m, len(times) - 1
    member = family_parameters(method.family, method.rho_inf)
    form = formulate_step(equations, False)
    plan, pattern = _plan_transposed_matrix(equations.structure)
    make_residual, is_native = prepare_weights(equations, plan_step_residual, 4 * n + 2 * m, n + m)
    matrix = FactorizedMatrix.from_pattern(pattern, pivot_source=matrices.get(id(pattern)))
    matrices[id(pattern)] = matrix
    seeded = np.flatnonzero(seeds.any(axis=0))
    make_fields = prepare_steps(form, plan, matrix, member, interval)

    def make_workspace(native: bool) -> AdjointWorkspace:
        q, v, ddq, a = np.zeros((4, n))
        return AdjointWorkspace(
            **make_fields(native),
            residual=make_residual(native),
            seeds=np.ascontiguousarray(seeds[:, seeded]),
            seeded=seeded,
            seed=np.zeros(2 * n + m),
            q=q,
            v=v,
            ddq=ddq,
            a=a,
            step=steps,
        )

    def factorized(run: AdjointWorkspace) -> list[tuple[Any, FactorizedMatrix]]:
        return [(run.linear, matrix)]

    loop = StepLoop(sweep_backwards, make_workspace, factorized, form.is_native and is_native)
    run = loop.work
    groups, parts = list(pairwise(group_equal_steps(times))), []
    for first, last in reversed(groups):
        h = step_length(times, first, last)
        if last < steps:
            at, ratio = State(*(x[last] for x in states)), run.h / h
            square = (run.h * run.h - h * h) * member.defect
            jerk = start.jerk_map(np.array([times[last], run.branch]), at, run.h)
            part = jerk.transposed(square * run.v)
            by_q, by_v, by_a = part.inputs
            run.q += by_q
            run.v += by_v
            run.ddq += by_a + (1.0 - ratio) * run.a
            run.a *= ratio
            parts.append(part)
        run.coefficients[:] = member.coefficients(h)
        run.h, run.first, run.staged, run.lane = h, int(first), 0, 0
        if loop() != DONE:
            raise BeamdaeError(
                f"{derivative_call()}: the iteration matrix is singular at t = {times[run.step]:g} "
                "s; use a smaller step, or check the model."
            )
    # Runs may have thousands of intervals, whose matrices must not all be kept.
    matrix.pivot_source = None
    alpha_start = AlphaStart(member, start.solver, True, method.start == "cured")
    time, at = np.array([times[0], interval.branch]), State(*(x[0] for x in states))
    motion = start.initial_motion(alpha_start, time, at, run.h)
    by_start = motion.transposed(run.q, run.v, run.ddq, run.a)
    numbers = run.residual.numbers + sum(x.numbers for x in (*parts, by_start))
    return Gradient(by_start.inputs, numbers)
