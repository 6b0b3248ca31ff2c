"""Directional derivatives of sums whose operators depend on a parameter.

The operator of a joint of a curved floating-frame beam contains the directions of the beam there.
"""

from __future__ import annotations

from collections.abc import Callable

from beamdae.analysis.sensitivities.model_differences import Difference
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.symbolic.sums.directional_sums import directional_plan
from beamdae.symbolic.sums.kernel_sums import SumPlan


def moves_operators(difference: Difference) -> bool:
    """Return True if operators of joints depend on the parameter."""
    return any(e.structure != difference.base.structure for e in difference.equations)


def directional_plan_along(
    difference: Difference,
    plan: Callable[[EquationsOfMotion], SumPlan],
    n_inputs: int,
    min_base: float = 0.0,
) -> SumPlan:
    """Return the plan of the derivative of a sum along a parameter that moves its operators.

    `plan` returns the plan of the sum of equations, with inputs of size `n_inputs`. For `min_base`,
    see `expand_powers`.
    """
    changes = (
        difference.derivative(lambda e: plan(e).gather_weights),
        difference.derivative(lambda e: plan(e).weights),
    )
    return directional_plan(plan(difference.base), n_inputs, changes, min_base)
