"""The drive all integrators share: from breakpoint to breakpoint, within limits, to a solution.

A method is its step; the drive has the clock, the plan of breakpoints, the limits, Ctrl-C and the
rows.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.failure_diagnosis import blame
from beamdae.equations.formulations import State
from beamdae.errors import BeamdaeError
from beamdae.integrators.events.event_detection import STEPS_AT_ONCE, Leg, Watch, output_times
from beamdae.integrators.events.switching import Methods, first_configuration, switched
from beamdae.integrators.integrator import Integrator, Progress, require_limits
from beamdae.integrators.limits import Limits, Pace
from beamdae.integrators.method import Method, StepError
from beamdae.integrators.pilot_run import WHOSE, scouted
from beamdae.integrators.redundant_constraints import spared, with_all
from beamdae.integrators.rows import NoRoomError, Rows
from beamdae.integrators.run_plan import Route, branch_of, plan
from beamdae.integrators.steps import taken
from beamdae.linear.factorizations import single_threaded
from beamdae.results.event_records import Occurrence
from beamdae.results.outcome import REACHED_END, Status
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Where to look for what stopped a run, over what was left of its interval.
_AHEAD = 1e-6
_NO_MEMORY = "more memory is needed than there is; take larger steps, or end the run sooner"
_NOT_FINITE = "the state is not finite; check laws, masses and start values"


# Events switched parts where the rows end.
ACTED = Status("ok", "an event switched parts")


class _Run:
    """A run under way.

    Wherever it is interrupted, the rows of its legs, one an interval, are good.
    """

    def __init__(
        self,
        whole: EquationsOfMotion,
        route: Route,
        method_on: Callable[[Route], Method],
        limits: Limits,
        whose: str = "",
    ) -> None:
        """Prepare a run of the `whole` equations.

        `whose` it is goes into the sentence if it is interrupted.
        """
        self._whole, self._route, self._limits, self._whose = whole, route, limits, whose
        self.method = method_on(route)
        self._configuration = first_configuration(whole)
        self.methods = Methods(method_on, self.method, self._configuration)
        start, end = route.intervals[0]
        # Those of intervals not yet gone over: events may bring more.
        self._ends = tuple(end for _, end in route.intervals)
        self._legs: list[Leg] = []
        self._begin_leg(start, branch_of(start, end), route.state)
        self.steps = 0
        self._watch = Watch(whole) if whole.events else None
        self._at_once = STEPS_AT_ONCE if self._watch and self._watch.may_stop else None

    def through(self) -> tuple[Trajectory, Status]:
        """Go through the intervals until one does not end."""
        try:
            status = self._through()
        except KeyboardInterrupt:
            return self.interrupted()
        return self._reached(status)

    def interrupted(self) -> tuple[Trajectory, Status]:
        """What was reached when the user would not wait."""
        sentence = f"interrupted at t = {self._rows.end:.6g} s{self._whose}"
        return self._reached(Status("interrupted", sentence))

    @property
    def occurred(self) -> tuple[Occurrence, ...]:
        """The events that happened."""
        return () if self._watch is None else tuple(self._watch.occurred)

    @property
    def sides(self) -> dict[str, int]:
        """On which sides of their values the quantities of events were left."""
        return {} if self._watch is None else self._watch.sides

    @property
    def _rows(self) -> Rows:
        return self._legs[-1].rows

    def _begin_leg(self, t: float, branch: float, state: State) -> None:
        self._legs.append(Leg(Rows(t, state), branch, self._configuration))

    def _reached(self, status: Status) -> tuple[Trajectory, Status]:
        if not self._rows.cut_to_finite():
            status = self._failed(_NOT_FINITE)
        return Trajectory(tuple(leg.interval(self._whole.m) for leg in self._legs)), status

    def _failed(self, reason: object) -> Status:
        return Status("failed", f"stopped at t = {self._rows.end:.6g} s: {reason}")

    def _through(self) -> Status:
        begins = self._watch is not None and self._watch.begins(self._legs[0])
        status = ACTED if begins else self._over(self._ends[0])
        while True:
            while status is ACTED:
                status = self._acted()
            if status is not REACHED_END or not self._rows.is_finite:
                return status
            start, *left = self._ends
            if not left:
                return REACHED_END
            self._ends, branch = tuple(left), branch_of(start, left[0])
            try:
                state = self._restarted(start, branch, self._rows.last)
            except BeamdaeError as problem:
                return Status("failed", f"no consistent restart at t = {start:g} s: {problem}")
            self._begin_leg(start, branch, state)
            status = self._over(left[0])

    def _restarted(self, start: float, branch: float, state: State) -> State:
        """A state consistent with the laws that begin at `start`."""
        time, starter = np.array([start, branch]), self._route.starter
        starter.require_continuous(self._legs[-1].branch, time, state.q)
        return starter.state(time, state.q, state.v)

    def _over(self, end: float) -> Status:
        """Step from where the leg begins to the end of the interval."""
        method, limits, rows, branch = self.method, self._limits, self._rows, self._legs[-1].branch
        between_looks = method.steps_between_looks
        try:
            method.begin(rows.end, end, branch, rows.last)
            while rows.end < end:
                first = rows.count
                most = limits.steps_left(self.steps, between_looks)
                self.steps += taken(method, rows, min(most, self._at_once or most), end)
                if self._watch and (event := self._watch.after(self._legs[-1], first)):
                    stopped = f"stopped by event {event.name} at t = {rows.end:.6g} s"
                    return Status("ok", stopped) if event.do == "stop" else ACTED
                t = rows.end
                if t < end and (stop := limits.reason(t, self.steps, between_looks)):
                    return Status("limited", f"{stop}, stopped at t = {t:.6g} s")
        except StepError as problem:
            now, ahead = np.array([rows.end, branch]), rows.end + _AHEAD * (end - rows.end)
            causes = blame(self._route.equations, now, rows.last, ahead, problem.residual)
            return self._failed("; ".join(filter(None, (str(problem), causes))))
        except BeamdaeError as problem:
            # Nothing is lost that was computed; before the first step a mistake is no run.
            if self.steps == 0:
                raise
            return self._failed(problem)
        except MemoryError as problem:
            told = problem if isinstance(problem, NoRoomError) else _NO_MEMORY
            return Status("limited", f"{told}, stopped at t = {rows.end:.6g} s")
        return REACHED_END

    def _acted(self) -> Status:
        """Switch the parts of the event that happened, and step over what is left."""
        assert self._watch is not None
        assert self._configuration is not None
        event, t = self._watch.fired, self._rows.end
        if stall := self.methods.stall(event, t, self._route.duration):
            return Status("limited", f"{stall}, stopped at t = {t:.6g} s")
        try:
            time, now = np.array([t, self._legs[-1].branch]), self._configuration
            done = switched(self._whole, now, self._route, event, time, self._ends, self._rows.last)
            self._configuration, self._route, self._ends = done.configuration, done.route, done.ends
            self.method = self.methods.on(done.route, done.configuration)
        except BeamdaeError as problem:
            return self._failed(f"event {event.name}: {str(problem).removesuffix('.')}")
        self._begin_leg(t, done.branch, done.state)
        self._watch.switched(self._legs[-1], done.impulses, done.energy_lost)
        return self._over(self._ends[0]) if t < self._ends[0] else REACHED_END


def drive(
    integrator: Integrator,
    equations: EquationsOfMotion,
    times: Array,
    method_on: Callable[[Route], Method],
    progress: Progress | None,
    scout_on: Callable[[Route], Method] | None = None,
) -> Solution:
    """Run a method over all intervals; see `Integrator.integrate`.

    Parameters
    ----------
    integrator
        Its settings, a dataclass; `max_steps` and `time_limit` among them are heeded.
    method_on
        Makes the method for a run: compiles, and resolves what is "auto".
    scout_on
        Makes the same with the tolerance SCOUTING_RTOL: it goes first, to see how far the parts
        move, unless the equations say so. None: the method needs no `Route.amplitudes`.
    """
    solution = None
    try:
        # States that are not finite end a run; the steps that come to them say nothing.
        with single_threaded, np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            by = spared(equations, float(times[0]))
            own = equations if by is None else by.equations
            solution = _driven(integrator, own, times, method_on, progress, scout_on)
            solution = solution if by is None else with_all(solution, by)
    except KeyboardInterrupt:
        if solution is None:
            raise
        at = f"interrupted at t = {solution.trajectory.end:.6g} s, after the last step"
        solution = replace(solution, status=Status("interrupted", at))
    return solution


def _driven(
    integrator: Integrator,
    equations: EquationsOfMotion,
    times: Array,
    method_on: Callable[[Route], Method],
    progress: Progress | None,
    scout_on: Callable[[Route], Method] | None,
) -> Solution:
    settings = asdict(integrator)  # type: ignore[call-overload]
    require_limits(integrator)
    setup = clock.perf_counter()
    first = first_configuration(equations)
    route = plan(equations if first is None else first.equations, times)
    setup_time = clock.perf_counter() - setup

    begin = clock.perf_counter()
    limits = Limits(progress, settings.get("time_limit"), settings.get("max_steps"), begin)
    if integrator.accuracy.name == "rtol" and limits.max_steps is None:
        limits.pace = Pace(route.intervals[-1][1])
    run: _Run | None = None
    status, setup = REACHED_END, 0.0

    def made(route: Route, limits: Limits, on: Callable[[Route], Method], whose: str = "") -> _Run:
        nonlocal setup
        since = clock.perf_counter()
        found = _Run(equations, route, on, limits, whose)
        setup += clock.perf_counter() - since
        return found

    try:
        if scout_on is not None and equations.scales is None:
            scouting = partial(made, on=scout_on, whose=WHOSE)
            route, run, trajectory, status = scouted(route, scouting, limits)
        if status.kind != "interrupted":
            run = made(route, limits, method_on)
            trajectory, status = run.through()
    except KeyboardInterrupt:
        if run is None:
            raise
        trajectory, status = run.interrupted()
    assert run is not None
    wall_time = clock.perf_counter() - begin - setup
    seen = {} if route.amplitudes is None else {"amplitudes": route.amplitudes.by_part}
    return Solution(
        equations,
        trajectory,
        output_times(times, trajectory.end, status),
        status,
        replace(
            run.methods.counts, steps=run.steps, setup_time=setup_time + setup, wall_time=wall_time
        ),
        {"integrator": integrator.method, **settings, **run.methods.first.resolved, **seen},
        made_by=integrator,
        occurred=run.occurred,
        sides=run.sides,
    )
