"""Outcome of a run: its status and its cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

# Reached its end, stopped by a limit, interrupted by the user, or unable to continue.
Kind = Literal["ok", "limited", "interrupted", "failed"]


@dataclass(frozen=True)
class Status:
    """Status of a run: how it ended, and why.

    Attributes
    ----------
    kind
        "ok" if the run reached its end, "limited" if a limit stopped it, "interrupted" if the user
        did, "failed" if it could not continue.
    sentence
        The reason.
    """

    kind: Kind
    sentence: str

    @property
    def success(self) -> bool:
        """True if the run reached its end."""
        return self.kind == "ok"

    def is_unreliable(self, has_pending_event: bool) -> bool:
        """Return whether the last state of the run may be wrong.

        A failed run ends in a doubtful state, unless it failed to execute an event at that time:
        this does not affect the state.
        """
        return self.kind == "failed" and not has_pending_event

    def followed_by(self, later: Status, has_pending_event: bool) -> Status:
        """Return the status of this run and one that resumed from its end, taken as one run."""
        if not later.success or not self.is_unreliable(has_pending_event):
            return later
        return Status(
            "failed", f"{later.sentence}, but it resumed from a failed run: {self.sentence}"
        )


# Appended to the reason of a run that ended during the pilot run.
PILOT_RUN_SUFFIX = " of the pilot run"
REACHED_END = Status("ok", "reached the end")


@dataclass(frozen=True)
class Statistics:
    """Cost of a run.

    Attributes
    ----------
    steps
        Accepted steps.
    rejected_steps
        Attempts rejected by the error test or by Newton's method.
    residual_calls, jacobian_calls
        Calls of the compiled residual and of the compiled Jacobian.
    factorizations, solves
        LU factorizations, and solutions with them.
    newton_failures
        Newton iterations that did not converge, with the Jacobian of an earlier step (which is then
        updated) or with the current one. scikit-sundae's class does not report these; there it is
        the number of Jacobians updated within a step.
    setup_time, wall_time
        Time for building and compiling, and for the integration alone [s].
    """

    steps: int = 0
    rejected_steps: int = 0
    residual_calls: int = 0
    jacobian_calls: int = 0
    factorizations: int = 0
    solves: int = 0
    newton_failures: int = 0
    setup_time: float = 0.0
    wall_time: float = 0.0
