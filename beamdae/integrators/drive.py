"""The drive all integrators share: from breakpoint to breakpoint, within limits, to a solution.

A method is its step; the drive has the clock, the plan of breakpoints, the limits, Ctrl-C and the
rows.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State
from beamdae.errors import BeamdaeError
from beamdae.integrators.amplitudes import Amplitudes
from beamdae.integrators.integrator import Integrator, Progress, require_limits
from beamdae.integrators.route import Route, branch_of, plan
from beamdae.integrators.rows import Rows
from beamdae.results.solution import REACHED_END, Solution, Statistics, Status
from beamdae.results.trajectory import Interval, Trajectory
from beamdae.symbolic.factorizations import single_threaded

Array = np.ndarray

STUCK = "the step became too small to advance time; check laws, or loosen rtol"
_PAST = "past the end of its interval; a method must stop there"
_STAGES = "a method must give the stages inside a step in the order of time, in every step as many"
_NOT_FINITE = "the state is not finite; check laws, masses and start values"
# The tolerance of a scout, how often and how far it goes, in steps and in shares of the time there
# is, and what is much less motion than it was tolerant of.
SCOUTING_RTOL = 1e-2
_SCOUTING = f"of the scout, which goes before the run with rtol = {SCOUTING_RTOL:g}"
_MOST_SCOUTS = 4
_MOST_SCOUTING_STEPS = 20_000
_SCOUTING_TIME = 0.25
_MUCH_LESS = 0.3
# A scout that did not go this share of the way has seen too little.
_LEAST_WAY = 0.2


class StepError(ArithmeticError):
    """A method cannot go on; the message says why, and what to do."""


# What a step gives: its end, and the stages inside it where a method has them.
Taken = tuple[float, State] | tuple[float, State, Sequence[tuple[float, State]]]


class Method(Protocol):
    """What a drive asks of a method; one object a run."""

    @property
    def resolved(self) -> dict[str, Any]:
        """What "auto" and tolerances came to, by name."""

    @property
    def counts(self) -> Statistics:
        """Calls and rejected steps so far."""

    @property
    def steps_between_looks(self) -> int:
        """After how many steps progress is told."""

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin a smooth interval at a consistent state."""

    def step(self) -> Taken:
        """Time and state after one more step, at most at the end of the interval.

        A method with stages may add (time, state) of those inside the step, in the order of time
        and always as many: output between steps and the energy ledger then use them, see
        `Interval`.

        Raises
        ------
        StepError
            If there is none.
        """


# The last step of an interval ends on its end if it comes this near.
_NEARLY = 1.0 - 1e-9


def fitted(step: float, left: float) -> float:
    """The step to try where so much is left of an interval [s]: its last two are equal."""
    return left if step >= _NEARLY * left else min(step, 0.5 * left)


@dataclass
class _Limits:
    """What ends a run before its end."""

    progress: Progress | None
    time_limit: float | None
    max_steps: int | None
    begin: float

    def reason(self, t: float, steps: int, between_looks: int) -> str | None:
        """Why the run has to stop at time `t` [s] after so many steps, or None."""
        if self.max_steps is not None and steps >= self.max_steps:
            return f"max_steps = {self.max_steps} taken"
        if self.time_limit is not None and clock.perf_counter() - self.begin > self.time_limit:
            return f"time limit of {self.time_limit:g} s"
        if self.progress is None or steps % between_looks:
            return None
        # Bars answer with whatever they please.
        answer = self.progress(t)
        return answer if isinstance(answer, str) else None


class _Run:
    """A run under way."""

    def __init__(self, route: Route, method: Method, limits: _Limits) -> None:
        self._route, self._method, self._limits = route, method, limits
        self._done: list[Interval] = []
        self.steps = 0

    def through(self) -> tuple[Trajectory, Status]:
        """Go through the intervals until one does not end."""
        status = REACHED_END
        state = self._route.state
        for start, end in self._route.intervals:
            branch = branch_of(start, end)
            if self._done:
                try:
                    state = self._restarted(start, branch, state)
                except BeamdaeError as problem:
                    reason = f"no consistent restart at t = {start:g} s: {problem}"
                    status = Status("failed", reason)
                    break
                except KeyboardInterrupt:
                    status = _interrupted(start)
                    break
            rows = Rows(start, state)
            status = self._over(start, end, branch, rows)
            if not rows.cut_to_finite():
                status = Status("failed", f"stopped at t = {rows.end:.6g} s: {_NOT_FINITE}")
            self._done.append(rows.interval(branch))
            if not status.success:
                break
            state = rows.last
        return Trajectory(tuple(self._done)), status

    def _restarted(self, start: float, branch: float, state: State) -> State:
        """A state consistent with the laws that begin at `start`."""
        time, starter = np.array([start, branch]), self._route.starter
        starter.require_continuous(self._done[-1].branch, time, state.q)
        return starter.state(time, state.q, state.v)

    def _over(self, start: float, end: float, branch: float, rows: Rows) -> Status:
        """Step over one interval."""
        method, limits, t = self._method, self._limits, start
        between_looks = method.steps_between_looks
        try:
            method.begin(start, end, branch, rows.last)
            while t < end:
                t_next, state, *inside = method.step()
                if t_next <= t:
                    raise StepError(STUCK)
                if not t_next <= end:
                    raise StepError(f"a step went to t = {t_next:g} s, {_PAST}")
                if not rows.append(t_next, state, *inside):
                    raise StepError(_STAGES)
                t = t_next
                self.steps += 1
                if t < end and (stop := limits.reason(t, self.steps, between_looks)):
                    return Status("limited", f"{stop}, stopped at t = {t:.6g} s")
        except StepError as problem:
            return Status("failed", f"stopped at t = {t:.6g} s: {problem}")
        except MemoryError:
            reason = "more memory is needed than there is; take larger steps"
            return Status("failed", f"stopped at t = {t:.6g} s: {reason}")
        except KeyboardInterrupt:
            return _interrupted(t)
        return REACHED_END


def _interrupted(t: float) -> Status:
    return Status("interrupted", f"interrupted at t = {t:.6g} s")


def _scouted(
    route: Route, scout_on: Callable[[Route], Method], of_run: _Limits
) -> tuple[Route, _Run, Trajectory, Status]:
    """The route with the amplitudes that a scout sees, and its last run.

    It goes again as long as it sees much less motion than it was tolerant of. Progress hears of it,
    so that it may end it, but of no time: the run itself has not begun.
    """
    share = None if of_run.time_limit is None else _SCOUTING_TIME * of_run.time_limit
    start, progress = route.intervals[0][0], of_run.progress
    told = None if progress is None else lambda _: progress(start)
    limits = _Limits(told, share, _MOST_SCOUTING_STEPS, of_run.begin)
    for _ in range(_MOST_SCOUTS):
        run = _Run(route, scout_on(route), limits)
        trajectory, status = run.through()
        if trajectory.end - start < _LEAST_WAY * route.duration:
            break
        seen = replace(route, amplitudes=Amplitudes.of(route.equations, trajectory))
        much_less = float(np.min(seen.scales / route.scales)) < _MUCH_LESS
        route = seen
        if not (much_less and status.success):
            break
    return route, run, trajectory, status


@single_threaded
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
    settings = asdict(integrator)  # type: ignore[call-overload]
    require_limits(integrator.method, settings)
    setup = clock.perf_counter()
    route = plan(equations, times)
    setup_time = clock.perf_counter() - setup

    begin = clock.perf_counter()
    limits = _Limits(progress, settings.get("time_limit"), settings.get("max_steps"), begin)
    status = REACHED_END
    if scout_on is not None and equations.scales is None:
        route, run, trajectory, status = _scouted(route, scout_on, limits)
    setup = clock.perf_counter()
    method = method_on(route)
    setup = clock.perf_counter() - setup
    if status.kind == "interrupted":
        status = replace(status, sentence=f"{status.sentence} {_SCOUTING}")
    else:
        run = _Run(route, method, limits)
        trajectory, status = run.through()
    wall_time = clock.perf_counter() - begin - setup
    seen = {} if route.amplitudes is None else {"amplitudes": route.amplitudes.by_part}
    return Solution(
        equations,
        trajectory,
        times[times <= trajectory.end * (1.0 + 1e-12)],
        status,
        replace(method.counts, steps=run.steps, setup_time=setup_time + setup, wall_time=wall_time),
        {"integrator": integrator.method, **settings, **method.resolved, **seen},
        made_by=integrator,
    )
