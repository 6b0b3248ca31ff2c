"""Derivatives of the energies of a run with respect to parameters."""

from __future__ import annotations

import numpy as np

from beamdae.analysis.sensitivities.model_differences import Difference
from beamdae.analysis.sensitivities.operator_changes import directional_plan_along, moves_operators
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.sums import N_BALANCE_SCALARS
from beamdae.equations.measures import ENERGIES, plan_balance
from beamdae.symbolic.directional_sums import directional_plan
from beamdae.symbolic.kernel_sums import SumPlan, evaluate_sum, set_time

Array = np.ndarray


def differentiate_energies(difference: Difference, times: Array, at: State, along: State) -> Array:
    """Return the derivatives of the kinetic, strain and gravitational energies [J], (rows, 3).

    Parameters
    ----------
    difference
        Models at neighboring values of the parameter.
    times
        Rows of (t, branch).
    at, along
        States of the run and their derivatives, one row per time.
    """
    e = difference.base

    def balance(equations: EquationsOfMotion) -> SumPlan:
        return plan_balance(equations.structure).total

    size = 3 * e.n + e.m
    plan = (
        directional_plan_along(difference, balance, size)
        if moves_operators(difference)
        else directional_plan(balance(e), size)
    )
    total, dp = plan.sum(False, e.p), difference.derivative(lambda x: x.p)
    value = np.zeros(N_BALANCE_SCALARS + size + e.m)
    energies = np.zeros((len(times), len(ENERGIES)))
    for k, inputs in enumerate(np.hstack([*at, *along])):
        set_time(total, *times[k])
        evaluate_sum(total, np.concatenate([inputs, dp]), value)
        energies[k] = value[: len(ENERGIES)]
    return energies
