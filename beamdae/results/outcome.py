"""How a run ended and what it cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

# How a run may end: at its end, stopped by a limit or by the user, or because it could not go on.
Kind = Literal["ok", "limited", "interrupted", "failed"]


@dataclass(frozen=True)
class Status:
    """How a run ended: its kind, and a sentence."""

    kind: Kind
    sentence: str

    @property
    def success(self) -> bool:
        """Whether it reached its end."""
        return self.kind == "ok"

    def leaves_doubt(self, due: bool) -> bool:
        """Whether a state at which a run failed is not to be trusted.

        It is where an event was `due` that could not be carried out: that says nothing of the
        state.
        """
        return self.kind == "failed" and not due

    def followed_by(self, later: Status, due: bool) -> Status:
        """How two runs ended, of which the later went on where this one ended, taken as one."""
        if not later.success or not self.leaves_doubt(due):
            return later
        told = f"{later.sentence}, but from where the run before had failed: {self.sentence}"
        return Status("failed", told)


# In the sentence on a run that was ended before it had begun, of what went ahead.
PILOT_RUN_SUFFIX = " of the scout, which goes before the run"
REACHED_END = Status("ok", "reached the end")


@dataclass(frozen=True)
class Statistics:
    """What a run cost.

    Attributes
    ----------
    steps, rejected_steps
        Accepted steps; attempts given up (error test or Newton).
    residual_calls, jacobian_calls, factorizations, solves
        Calls of the compiled residual and Jacobian, LU factorizations and solutions.
    newton_failures
        Newton iterations that did not converge with the Jacobian of an earlier step, which is then
        renewed, or for good. scikit-sundae's class does not tell: there these are Jacobians renewed
        within a step.
    setup_time, wall_time
        Building and compiling; integration alone [s].
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
