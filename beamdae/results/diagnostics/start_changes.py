"""Changes that making the start consistent with the joints made to the requested start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State

Array = np.ndarray

_MAX_UNREPORTED_DISPLACEMENT = 1e-3  # relative to the length of the mechanism
_AS_DRAWN = "as drawn"


@dataclass(frozen=True)
class StartChange:
    """Change of one part when the start was made consistent.

    Attributes
    ----------
    part
        Name of the part.
    displacement, velocity
        Largest change of a coordinate [m] and of a velocity [m/s]. Angles are multiplied by the
        length of the part.
    coordinate
        Name of the coordinate with the largest displacement.
    """

    part: str
    displacement: float
    velocity: float
    coordinate: str


@dataclass(frozen=True)
class StartSummary:
    """Start of a run.

    Attributes
    ----------
    request
        Requested start: "as drawn", "equilibrium", or the given values as text.
    changes
        Difference between the requested and the consistent start, one entry per part that has
        coordinates.
    warning
        Warning if a mechanism that starts as drawn was displaced by more than a thousandth of its
        length; otherwise empty.
    """

    request: str
    changes: tuple[StartChange, ...]
    warning: str

    @property
    def largest(self) -> StartChange | None:
        """The part with the largest displacement."""
        return max(self.changes, key=lambda change: change.displacement, default=None)


def compare_start(e: EquationsOfMotion, state: State) -> StartSummary:
    """Compare the requested start of these equations with the state at which a run starts."""
    request, q, v, is_moved = (_AS_DRAWN, e.q0, e.v0, False) if e.start is None else e.start
    is_angle = np.array([coordinate.unit == "rad" for coordinate in e.coordinates], bool)
    changes = []
    for part in e.parts:
        lever = np.where(is_angle[part.rows], part.size, 1.0)
        displacement = np.abs(state.q - q)[part.rows] * lever
        velocity = np.abs(state.v - v)[part.rows] * lever
        largest = e.q_names[part.rows][int(np.argmax(displacement))]
        changes.append(
            StartChange(part.name, float(displacement.max()), float(velocity.max()), largest)
        )
    summary = StartSummary(request, tuple(changes), "")
    change = summary.largest
    if (
        is_moved
        or change is None
        or not (change.displacement > _MAX_UNREPORTED_DISPLACEMENT * e.length)
    ):
        return summary
    warning = (
        f"{change.part}: the joints are not closed as drawn, and this part was displaced by "
        f"{change.displacement:.3g} m (mostly {change.coordinate}) to close them, in a mechanism "
        f"of {e.length:.3g} m; draw the parts as they start, or pass start= by name."
    )
    return StartSummary(request, summary.changes, warning)
