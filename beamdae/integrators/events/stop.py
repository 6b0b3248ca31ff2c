"""What may end a step early although the error test accepts it.

A watch examines the rows of new steps. The run ends at its first stop, or restarts there and again
where the error test sees what the step has passed over.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from beamdae.results.trajectory import Interval


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
