"""Events that happened in a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations import measures
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State

Array = np.ndarray

UP, DOWN = "up", "down"


@dataclass(frozen=True)
class Occurrence:
    """An event that happened.

    Attributes
    ----------
    name, direction
        Of the event, and "up" or "down".
    t, branch
        When [s], and a time inside the interval, by which laws choose their piece.
    state
        The state there, on the polynomials of the dense output.
    """

    name: str
    direction: str
    t: float
    branch: float
    state: State

    @property
    def plain(self) -> dict[str, Any]:
        """What happened when."""
        return {"event": self.name, "direction": self.direction, measures.TIME: self.t}


def table_of(equations: EquationsOfMotion, occurred: Sequence[Occurrence]) -> dict[str, Any]:
    """Columns: which events happened when, and what was observed then."""
    columns: dict[str, Any] = {
        "event": [one.name for one in occurred],
        "direction": [one.direction for one in occurred],
        measures.TIME: np.array([one.t for one in occurred]),
    }
    headers = [header for o in equations.observables for header in o.headers]
    times = np.array([(one.t, one.branch) for one in occurred]).reshape(-1, 2)
    sizes = (equations.n, equations.n, equations.n, equations.m)
    states = zip(*(one.state for one in occurred), strict=True) if occurred else [()] * 4
    rows = (np.reshape(list(x), (-1, n)) for x, n in zip(states, sizes, strict=True))
    values = measures.ObservedRows(equations)(times, *rows)
    return columns | dict(zip(headers, values.T, strict=True))
