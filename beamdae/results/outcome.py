"""Outcome of a run: status and computational cost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

# See `Status.kind`.
Kind = Literal["ok", "limited", "interrupted", "failed", "not run"]


@dataclass(frozen=True)
class Status:
    """Termination status of a run or an analysis.

    Attributes
    ----------
    kind
        "ok" if the run reached its end or was stopped by an event, "limited" if a limit or the
        function `progress` stopped it, "interrupted" if the user interrupted it, "failed" if it
        could not continue, and "not run" if processes or a cluster failed before a result of the
        case was known.
    sentence
        The reason why the run ended, in one line without a final period: line breaks become
        spaces.
    """

    kind: Kind
    sentence: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "sentence", " ".join(str(self.sentence).split()).rstrip(". "))

    @property
    def success(self) -> bool:
        """True if `kind` is "ok"."""
        return self.kind == "ok"

    def is_unreliable(self, has_pending_event: bool) -> bool:
        """Return True if the last state of the run may be wrong.

        The last state of a failed run is unreliable, unless the run failed while executing an
        event (`has_pending_event`), because such a failure does not affect the state.
        """
        return self.kind == "failed" and not has_pending_event

    def followed_by(self, later: Status, has_pending_event: bool) -> Status:
        """Return the combined status of this run and a later run that resumed this run.

        `has_pending_event` is True if this run recorded an event but did not execute it.
        """
        if not later.success or not self.is_unreliable(has_pending_event):
            return later
        return Status(
            "failed", f"{later.sentence}, but the run resumed from a failed run: {self.sentence}"
        )


def accuracy_of(result: Any) -> Status | None:
    """Return what was reached of a required accuracy, or None if none was required."""
    errors = vars(result).get("errors")
    return errors.status if errors is not None and errors.status.sentence else None


def replace_with_errors(result: Any, **changes: Any) -> Any:
    """Return a result with changed fields, such as its status, and its known errors."""
    changed = replace(result, **changes)
    if "errors" in vars(result):
        vars(changed)["errors"] = vars(result)["errors"]
    return changed


# Appended to the reason if the run ended during the pilot run.
PILOT_RUN_SUFFIX = " of the pilot run"
REACHED_END = Status("ok", "reached the end")


@dataclass(frozen=True)
class Statistics:
    """Computational cost of a run.

    Attributes
    ----------
    steps
        Number of accepted steps.
    rejected_steps
        Number of steps rejected because of the error test or because Newton's method failed.
    residual_calls, jacobian_calls
        Number of evaluations of the residual and of the Jacobian.
    factorizations, solves
        Number of LU factorizations and of linear solves.
    newton_failures
        Number of Newton iterations that did not converge, whether with the current Jacobian or with
        the Jacobian of an earlier step. Integrators that use scikit-sundae, which does not report
        this number, count Jacobian updates within steps instead.
    setup_time, wall_time
        Times for the consistent start and compilation, and for the integration, including a pilot
        run [s]. The assembly of the equations is not included.
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
