"""Gradients of the weighted residuals of steps, shared by the backward sweeps of all methods.

The functions of a workspace are plain Python over arrays; `native.loops` compiles them if possible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.native.loop_functions import combine, inner_product
from beamdae.symbolic.sums.kernel_sums import Sum, SumPlan, evaluate_sum, set_time
from beamdae.symbolic.sums.transposed_sums import transposed_plan

Array = np.ndarray


@dataclass(slots=True)
class WeightedResidual:
    """Gradient of weights . residual with respect to the motion x and the numbers p.

    Attributes
    ----------
    transposed, inputs, outputs
        Sum of the gradient, its inputs (x, weights), and its result: the derivatives with respect
        to x and p.
    change, change_inputs, change_residual, moves_operators
        Derivative of the residual along a change of the operators of joints, its inputs (x, zeros)
        and its result; used if `moves_operators` is 1.
    numbers, along_operators
        Derivatives with respect to p, (n_p,), and along the change of the operators, summed over
        the steps.
    """

    transposed: Sum
    inputs: Array
    outputs: Array
    change: Sum
    change_inputs: Array
    change_residual: Array
    moves_operators: int
    numbers: Array
    along_operators: float = 0.0


def weigh_residual(of: WeightedResidual, t: float, branch: float, weights: Array) -> None:
    """Set `outputs` to the gradient at a time [s] and the motion in `inputs`."""
    motion = of.inputs.size - weights.size
    combine(of.inputs[motion:], (1.0,), (weights,))
    set_time(of.transposed, t, branch)
    evaluate_sum(of.transposed, of.inputs, of.outputs)


def add_numbers(of: WeightedResidual, t: float, branch: float, weights: Array) -> None:
    """Add the derivatives with respect to p, and along operators, after `weigh_residual`."""
    motion = of.inputs.size - weights.size
    combine(of.numbers, (1.0, 1.0), (of.numbers, of.outputs[motion:]))
    if of.moves_operators == 1:
        combine(of.change_inputs[:motion], (1.0,), (of.inputs[:motion],))
        set_time(of.change, t, branch)
        evaluate_sum(of.change, of.change_inputs, of.change_residual)
        of.along_operators += inner_product(weights, of.change_residual)


def prepare_weights(
    start: StartDerivatives, plan: Callable[[Structure], SumPlan], motion: int, size: int
) -> tuple[Callable[[bool], WeightedResidual], bool]:
    """Return the function of `native` that returns the work arrays of a residual.

    Also return True if machine code is available.

    Parameters
    ----------
    start
        Maps of the equations.
    plan, motion, size
        Function of a module that returns the plan of the residual, the size of its inputs x, and
        its size.
    """
    p = start.equations.p
    transposed = _plan_transpose(start.equations.structure, plan, motion)
    change = None if start.moving is None else start.directional_plan(plan, motion)

    def make(native: bool) -> WeightedResidual:
        return WeightedResidual(
            transposed=transposed.sum(native, p),
            inputs=np.zeros(motion + size),
            outputs=np.zeros(motion + len(p)),
            change=(change or transposed).sum(native, p),
            change_inputs=np.zeros(2 * motion + len(p)),
            change_residual=np.zeros(size),
            moves_operators=int(change is not None),
            numbers=np.zeros(len(p)),
        )

    return make, transposed.is_native and (change is None or change.is_native)


@cache_on_owner
def _plan_transpose(
    structure: Structure, plan: Callable[[Structure], SumPlan], motion: int
) -> SumPlan:
    return transposed_plan(plan(structure), motion)
