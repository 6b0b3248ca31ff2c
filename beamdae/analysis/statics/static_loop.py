"""Static equations with a load factor and one control equation, in machine code if available.

    [[F_x, column], [row, corner]] solution = right

with F(x; mu) = C + U + mu (L - U): C are the forces and joints that the load factor does not
change, U and L those that are particular to the unloaded and to the loaded mechanism. The loop is
plain Python over arrays; `native.loops` compiles it if possible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.continuation.newton import CORRECTED, Corrections, is_negligible, judge
from beamdae.analysis.statics.pivot_signs import SaddlePoint, count_signs
from beamdae.native.loop_functions import (
    add,
    combine,
    factorize,
    fill,
    inner_product,
    max_norm,
    multiply,
    pick,
    solve,
)
from beamdae.native.return_codes import DONE
from beamdae.symbolic.sums.kernel_sums import Sum, evaluate_sum

Array = np.ndarray

# Tasks of `perform_task`.
EVALUATE_FORCES = 0
EVALUATE_TANGENT = 1
COUNT_SIGNS = 2
CORRECT = 3


@dataclass(slots=True)
class LoadPart:
    """One of the parts C, U and L of the static equations.

    Attributes
    ----------
    residual, tangent
        Sums of kernels; `tangent` evaluates non-zeros of the bordered matrix.
    forces, nonzeros
        Their last values.
    """

    residual: Sum
    tangent: Sum
    forces: Array
    nonzeros: Array


@dataclass(slots=True)
class StaticWorkspace:
    """Work arrays of `perform_task`.

    Attributes
    ----------
    common, unloaded, loaded
        Parts C, U and L.
    linear
        Linear solver of the bordered matrix.
    saddle
        Symmetric elimination of the tangent.
    nonzeros, scaled, products
        Non-zeros of the bordered matrix and a 1; in natural sizes; products of the sizes of their
        rows and columns.
    sizes
        Natural sizes of the unknowns, then 1, (n + m + 1,).
    inputs
        (q, 0, lam), with the zeros of velocities and accelerations.
    forces, by_factor
        F and F_mu, (n + m,).
    row, row_targets, counting
        Last row, (n + m + 1,): nonzeros[row_targets] = row; and 0, 1, 2, ...
    column_start
        Start of the last column, F_mu, in `nonzeros`.
    right
        Right-hand side, (n + m + 1,), and then the solution; after `CORRECT`, derivatives by the
        control.
    joint_count
        Number of multipliers of joints, g = 0; the others are compliant, g - lam = 0.
    remainder
        Multiples of g that the forces add to lam, (m,).
    added_targets, added
        Constants of the tangent: nonzeros[added_targets] += added. They are springs that hold
        coordinates in the tangent alone, and the compliances -1.
    weights
        Inverse natural sizes by which corrections are measured, (n + m,).
    corrections
        Corrections of `CORRECT`.
    deviation
        Value of the control minus its target.
    mu, center, scale
        Load factor; that of the parts U and L is (mu - center) * scale.
    task
        `EVALUATE_FORCES`; `EVALUATE_TANGENT` to evaluate also the tangent; `COUNT_SIGNS` to count
        also its negative pivots; `CORRECT` to correct the point by Newton's method until it is a
        solution or, if the control is not linear, once.
    is_linear
        1 if derivatives of the control are the same everywhere, else 0.
    has_forces, has_tangent
        1 if forces and tangent have been evaluated at `inputs` and `mu`, else 0.
    has_factors
        1 if the last factors are those of the tangent at the last point where it was evaluated and
        `row`, with F_mu as column, else 0.
    """

    common: LoadPart
    unloaded: LoadPart
    loaded: LoadPart
    linear: Any
    saddle: SaddlePoint
    nonzeros: Array
    scaled: Array
    products: Array
    sizes: Array
    inputs: Array
    forces: Array
    by_factor: Array
    row: Array
    row_targets: Array
    counting: Array
    right: Array
    remainder: Array
    added_targets: Array
    added: Array
    weights: Array
    corrections: Corrections
    column_start: int
    joint_count: int
    deviation: float = 0.0
    mu: float = 0.0
    center: float = 0.0
    scale: float = 1.0
    task: int = EVALUATE_FORCES
    is_linear: int = 1
    has_forces: int = 0
    has_tangent: int = 0
    has_factors: int = 0


def perform_task(run: StaticWorkspace) -> int:
    """Perform the task; return DONE, a code of `judge` or the code of the linear solver."""
    task = run.task
    if task == CORRECT:
        return _correct(run)
    if task == EVALUATE_FORCES:
        _evaluate_forces(run)
    else:
        _evaluate_tangent(run)
    if task == COUNT_SIGNS:
        count_signs(run.saddle, run.nonzeros)
    return DONE


def forget_point(run: StaticWorkspace) -> None:
    """Mark all values as those of another point."""
    run.has_forces = run.has_tangent = run.has_factors = 0


def _correct(run: StaticWorkspace) -> int:
    """Correct a point by the law of `Problem.correct`, once if the control is not linear.

    Return a code of `judge`. Derivatives by the control are those before the last correction.
    """
    size = run.forces.size
    n, code = run.inputs.size - size, CORRECTED
    while code == CORRECTED:
        if run.has_forces == 0:
            _evaluate_forces(run)
            _determine_resultants(run)
        _evaluate_tangent(run)
        combine(run.right[:size], (-1.0,), (run.forces,))
        run.right[size] = -run.deviation
        solver_code = _solve_newton(run)
        if solver_code != DONE:
            return solver_code
        change, q = max_norm(run.right[:size], run.weights), run.inputs[:n]
        last = run.corrections.last
        code = judge(run.corrections, change, is_negligible(change, last))
        share, lam = run.corrections.share, run.inputs[2 * n :]
        combine(q, (1.0, share), (q, run.right[:n]))
        combine(lam, (1.0, share), (lam, run.right[n:size]))
        run.mu += share * run.right[size]
        run.deviation += share * inner_product(run.row, run.right)
        run.has_forces = run.has_tangent = 0
        if run.is_linear == 0:
            break
    fill(run.right[:size], 0.0)
    run.right[size] = 1.0
    _solve_newton(run)
    return code


def _determine_resultants(run: StaticWorkspace) -> None:
    """Let axial and shear forces depend on the multipliers alone, until the strains follow them.

    Strains of other points are much larger than those of equilibria.
    """
    m = run.remainder.size
    multipliers, constraints = run.inputs[run.inputs.size - m :], run.forces[run.forces.size - m :]
    for k in range(m):
        multipliers[k] -= run.remainder[k] * constraints[k]
    forget_point(run)
    _evaluate_forces(run)


def _solve_newton(run: StaticWorkspace) -> int:
    """Solve with F_mu and `row` as border; return DONE or the code of the linear solver."""
    size, first = run.forces.size, run.column_start
    if run.has_factors == 0:
        pick(run.nonzeros, run.row_targets, run.row, run.counting, 0, size + 1)
        combine(run.nonzeros[first : first + size], (1.0,), (run.by_factor,))
        multiply(run.scaled, run.nonzeros[: run.scaled.size], run.products)
        code = factorize(run.linear, run.scaled)
        if code != DONE:
            return code
        run.has_factors = 1
    multiply(run.right, run.right, run.sizes)
    solve(run.linear, run.right)
    multiply(run.right, run.right, run.sizes)
    return DONE


def _evaluate_forces(run: StaticWorkspace) -> None:
    if run.has_forces == 1:
        return
    common, unloaded, loaded, size = run.common, run.unloaded, run.loaded, run.forces.size
    evaluate_sum(common.residual, run.inputs, common.forces)
    evaluate_sum(unloaded.residual, run.inputs, unloaded.forces)
    evaluate_sum(loaded.residual, run.inputs, loaded.forces)
    # Increments, so that entries without loads are independent of mu to the last digit.
    combine(run.by_factor, (run.scale, -run.scale), (loaded.forces, unloaded.forces))
    change = run.mu - run.center
    combine(run.forces, (1.0, 1.0, change), (common.forces, unloaded.forces, run.by_factor))
    n = run.inputs.size - size
    constraints = run.forces[n + run.joint_count :]
    combine(constraints, (1.0, -1.0), (constraints, run.inputs[2 * n + run.joint_count :]))
    run.has_forces = 1


def _evaluate_tangent(run: StaticWorkspace) -> None:
    if run.has_tangent == 1:
        return
    common, unloaded, loaded = run.common, run.unloaded, run.loaded
    evaluate_sum(common.tangent, run.inputs, common.nonzeros)
    evaluate_sum(unloaded.tangent, run.inputs, unloaded.nonzeros)
    evaluate_sum(loaded.tangent, run.inputs, loaded.nonzeros)
    mu = (run.mu - run.center) * run.scale
    parts = (common.nonzeros, unloaded.nonzeros, loaded.nonzeros)
    combine(run.nonzeros, (1.0, 1.0 - mu, mu), parts)
    add(run.nonzeros, run.added_targets, run.added, run.counting, 0, run.added.size)
    run.nonzeros[run.scaled.size] = 1.0
    run.has_tangent = 1
    run.has_factors = 0
