"""What ends a run, or a step early, although the error test accepts the step.

A watch examines the rows of new steps: arguments that leave tables, contacts and peaks that steps
pass over, and events. The run ends at its first stop, or restarts there, after the actions of an
event, or where the error test sees what the step has passed over.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from beamdae.equations.equations_of_motion import EventTerm
from beamdae.integrators.step_history import RunSegment

Array = np.ndarray

_ROUNDING = 4.0 * float(np.finfo(float).eps)


class Stop(NamedTuple):
    """Time at which a step must end.

    Attributes
    ----------
    t
        The time [s].
    probe
        Time [s] inside the contact or peak that begins at `t`, at which the first step after the
        restart ends at the latest.
    reason
        Reason why the run ends at `t`; empty if it restarts there.
    force
        Name of the force that has a peak; empty for other stops.
    event
        Event at `t`; None for other stops.
    """

    t: float
    probe: float
    reason: str = ""
    force: str = ""
    event: EventTerm | None = None

    @property
    def is_restart(self) -> bool:
        """True if the run restarts at `t` with the same equations."""
        return not self.reason and self.event is None


class Watch(Protocol):
    """Search of the steps for times at which they must end."""

    def find_first(self, segment: RunSegment, row: int) -> Stop | None:
        """Return the first stop in the rows of a segment from `row` on, or None."""


def locate_root(
    evaluate: Callable[[Array], Array], start: float, end: float, rtol: float = _ROUNDING
) -> float:
    """Return the time [s] between two times at which a function of times changes its sign."""
    # Imported here because the import takes as long as a short run.
    from scipy.optimize import brentq

    return float(brentq(lambda t: float(evaluate(np.array([t]))[0]), start, end, rtol=rtol))
