"""Derivatives of the times of events and breakpoints, at which runs restart."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from beamdae.analysis.sensitivities.neighbors import (
    Difference,
    derivative_call,
)
from beamdae.analysis.sensitivities.observable_derivatives import (
    differentiate_columns,
    group_times,
    join_points,
    time_derivative,
)
from beamdae.equations.equations_of_motion import (
    EquationsOfMotion,
)
from beamdae.equations.smooth_intervals import SAME_TIME
from beamdae.errors import (
    BeamdaeError,
)
from beamdae.results.outcome import EventRecord
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray

# Slowest rate of an event quantity at an event, relative to the range of the quantity and to the
# duration of the interval before it. A parabola that passes its threshold with a slower rate
# exceeds it by less than 1e-8 of its range, which runs do not resolve.
_MIN_EVENT_RATE = 1e-4


def time_rounding(trajectory: Trajectory) -> float:
    """Return the difference up to which times of a run are the same [s]."""
    return SAME_TIME * max(abs(trajectory.start), abs(trajectory.end))


def event_number(equations: EquationsOfMotion, name: str) -> int:
    """Return the index of an event."""
    return next(k for k, x in enumerate(equations.events) if x.name == name)


def find_event(solution: Solution, t: float) -> EventRecord | None:
    """Return the record of the event that acts at `t` [s], or None.

    Raises
    ------
    BeamdaeError
        If the derivative does not exist, because several events act, or the event is at the end of
        the run or at a breakpoint.
    """
    records = _records_at(solution, t, stops=False)
    if not records:
        return None
    rounding, times = time_rounding(solution.trajectory), solution.equations.breakpoints
    for at, place in (
        (solution.trajectory.end, "the end of the run"),
        *((x, "a breakpoint of a law") for x in times),
    ):
        if abs(t - at) <= rounding:
            raise BeamdaeError(
                f"{derivative_call()}: event {records[0].name} acts at {place}, t = {t:g} s, where "
                "the derivatives do not exist; separate the two times."
            )
    return records[0]


def find_stop(solution: Solution) -> int | None:
    """Return the index of the event that stopped a run, None if it reached its end time.

    Raises
    ------
    BeamdaeError
        If several events stop the run at the same time.
    """
    records = _records_at(solution, solution.trajectory.end, stops=True)
    return event_number(solution.equations, records[0].name) if records else None


def _records_at(solution: Solution, t: float, *, stops: bool) -> list[EventRecord]:
    """Return the record of the event that acts at `t` [s], or stops the run, if there is one."""
    equations, rounding = solution.equations, time_rounding(solution.trajectory)

    def is_sought(name: str) -> bool:
        action = equations.events[event_number(equations, name)].do
        return action == "stop" if stops else not isinstance(action, str)

    records = [x for x in solution.event_records if abs(x.t - t) <= rounding and is_sought(x.name)]
    # Impacts that close each other's gaps occur several times.
    names = list(dict.fromkeys(x.name for x in records))
    if len(records if not stops else names) > 1:
        raise BeamdaeError(
            f"{derivative_call()}: events {' and '.join(names)} act at the same time, t = {t:g} s, "
            "where the derivatives do not exist; separate the two times."
        )
    return records


def require_inner_breakpoints(difference: Difference, trajectory: Trajectory) -> None:
    """Reject a parameter that moves a breakpoint across the start or the end of the run."""
    rounding = time_rounding(trajectory)
    for b, dt in breakpoint_derivatives(difference):
        if dt and min(abs(b - trajectory.start), abs(b - trajectory.end)) <= rounding:
            raise BeamdaeError(
                f"{derivative_call()}: {difference.name} moves the breakpoint of a law at t = "
                f"{b:g} s across the start or the end of the run, where the derivatives do "
                "not exist; choose another value, or another t_end."
            )


def differentiate_event_time(
    equations: EquationsOfMotion,
    number: int,
    interval: Interval,
    t: float,
    along: Mapping[str, Interval],
    differences: Mapping[str, Difference],
) -> dict[str, float]:
    """Return the derivatives of the time of an event [s] by parameter.

    Parameters
    ----------
    equations, number
        Equations of all parts, and index of the event in them.
    interval, t
        Interval of the run that contains the event, and the time of the event [s].
    along
        Derivatives of the states of the interval, by parameter.
    differences
        Models at neighboring values, by parameter.

    Raises
    ------
    BeamdaeError
        If the event quantity hardly changes at the event.
    """
    term, here = equations.events[number], np.array([t])
    # Elastic forces follow from the states at several nodes, with weights, others from that at t.
    is_elastic = term.observable.is_elastic
    ((inactive, points),) = group_times(Trajectory((interval,)), here, is_elastic)
    times, at = join_points(points, Trajectory((interval,)))
    active = equations.without_loads_of(inactive)
    values = term.evaluate_difference(
        active.p, interval.times, interval.rows.q, interval.rows.v, interval.rows.lam
    )
    duration = max(float(interval.nodes[-1] - interval.nodes[0]), np.finfo(float).tiny)
    if is_elastic:
        rate = float(interval.force_rates_at(values, here)[0])
    else:
        rates = time_derivative(term.observable, active, times, at, interval.derivative_at(here))
        rate = float(rates[0, term.column])
    if not abs(rate) > _MIN_EVENT_RATE * float(np.ptp(values)) / duration:
        raise BeamdaeError(
            f"{derivative_call()}: the quantity of event {term.name} only touches its value at t = "
            f"{t:g} s, where the derivatives do not exist; choose other values of the parameters."
        )
    changes = differentiate_columns(
        lambda e: e.events[number].observable,
        times,
        at,
        {name: join_points(points, Trajectory((x,)))[1] for name, x in along.items()},
        differences,
        inactive,
    )
    weights = points[0].weights
    return {
        name: (
            differences[name].along(lambda e: e.events[number].crosses)
            - float((change if weights is None else weights @ change)[0, term.column])
        )
        / rate
        + 0.0  # not -0.0
        for name, change in changes.items()
    }


def breakpoint_derivatives(difference: Difference) -> list[tuple[float, float]]:
    """Return pairs of a breakpoint [s] and its derivative."""
    derivatives = difference.along(lambda e: np.array(e.breakpoints))
    return list(zip(difference.base.breakpoints, derivatives.tolist(), strict=True))
