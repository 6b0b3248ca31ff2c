"""Directions of parameters, grouped by the equations that are differentiated along them.

Forces may be missing in a model because they vanish at the value of a parameter, such as drag with
a coefficient of zero, and a parameter may move the operators of joints. Along these parameters,
other sums are differentiated than along the others. At the value of the parameter, all of them are
equal: the steps of all directions have the matrices of the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.sensitivities.model_differences import (
    Difference,
    equations_key,
    moves_operators,
)
from beamdae.analysis.sensitivities.recorded_maps import Record
from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.equations.starts.consistent_start import ConsistencySolver

Array = np.ndarray


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

    def along(
        self, record: Record, changes: Sequence[Array], shifts: Array | None = None
    ) -> list[Array]:
        """Return the derivatives of the results of a map; see `Record.along`."""
        return record.along(changes, self.numbers, shifts)


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
