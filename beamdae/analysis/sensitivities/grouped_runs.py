"""Derivatives of a run with respect to parameters that may need different equations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beamdae.analysis.sensitivities.further_forces import further_key, locate_numbers
from beamdae.analysis.sensitivities.model_differences import Difference, derivative_call
from beamdae.analysis.sensitivities.operator_changes import moves_operators
from beamdae.analysis.sensitivities.redundant_derivatives import RedundantConstraints
from beamdae.analysis.sensitivities.run_derivatives import RunDerivative, RunDerivatives
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.integrators import GeneralizedAlpha, Radau
from beamdae.linear.blas_threads import single_threaded
from beamdae.memory import require_memory
from beamdae.results.solution import Solution

# Copies of the derivatives of all steps that are in memory at the same time.
_COPIES_OF_ROWS = 3.0


def differentiate_states(
    solution: Solution, method: GeneralizedAlpha | Radau, differences: Mapping[str, Difference]
) -> dict[str, RunDerivative]:
    """Return the derivatives of a run by parameter.

    Raises
    ------
    BeamdaeError
        If they do not exist, or need too much memory.
    """
    redundant = RedundantConstraints.of(solution)
    result: dict[str, RunDerivative] = {}
    with single_threaded:
        for group in _group_by_equations(solution.equations, differences):
            _require_memory(solution, len(group))
            if redundant is None:
                result |= RunDerivatives(solution, method, group).by_parameter()
            else:
                result |= redundant.differentiate(method, group)
    return {name: result[name] for name in differences}


def _group_by_equations(
    run: EquationsOfMotion, differences: Mapping[str, Difference]
) -> list[dict[str, Difference]]:
    """Group parameters by the equations in which their forces are present.

    Parameters with the same further forces belong to those without. A parameter that moves
    operators is a group.
    """
    extended = [
        x.base
        for x in differences.values()
        if not moves_operators(x) and locate_numbers(run, x.base) is not None
    ]
    # Steps are differentiated with the further forces of one model.
    largest = max(extended, key=lambda x: len(x.forces), default=run)
    shared = {further_key(run), further_key(largest)}
    groups: dict[Any, dict[str, Difference]] = {}
    for name, difference in differences.items():
        key: Any = further_key(difference.base)
        key = further_key(run) if key in shared else key
        key = name if moves_operators(difference) else key
        groups.setdefault(key, {})[name] = difference
    return list(groups.values())


def _require_memory(solution: Solution, count: int) -> None:
    equations, trajectory = solution.equations, solution.trajectory
    nodes = sum(len(x.nodes) for x in trajectory.intervals)
    require_memory(
        derivative_call(),
        f"derivatives of {trajectory.steps} steps with respect to {count} parameters",
        _COPIES_OF_ROWS * 8.0 * nodes * count * (3 * equations.n + equations.m),
        "use longer steps or fewer parameters",
    )
