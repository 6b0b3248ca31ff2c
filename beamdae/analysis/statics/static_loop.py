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

from beamdae.analysis.statics.pivot_signs import SaddlePoint, count_signs, scale_by_reference
from beamdae.native.loop_functions import add, combine, factorize, multiply, pick, solve
from beamdae.native.return_codes import DONE
from beamdae.symbolic.sums.kernel_sums import Sum, evaluate_sum

Array = np.ndarray

# Tasks of `perform_task`.
EVALUATE_FORCES = 0
EVALUATE_TANGENT = 1
COUNT_SIGNS = 2
SOLVE = 3
SOLVE_AGAIN = 4
SET_SIZES = 5
CORRECT = 6


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
        Non-zeros of the bordered matrix, in natural sizes, and products of the sizes of their rows
        and columns.
    sizes
        Natural sizes of the unknowns, then 1, (n + m + 1,).
    inputs
        (q, 0, lam), with the zeros of velocities and accelerations.
    forces, by_factor
        F and F_mu, (n + m,).
    row, row_targets, counting
        Last row, (n + m + 1,): nonzeros[row_targets] = row; and 0, 1, 2, ...
    column, column_start
        Last column, (n + m,), and its start in `nonzeros`.
    right
        Right-hand side, (n + m + 1,), and then the solution.
    compliance, compliance_rate
        Diagonal C of g - C lam = 0, (m,), and its derivative by `mu`.
    added_targets, added
        Constants of the tangent: nonzeros[added_targets] += added. They are springs that hold
        coordinates in the tangent alone, and the compliances.
    deviation
        Value of the control minus its target.
    mu, center, scale
        Load factor; that of the parts U and L is (mu - center) * scale.
    task
        `EVALUATE_FORCES`; `EVALUATE_TANGENT` to evaluate also the tangent; `COUNT_SIGNS` to count
        also its negative pivots; `SOLVE` to solve with the given border and right-hand side;
        `SOLVE_AGAIN` to do so with the last factors; `SET_SIZES` to set natural sizes;
        `CORRECT` to find the correction of Newton's method for `row` and `deviation`.
    has_forces, has_tangent
        1 if forces and tangent have been evaluated at `inputs` and `mu`, else 0.
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
    column: Array
    right: Array
    compliance: Array
    compliance_rate: Array
    added_targets: Array
    added: Array
    column_start: int
    deviation: float = 0.0
    mu: float = 0.0
    center: float = 0.0
    scale: float = 1.0
    task: int = EVALUATE_FORCES
    has_forces: int = 0
    has_tangent: int = 0


def perform_task(run: StaticWorkspace) -> int:
    """Perform the task; return DONE or the code of the linear solver."""
    if run.task == SOLVE_AGAIN:
        _solve(run)
        return DONE
    _evaluate_forces(run)
    if run.task == EVALUATE_FORCES:
        return DONE
    _evaluate_tangent(run)
    if run.task == COUNT_SIGNS:
        count_signs(run.saddle, run.nonzeros)
    if run.task == SET_SIZES:
        scale_by_reference(run.saddle, run.nonzeros)
    if run.task != SOLVE and run.task != CORRECT:
        return DONE
    if run.task == CORRECT:
        combine(run.column, (1.0,), (run.by_factor,))
        combine(run.right[: run.forces.size], (-1.0,), (run.forces,))
        run.right[run.forces.size] = -run.deviation
    size, first = run.forces.size, run.column_start
    pick(run.nonzeros, run.row_targets, run.row, run.counting, 0, size + 1)
    combine(run.nonzeros[first : first + size], (1.0,), (run.column,))
    multiply(run.scaled, run.nonzeros, run.products)
    code = factorize(run.linear, run.scaled)
    if code == DONE:
        _solve(run)
    return code


def _solve(run: StaticWorkspace) -> None:
    multiply(run.right, run.right, run.sizes)
    solve(run.linear, run.right)
    multiply(run.right, run.right, run.sizes)


def _evaluate_forces(run: StaticWorkspace) -> None:
    if run.has_forces == 1:
        return
    common, unloaded, loaded, size = run.common, run.unloaded, run.loaded, run.forces.size
    evaluate_sum(common.residual, run.inputs, common.forces)
    evaluate_sum(unloaded.residual, run.inputs, unloaded.forces)
    evaluate_sum(loaded.residual, run.inputs, loaded.forces)
    # Increments, so that entries without loads are independent of mu to the last digit.
    combine(run.by_factor, (run.scale, -run.scale), (loaded.forces, unloaded.forces))
    m = run.compliance.size
    multipliers, rates = run.inputs[run.inputs.size - m :], run.by_factor[size - m :]
    for k in range(m):
        rates[k] -= run.compliance_rate[k] * multipliers[k]
    change = run.mu - run.center
    combine(run.forces, (1.0, 1.0, change), (common.forces, unloaded.forces, run.by_factor))
    constraints = run.forces[size - m :]
    for k in range(m):
        constraints[k] -= run.compliance[k] * multipliers[k]
    run.has_forces, run.has_tangent = 1, 0


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
    run.has_tangent = 1
