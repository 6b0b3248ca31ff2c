"""Forces that are missing in a model, because they vanish at the value of a parameter.

An example is drag with a coefficient of zero. Such a force vanishes for all motions and all values
of the other parameters. The equations with this force therefore serve all parameters, but the steps
are those of the equations without it, whose sums are smaller.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.structure import ConstraintTerm, ForceTerm, Structure, comparison_key
from beamdae.symbolic.sums.directional_sums import direction_inputs, motion_plan
from beamdae.symbolic.sums.kernel_sums import Sum, SumPlan, evaluate_with_data, set_time

Array = np.ndarray


@dataclass(slots=True)
class DirectionSums:
    """Directional derivatives of a sum, for directions with and without further forces.

    Attributes
    ----------
    directional, directional_data, further, further_data
        Sums without and with further forces, and their local inputs by direction, see
        `direction_inputs`.
    is_further
        1 for directions along which further forces change, otherwise 0, (k,).
    """

    directional: Sum
    directional_data: Array
    further: Sum
    further_data: Array
    is_further: Array


def evaluate_direction(
    sums: DirectionSums, k: int, t: float, branch: float, inputs: Array, result: Array
) -> None:
    """Write the derivative along direction `k`; the inputs are (x, dx)."""
    if sums.is_further[k] == 1:
        set_time(sums.further, t, branch)
        evaluate_with_data(sums.further, sums.further_data[k], inputs, result)
    else:
        set_time(sums.directional, t, branch)
        evaluate_with_data(sums.directional, sums.directional_data[k], inputs, result)


def prepare_directions(
    derivatives: StartDerivatives,
    steps_of: EquationsOfMotion,
    plan: Callable[[Structure], SumPlan],
    n_inputs: int,
    numbers: Array,
) -> tuple[Callable[[bool], DirectionSums], bool]:
    """Return the function of `native` that returns directional derivatives of a sum.

    Also return True if machine code is available.

    Parameters
    ----------
    derivatives, steps_of
        Equations with all forces, and those of the steps.
    plan, n_inputs
        Function of a module that returns the plan of the sum, and the size of its inputs.
    numbers
        Derivatives of the numbers p of all forces, one direction a row.
    """
    fewer, at = derivatives, None
    if steps_of.structure != derivatives.equations.structure:
        fewer = StartDerivatives(ConsistencySolver(steps_of))
        at = locate_numbers(steps_of, derivatives.equations)
    of_steps = numbers if at is None else numbers[:, at]
    others = numbers[:, :0] if at is None else np.delete(numbers, at, axis=1)
    is_further = np.asarray(others.any(axis=1), np.intp)
    plans = [x.directional_plan(plan, n_inputs) for x in (fewer, derivatives)]
    all_p = [x.equations.p for x in (fewer, derivatives)]

    def make(native: bool) -> DirectionSums:
        parts = [
            (
                motion_plan(along, n_inputs).sum(native, p),
                direction_inputs(along, n_inputs, p, rows),
            )
            for along, p, rows in zip(plans, all_p, (of_steps, numbers), strict=True)
        ]
        return DirectionSums(*parts[0], *parts[1], is_further)

    return make, all(x.is_native for x in plans)


def further_key(equations: EquationsOfMotion) -> Any:
    """Return a key that is equal if the same equations serve two parameters.

    Forces that are missing in the run may have the same kernels and operators, but other numbers,
    such as the points on which they act. Their structures are equal; their derivatives are not.
    """
    return equations.structure, (equations.p + 0.0).tobytes()  # not -0.0


def locate_numbers(run: EquationsOfMotion, extended: EquationsOfMotion) -> Array | None:
    """Return the indices of the numbers p of `run` in those of `extended`, (n_p,).

    Return None if `extended` does not consist of `run` and further forces. Events may start or stop
    forces; None is returned for models with events.
    """
    one, other = run.structure, extended.structure
    if (
        any(e.events or e.configurations is not None or e.redundant for e in (run, extended))
        or (one.n, one.m, one.states) != (other.n, other.m, other.states)
        or len(one.joints) != len(other.joints)
        or len(run.observables) != len(extended.observables)
    ):
        return None
    available = {_term_key(x): x.data for x in _terms_of(other)}
    pairs = [(x.data, available.get(_term_key(x))) for x in _terms_of(one)]
    pairs += [(x.data, y.data) for x, y in zip(run.observables, extended.observables, strict=True)]
    result = np.full(len(run.p), -1)
    for source, target in pairs:
        if target is None or target.stop - target.start != source.stop - source.start:
            return None
        result[source] = np.arange(target.start, target.stop)
    is_complete = np.all(result >= 0) and len(np.unique(result)) == len(result)
    return result if is_complete else None


def _terms_of(structure: Structure) -> list[ForceTerm | ConstraintTerm]:
    return [*structure.forces, *structure.joints]


def _term_key(term: ForceTerm | ConstraintTerm) -> Any:
    return tuple(comparison_key(x) for name, x in vars(term).items() if name != "data")
