"""Directions of parameters, grouped by the equations that are differentiated along them.

Forces may be missing in a model because they vanish at the value of a parameter, such as drag with
a coefficient of zero, and a parameter may move the operators of joints. Along these parameters,
other sums are differentiated than along the others. At the value of the parameter, all of them are
equal: the steps of all directions have the matrices of the run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from beamdae.analysis.sensitivities.model_differences import Difference, equations_key
from beamdae.analysis.sensitivities.operator_changes import moves_operators
from beamdae.analysis.sensitivities.recorded_maps import Record
from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.structure import Structure
from beamdae.symbolic.sums.directional_sums import direction_inputs, motion_plan
from beamdae.symbolic.sums.kernel_sums import Sum, SumPlan, evaluate_with_data, set_time

Array = np.ndarray

# The loops over steps evaluate the sums of two groups; further groups take further sweeps.
GROUPS_PER_SWEEP = 2


@dataclass(frozen=True)
class Directions:
    """Directions of parameters that the same equations serve.

    Attributes
    ----------
    maps
        Derivatives of the maps to consistent states of these equations.
    members
        Indices of the parameters, (k,).
    numbers
        Derivatives of the numbers p along them, (k, n_p).
    """

    maps: StartDerivatives
    members: Array
    numbers: Array

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations that are differentiated."""
        return self.maps.equations


def group_directions(differences: Sequence[Difference]) -> list[Directions]:
    """Group parameters by their equations; one that moves operators is a group."""
    groups: dict[Any, list[int]] = {}
    for k, x in enumerate(differences):
        key = k if moves_operators(x) else equations_key(x.base)
        groups.setdefault(key, []).append(k)
    return [
        Directions(
            derive_states(differences[members[0]]),
            np.array(members),
            np.array([differences[k].derivative(lambda e: e.p) for k in members]),
        )
        for members in groups.values()
    ]


def derive_states(difference: Difference) -> StartDerivatives:
    """Return the derivatives of consistent states along directions of the parameter."""
    moving = difference if moves_operators(difference) else None
    return StartDerivatives(ConsistencySolver(difference.base), moving)


def differentiate_map(
    groups: Sequence[Directions],
    changes: Sequence[Array],
    shifts: Array | None,
    record: Callable[..., Record],
    *arguments: Any,
) -> list[Array]:
    """Return the derivatives of the results of a map, one direction a row, group by group.

    Parameters
    ----------
    groups
        Directions.
    changes, shifts
        Derivatives of the inputs of the map, and of its time, (k,) [s].
    record, arguments
        Method of `StartDerivatives` that records the map, and its arguments.
    """
    ends = np.cumsum([0, *(len(x.members) for x in groups)]).tolist()
    parts = [
        record(group.maps, *arguments).along(
            [x[first:last] for x in changes],
            group.numbers,
            None if shifts is None else shifts[first:last],
        )
        for group, (first, last) in zip(groups, pairwise(ends), strict=True)
    ]
    return [np.concatenate(x) for x in zip(*parts, strict=True)]


@dataclass(slots=True)
class DirectionSums:
    """Directional derivatives of a sum along the directions of up to two groups.

    Attributes
    ----------
    first, first_data, second, second_data
        Sums of both groups, and their local inputs by direction, see `direction_inputs`.
    """

    first: Sum
    first_data: Array
    second: Sum
    second_data: Array


def evaluate_direction(
    sums: DirectionSums, k: int, t: float, branch: float, inputs: Array, result: Array
) -> None:
    """Write the derivative along direction `k`; the inputs are (x, dx)."""
    count = sums.first_data.shape[0]
    if k < count:
        set_time(sums.first, t, branch)
        evaluate_with_data(sums.first, sums.first_data[k], inputs, result)
    else:
        set_time(sums.second, t, branch)
        evaluate_with_data(sums.second, sums.second_data[k - count], inputs, result)


def prepare_directions(
    groups: Sequence[Directions], plan: Callable[[Structure], SumPlan], n_inputs: int
) -> tuple[Callable[[bool], DirectionSums], bool]:
    """Return the function of `native` that returns directional derivatives of a sum.

    Also return True if machine code is available.

    Parameters
    ----------
    groups
        At most two groups.
    plan, n_inputs
        Function of a module that returns the plan of the sum, and the size of its inputs.
    """
    pair = groups[0], groups[-1]
    numbers = groups[0].numbers, groups[-1].numbers[: None if len(groups) > 1 else 0]
    plans = [x.maps.directional_plan(plan, n_inputs) for x in pair]

    def make(native: bool) -> DirectionSums:
        sums = [
            motion_plan(along, n_inputs).sum(native, x.equations.p)
            for along, x in zip(plans, pair, strict=True)
        ]
        data = [
            direction_inputs(along, n_inputs, x.equations.p, dp)
            for along, x, dp in zip(plans, pair, numbers, strict=True)
        ]
        return DirectionSums(sums[0], data[0], sums[1], data[1])

    return make, all(x.is_native for x in plans)
