"""Gradients of the weighted residuals of steps, shared by the backward sweeps of all methods.

The functions of a workspace are plain Python over arrays; `native.loops` compiles them if possible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.native.loop_functions import combine
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
    numbers
        Derivatives with respect to p, summed over the steps, (n_p,).
    """

    transposed: Sum
    inputs: Array
    outputs: Array
    numbers: Array


def weigh_residual(of: WeightedResidual, t: float, branch: float, weights: Array) -> None:
    """Set `outputs` to the gradient at a time [s] and the motion in `inputs`."""
    motion = of.inputs.size - weights.size
    combine(of.inputs[motion:], (1.0,), (weights,))
    set_time(of.transposed, t, branch)
    evaluate_sum(of.transposed, of.inputs, of.outputs)


def add_numbers(of: WeightedResidual) -> None:
    """Add the derivatives with respect to p after `weigh_residual`."""
    motion = of.outputs.size - of.numbers.size
    combine(of.numbers, (1.0, 1.0), (of.numbers, of.outputs[motion:]))


def prepare_weights(
    equations: EquationsOfMotion, plan: Callable[[Structure], SumPlan], motion: int, size: int
) -> tuple[Callable[[bool], WeightedResidual], bool]:
    """Return the function of `native` that returns the work arrays of a residual.

    Also return True if machine code is available. `plan` is a function of a module that returns the
    plan of the residual; `motion` and `size` are the sizes of its inputs x and of the residual.
    """
    p = equations.p
    transposed = _plan_transpose(equations.structure, plan, motion)

    def make(native: bool) -> WeightedResidual:
        return WeightedResidual(
            transposed.sum(native, p),
            np.zeros(motion + size),
            np.zeros(motion + len(p)),
            np.zeros(len(p)),
        )

    return make, transposed.is_native


@cache_on_owner
def _plan_transpose(
    structure: Structure, plan: Callable[[Structure], SumPlan], motion: int
) -> SumPlan:
    return transposed_plan(plan(structure), motion)
