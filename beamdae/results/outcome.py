"""Outcome of a run: status, computational cost, and records of its events."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from beamdae.equations import measures
from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm, State
from beamdae.model_parameters import format_with_unit
from beamdae.read_only import read_only_data
from beamdae.results.trajectory import Trajectory

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


Array = np.ndarray

UP, DOWN = "up", "down"


@read_only_data
@dataclass(frozen=True)
class EventRecord:
    """Record of one occurrence of an event.

    Attributes
    ----------
    name
        Name of the event.
    direction
        Direction in which the monitored quantity crossed the value of the event: "up" or "down".
    t
        Time of the crossing [s].
    branch
        Time inside the integration interval [s], by which piecewise laws select their piece.
    state
        State at the crossing, before the actions of the event.
    impulses
        Impulses of joints and gaps during a velocity jump, by multiplier name [N s or N m s]; empty
        unless the event switches parts or causes an impact.
    energy_lost
        Kinetic energy dissipated by the velocity jump [J]; 0 without a jump.
    done
        False if the run ended before the actions of the event were executed; a resumed run executes
        these actions first.
    """

    name: str
    direction: str
    t: float
    branch: float
    state: State
    impulses: dict[str, float] = field(default_factory=dict)
    energy_lost: float = 0.0
    done: bool = True

    def as_dict(self) -> dict[str, Any]:
        """Return the record without state and branch as a JSON-compatible dictionary.

        Impulses and energy lost are omitted if there are no impulses, "done" if it is true.
        """
        record: dict[str, Any] = {
            "event": self.name,
            "direction": self.direction,
            measures.TIME: self.t,
        }
        if self.impulses:
            record |= {"impulses": self.impulses, "energy lost [J]": self.energy_lost}
        if not self.done:
            record["done"] = False
        return record


def format_event_counts(names: Iterable[str]) -> str:
    """Format the number of occurrences of each event, given one name per occurrence."""
    counts = Counter(names).items()
    return ", ".join(name if n == 1 else f"{name} {n} times" for name, n in counts) or "none"


def describe_events(
    equations: EquationsOfMotion, trajectory: Trajectory, event_records: Sequence[EventRecord]
) -> str:
    """Return the number and first time [s] of each event, and how close missing events came.

    Events of parts, such as the ends of a guide, are omitted if they did not occur.
    """
    times: dict[str, list[float]] = {}
    for record in event_records:
        times.setdefault(record.name, []).append(record.t)
    phrases = [
        f"{name} at {t[0]:.4g} s" if len(t) == 1 else f"{name} {len(t)} times from {t[0]:.4g} s"
        for name, t in times.items()
    ]
    events = () if equations.mechanism is None else equations.mechanism.events
    requested = {event.name for event in events}
    phrases += [
        f"{term.name} did not occur ({_describe_approach(equations, trajectory, term)})"
        for term in equations.events
        if term.name in requested and term.name not in times
    ]
    return ", ".join(phrases) or "none"


def _describe_approach(
    equations: EquationsOfMotion, trajectory: Trajectory, term: EventTerm
) -> str:
    """Return the value at a step of a run at which an event that did not occur was closest."""
    rows = []
    for interval in trajectory.intervals:
        times, (q, v, _, lam) = interval.times, interval.rows
        p = equations.with_loads_of(interval.configuration).p
        rows.append((times[:, 0], term.evaluate_difference(p, times, q, v, lam)))
    t, difference = (np.concatenate(x) for x in zip(*rows, strict=True))
    if np.min(difference) < 0.0 < np.max(difference):
        return f"crossed only {DOWN if term.direction > 0 else UP}ward"
    k = int(np.argmin(np.abs(difference)))
    unit = term.observable.columns[term.column].unit
    reached, needed = (
        format_with_unit(float(f"{x:.4g}"), unit)
        for x in (term.crosses + difference[k], term.crosses)
    )
    return f"closest {reached} at {t[k]:.4g} s, needed {needed}"


def tabulate_events(
    equations: EquationsOfMotion,
    event_records: Sequence[EventRecord],
    observe: Callable[..., Array],
) -> dict[str, Any]:
    """Return table columns by header, with one row per event.

    `observe` returns rows of the observed columns at rows of (t, branch) and of states.

    The columns are name, direction and time, energy lost and impulses (if any event has impulses),
    and the observed columns.
    """
    columns: dict[str, Any] = {
        "event": [record.name for record in event_records],
        "direction": [record.direction for record in event_records],
        measures.TIME: np.array([record.t for record in event_records]),
    }
    if any(record.impulses for record in event_records):
        columns["energy lost [J]"] = np.array([record.energy_lost for record in event_records])
        for name in dict.fromkeys(name for record in event_records for name in record.impulses):
            columns[f"impulse.{name}"] = np.array(
                [record.impulses.get(name, 0.0) for record in event_records]
            )
    headers = equations.observed_headers
    count = len(event_records)
    times = np.array([(record.t, record.branch) for record in event_records]).reshape(-1, 2)
    sizes = (equations.n, equations.n, equations.n, equations.m)
    states = zip(*(record.state for record in event_records), strict=True) if count else [()] * 4
    rows = (np.reshape(x, (count, size)) for x, size in zip(states, sizes, strict=True))
    values = observe(times, *rows)
    return columns | dict(zip(headers, values.T, strict=True))
