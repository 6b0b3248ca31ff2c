"""What may end a step early although the error test accepts it.

A watch examines the rows of new steps. The run ends at its first stop, or restarts there and again
where the error test sees what the step has passed over.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from beamdae.results.trajectory import Interval

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
    """

    t: float
    probe: float
    reason: str = ""
    force: str = ""


class Watch(Protocol):
    """Search of the steps for times at which they must end."""

    @property
    def spacing(self) -> float:
        """Length [s] of a step from which on steps are searched."""

    def find_first(self, interval: Interval, begin: float) -> Stop | None:
        """Return the first stop in the steps after `begin` [s], or None."""


def locate_root(
    evaluate: Callable[[Array], Array], start: float, end: float, rtol: float = _ROUNDING
) -> float:
    """Return the time [s] between two times at which a function of times changes its sign."""
    # Imported here because the import takes as long as a short run.
    from scipy.optimize import brentq

    return float(brentq(lambda t: float(evaluate(np.array([t]))[0]), start, end, rtol=rtol))
