"""What the start of a run differs by from what was asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State

Array = np.ndarray

# Of the size of the mechanism: what a projection may move without a word.
_FAR = 1e-3
_AS_DRAWN = "as drawn"


@dataclass(frozen=True)
class StartChange:
    """What making a start consistent changed of one part.

    Attributes
    ----------
    part
        Its name.
    displacement, velocity
        Largest change of a coordinate [m] and of a velocity [m/s]; angles count by the way they
        carry a point as far away as the part is long.
    coordinate
        The one that was displaced most.
    """

    part: str
    displacement: float
    velocity: float
    coordinate: str


@dataclass(frozen=True)
class StartSummary:
    """How a run started.

    Attributes
    ----------
    asked
        "as drawn", "equilibrium", or the values given.
    changes
        Of each part that has coordinates, what the joints changed of what was asked for.
    warning
        A sentence if that is more than a thousandth of the mechanism and was not asked for.
    """

    asked: str
    changes: tuple[StartChange, ...]
    warning: str

    @property
    def largest(self) -> StartChange | None:
        """The part that was displaced most."""
        return max(self.changes, key=lambda change: change.displacement, default=None)


def compare_start(e: EquationsOfMotion, state: State) -> StartSummary:
    """How a run with these equations that starts at this state differs from what was asked for."""
    asked, q, v, moves = (_AS_DRAWN, e.q0, e.v0, False) if e.start is None else e.start
    angles = np.array([coordinate.unit == "rad" for coordinate in e.coordinates], bool)
    changes = []
    for part in e.parts:
        weight = np.where(angles[part.rows], part.size, 1.0)
        moved = np.abs(state.q - q)[part.rows] * weight
        faster = np.abs(state.v - v)[part.rows] * weight
        most = e.q_names[part.rows][int(np.argmax(moved))]
        changes.append(StartChange(part.name, float(moved.max()), float(faster.max()), most))
    return StartSummary(asked, tuple(changes), "" if moves else _warned(e, changes))


def _warned(e: EquationsOfMotion, changes: list[StartChange]) -> str:
    most = max(changes, key=lambda change: change.displacement, default=None)
    if most is None or not most.displacement > _FAR * e.length:
        return ""
    return (
        f"{most.part}: the joints are not closed as drawn, this part was moved by "
        f"{most.displacement:.3g} m ({most.coordinate} most) before the run, beside a mechanism "
        f"of {e.length:.3g} m; draw it as it starts, or say start= by name."
    )
