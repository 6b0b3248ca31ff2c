"""Driver shared by all integrators: intervals, restarts, limits, events and the solution.

Methods only take steps. `drive` plans the smooth intervals, makes pilot runs if the method needs
amplitudes, restarts at breakpoints and events, enforces limits and collects the accepted steps.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from typing import cast

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm
from beamdae.equations.formulations.first_order import State
from beamdae.equations.smooth_intervals import SAME_TIME, branch_time
from beamdae.errors import BeamdaeError, ProgressError, list_first
from beamdae.integrators.events.stop_search import StopSearch
from beamdae.integrators.events.switching import (
    MethodCache,
    StallCheck,
    apply_event,
    initial_configuration,
)
from beamdae.integrators.events.watches import Stop
from beamdae.integrators.integrator import (
    PROBE_SHARE,
    STEPS_PER_CHECK,
    Integrator,
    Method,
    ResumableMethod,
    StepError,
    require_limits,
    take_steps,
)
from beamdae.integrators.limits import (
    PaceCheck,
    Progress,
    RunLimits,
    followed_vibration,
)
from beamdae.integrators.pilot_run import PILOT_LABEL, adopt_amplitudes, run_pilot
from beamdae.integrators.reaction_balance import (
    balance_reactions,
    remove_redundant,
    restore_reactions,
)
from beamdae.integrators.run_plan import RunPlan, plan_run
from beamdae.integrators.sampling import RepeatedSample, Sampler
from beamdae.integrators.step_history import (
    OutOfMemoryError,
    RunSegment,
    StepHistory,
    StepThinning,
)
from beamdae.interrupts import Interrupted, acknowledge, attach_partial, raise_pending
from beamdae.linear.blas_threads import single_threaded
from beamdae.results.outcome import REACHED_END, Status
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory

Array = np.ndarray


_NO_MEMORY = "out of memory; use longer steps, fewer elements or an earlier end time"
_NOT_FINITE = "the state is not finite; check laws, masses and start values"


def drive(
    integrator: Integrator,
    equations: EquationsOfMotion,
    times: Array,
    progress: Progress | None,
) -> Solution:
    """Run a method over all smooth intervals and return the solution.

    Parameters
    ----------
    integrator
        Settings, a dataclass; its optional fields `max_steps` and `time_limit` limit the run. Its
        `method_on` creates the method for a plan, compiles its step loop and resolves settings that
        are "auto". There are pilot runs of its `pilot`, which measure the amplitudes of the motion,
        unless the equations define their scales.
    equations
        Equations of motion. Redundant constraints are removed first if the model requests it, and
        their reactions are restored in the solution.
    times
        Ascending output times [s]; the run covers the range from the first to the last.
    progress
        Function called with the time reached [s]; see `Integrator.integrate`.

    Raises
    ------
    BeamdaeError
        If the run cannot begin, for example because the model has no consistent start.
    Interrupted
        If the run is interrupted; with the solution as partial result.
    Exception
        Any exception of `progress`, with the solution as the attribute `partial`.
    """
    solution = None
    try:
        # NumPy's warnings would be redundant: a state that is not finite ends the run.
        with single_threaded, np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            reduced = remove_redundant(equations, float(times[0]))
            independent = equations if reduced is None else reduced.equations
            solution = _drive(integrator, independent, times, progress)
            solution = balance_reactions(solution)
            if reduced is not None:
                solution = restore_reactions(solution, reduced)
    except KeyboardInterrupt:
        if solution is None:
            raise
        acknowledge()
        sentence = f"interrupted at t = {solution.trajectory.end:.6g} s, after the last step"
        solution = replace(solution, status=Status("interrupted", sentence))
    if solution.status.kind == "interrupted":
        raise Interrupted(solution.status.sentence, solution)
    return solution


def _drive(
    integrator: Integrator, equations: EquationsOfMotion, times: Array, progress: Progress | None
) -> Solution:
    settings = asdict(integrator)  # type: ignore[call-overload]
    require_limits(integrator)
    planning_began = clock.perf_counter()
    first = initial_configuration(equations)
    rtol = float(settings["rtol"]) if integrator.accuracy.name == "rtol" else None
    plan = plan_run(equations if first is None else first.equations, times, rtol is not None)
    step = integrator.accuracy.value if rtol is None else None
    plan.require_feasible_steps(integrator.method, step, settings.get("max_step"))
    planning_time = clock.perf_counter() - planning_began

    run_began = clock.perf_counter()
    limits = RunLimits(progress, settings.get("time_limit"), settings.get("max_steps"), run_began)
    run: _RunInProgress | None = None
    problem, compile_time = None, 0.0
    samples: list[RepeatedSample] = []

    def execute(
        of: Integrator, label: str, plan: RunPlan, limits: RunLimits
    ) -> tuple[Trajectory, Status]:
        """Execute a run, which repeats and extends samples; a `label` is that of a pilot run."""
        nonlocal run, compile_time
        began = clock.perf_counter()
        run = _RunInProgress(equations, plan, of.method_on, limits, times, rtol, samples, label)
        preparation = clock.perf_counter() - began
        compile_time += preparation
        if label:
            # Without the time to compile, or the amplitudes would depend on the state of the cache.
            limits.begin += preparation
        return run.execute()

    try:
        if integrator.pilot is not None and equations.scales is None:
            plan = adopt_amplitudes(plan)
            if plan.amplitudes is None:
                plan = run_pilot(plan, partial(execute, integrator.pilot, PILOT_LABEL), limits)
        if rtol is not None and limits.max_steps is None:
            interval = plan.intervals[0][0], plan.intervals[-1][1]
            limits.pace_check = PaceCheck(*interval)
        followed_vibration.set("")
        trajectory, status = execute(integrator, "", plan, limits)
    except KeyboardInterrupt:
        if run is None:
            raise
        acknowledge()
        trajectory, status = run.finish(run.interruption())
    except ProgressError as error:
        assert run is not None
        problem = error.problem
        trajectory, status = run.finish(run.failure(error))
    assert run is not None
    wall_time = clock.perf_counter() - run_began - compile_time
    peaks = [f"{name} at t = {t:.4g} s" for name, t in run.force_peaks.items()]
    amplitudes = {} if plan.amplitudes is None else {"amplitudes": plan.amplitudes.by_part}
    if status.kind in ("failed", "limited"):
        # Imported by runs that stop early.
        from beamdae.integrators.stop_causes import name_cause

        end = float(times[-1])
        status = name_cause(status, equations, trajectory, samples, end, integrator)
    output_times = times[times <= trajectory.end * (1.0 + SAME_TIME)]
    if trajectory.end > output_times[-1] * (1.0 + SAME_TIME):
        output_times = np.append(output_times, trajectory.end)
    solution = Solution(
        equations,
        trajectory,
        output_times,
        status,
        replace(
            run.methods.counts,
            steps=run.steps,
            setup_time=planning_time + compile_time,
            wall_time=wall_time,
        ),
        {
            "integrator": integrator.method,
            **settings,
            **run.methods.first.resolved_options,
            **run.thinning.report,
            **amplitudes,
            **({"restarted_at": list_first(peaks)} if peaks else {}),
        },
        made_by=integrator,
        event_records=() if run.detector is None else tuple(run.detector.records),
        event_signs={} if run.detector is None else run.detector.signs,
    )
    if problem is not None:
        attach_partial(problem, solution)
        raise problem
    return solution


class _RunInProgress:
    """Run in progress; the steps stored so far remain valid if it is interrupted."""

    def __init__(
        self,
        equations: EquationsOfMotion,
        plan: RunPlan,
        method_on: Callable[[RunPlan], Method],
        limits: RunLimits,
        times: Array,
        rtol: float | None,
        samples: list[RepeatedSample],
        label: str,
    ) -> None:
        """Prepare a run.

        Parameters
        ----------
        equations
            Equations with all parts, active or not.
        plan, method_on, limits
            Plan, function that creates methods, and limits of this run.
        times
            Times [s] of rows that are stored even if the run is too long to store all steps.
        rtol
            Tolerance of adaptive steps; None for fixed steps.
        samples
            Samples of controllers in earlier runs, which this run repeats and extends.
        label
            Appended to the message of an interrupted run.
        """
        self._equations, self._samples = equations, samples
        self._plan, self._limits, self._label = plan, limits, label
        self._configuration = initial_configuration(equations)
        self.methods = MethodCache(method_on, plan, self._configuration)
        self.method, self._stall_check = self.methods.first, StallCheck(plan.duration)
        if limits.pace_check is not None:
            limits.pace_check.relative_limit = self.method.steps_per_check / STEPS_PER_CHECK
        self._search = StopSearch(equations, rtol)
        self.detector = self._search.detector
        self._sampler = Sampler(equations.with_loads_of(self._configuration), samples)
        self._adapt_to_active_parts()
        self.steps = 0
        # Time [s] of the first peak of each force that steps passed over at first, by its part.
        self.force_peaks: dict[str, float] = {}
        # Ends of the unfinished intervals; events may add more.
        self._interval_ends = tuple(end for _, end in plan.intervals)
        self._segments: list[RunSegment] = []
        self.thinning = StepThinning(times)
        start, end = plan.intervals[0]
        self._begin_segment(start, branch_time(start, end), plan.state)

    def _adapt_to_active_parts(self) -> None:
        """Watch the active parts; controllers read zero for the loads of inactive ones."""
        self._search.adapt(self._plan)
        equations = self._equations.with_loads_of(self._configuration)
        if equations is not self._sampler.equations:
            self._sampler = Sampler(equations, self._samples)

    @property
    def _history(self) -> StepHistory:
        return self._segments[-1].history

    @property
    def _time(self) -> Array:
        """Present (t, branch)."""
        return np.array([self._history.end, self._segments[-1].branch])

    def _begin_segment(self, t: float, branch: float, state: State) -> None:
        configuration = self._configuration
        active = self._equations if configuration is None else configuration.equations
        if self._segments:
            self._history.close()
        history = StepHistory(t, state)
        self._segments.append(RunSegment(history, branch, configuration, active, self._equations.m))
        self._search.begin(self.steps)

    def execute(self) -> tuple[Trajectory, Status]:
        """Integrate to the end or an early stop; return the steps taken and the status."""
        status = self._integrate()
        try:
            # Laws that return other values for an earlier sample have a memory.
            for sample in self._samples if status.kind != "failed" else ():
                sample.repeat()
        except BeamdaeError as problem:
            status = self.failure(problem)
        return self.finish(status)

    def interruption(self) -> Status:
        """Return the status of a run that Ctrl-C ends."""
        return Status("interrupted", f"interrupted at t = {self._history.end:.6g} s{self._label}")

    def failure(self, reason: object) -> Status:
        """Return the status of a run that fails."""
        return Status("failed", self._stopped(reason))

    def finish(self, status: Status) -> tuple[Trajectory, Status]:
        """Return the steps taken, and the status."""
        if not self._history.drop_nonfinite():
            status = self.failure(_NOT_FINITE)
        self.thinning.finish(self._segments)
        return self._trajectory(), status

    def _trajectory(self) -> Trajectory:
        return Trajectory(tuple(segment.interval() for segment in self._segments))

    def _stopped(self, reason: object) -> str:
        return f"stopped at t = {self._history.end:.6g} s: {reason}"

    def _integrate(self) -> Status:
        """Integrate all intervals, restart at their ends, and act at stops; return the status."""
        stop: Stop | None = None
        if self.detector and (due := self.detector.find_due_event(self._segments[0])):
            stop = Stop(self._history.end, self._history.end, event=due)
        if self._sampler.controllers:
            self._interval_ends = (self._history.end, *self._interval_ends)
            stop = self._begin_next_interval() or stop
        while True:
            try:
                if stop and stop.reason:
                    return Status("limited", self._stopped(stop.reason))
                if stop and stop.event:
                    if stop.event.do == "stop":
                        at = f"at t = {self._history.end:.6g} s"
                        return Status("ok", f"stopped by event {stop.event.name} {at}")
                    stop = self._switch_parts(stop.event)
                elif self._history.end < self._interval_ends[0]:
                    stop = self._integrate_to(self._interval_ends[0])
                elif len(self._interval_ends) == 1 or not self._history.is_finite:
                    return REACHED_END
                else:
                    stop = self._begin_next_interval()
            except (StepError, BeamdaeError) as problem:
                # Before the first step there is nothing to return; later, the steps taken are kept.
                if isinstance(problem, BeamdaeError) and self.steps == 0:
                    raise
                # What steps have passed over precedes the failure.
                stop = self._find_stop()
                if stop is not None:
                    continue
                sentence = str(problem)
                if isinstance(problem, StepError):
                    # With the causes that the state shows.
                    from beamdae.integrators.stop_causes import diagnose_failure

                    t, state = self._history.end, self._history.last_state
                    ahead = t + PROBE_SHARE * (self._interval_ends[0] - t)
                    causes = diagnose_failure(
                        self._plan.equations, self._time, state, ahead, problem.step
                    )
                    sentence = "; ".join(filter(None, (sentence, causes)))
                return self.failure(sentence)
            except MemoryError as problem:
                reason = problem if isinstance(problem, OutOfMemoryError) else _NO_MEMORY
                return Status("limited", self._stopped(reason))

    def _begin_next_interval(self) -> Stop | None:
        """Continue after the end of an interval; return a stop that the last steps passed over."""
        start, end, *ends = self._interval_ends
        following = self._sampler.next_stop(start, end)
        self._interval_ends = (following, *([end] if following < end else []), *ends)
        branch = branch_time(start, following)
        # Measured before the jump of laws.
        state = self._sampler.sample(start, branch, self._history.last_state)
        # An event at the time of the sample has begun a segment of one row: the method has not.
        resumed = None
        if hasattr(self.method, "resume") and self._history.count > 1 and self._is_sample(start):
            resumed = cast("ResumableMethod", self.method).resume(start, following, state.q)
        if resumed is not None:
            self._history.append_jump(resumed)
        elif stop := self._find_stop():
            return stop
        else:
            time, starter = np.array([start, branch]), self._plan.starter
            if self._is_sample(start):  # Only held values have changed.
                state = starter.complete(time, state.q, state.v)
            else:
                starter.require_continuous(self._segments[-1].branch, time, state.q)
                state = starter.state(time, state.q, state.v)
            if self.steps == 0:
                self._segments.clear()
            self._begin_segment(start, branch, state)
        return None

    def _is_sample(self, t: float) -> bool:
        """Return True if only held values change at the end of an interval at `t` [s]."""
        return bool(self._sampler.controllers) and t not in self._equations.breakpoints

    def _integrate_to(self, end: float) -> Stop | None:
        """Take steps until `end` [s], or until something stops them; return the stop."""
        segment, method, limits = self._segments[-1], self.method, self._limits
        history, steps_per_check = segment.history, method.steps_per_check
        if reason := self._search.reason_outside_table(segment):
            return self._find_stop(reason)
        # Otherwise, the method continues after a sample.
        if history.count == 1:
            method.begin(history.end, end, segment.branch, history.last_state)
        # Between frequent samples of controllers, searches at their times would cost more than the
        # steps. Events are detected between samples, not across them.
        is_sample = len(self._interval_ends) > 1 and self._is_sample(end)
        stop: Stop | None = None
        while history.end < end and stop is None:
            raise_pending()
            most = limits.steps_until_check(self.steps, steps_per_check)
            self.steps += take_steps(method, history, min(most, self._search.longest_batch), end)
            if self._search.is_due(self.steps) or (history.end >= end and not is_sample):
                stop = self._find_stop()
            history.release(history.count if self._search.is_empty else self._search.row)
            self.thinning.enforce(self._segments)
            # Between samples, an interval may consist of one step: its end is checked, too.
            if (stop is None or stop.is_restart) and history.end < self._interval_ends[-1]:
                reason = limits.stop_reason(history.end, self.steps, steps_per_check)
                if reason or (reason := self._reason_not_to_continue()):
                    stop = self._find_stop(reason)
        return stop

    def _reason_not_to_continue(self) -> str:
        """Return the reason to stop a long run, or "", see `describe_hopeless_motion`."""
        check, history = self._limits.pace_check, self._history
        if check is None or not check.is_due(history.end, self.steps):
            return ""
        from beamdae.integrators import stop_causes

        reason = ""
        # No rows can be added after thinned ones have been joined.
        if history.is_finite and not self.thinning.report:
            reason = stop_causes.describe_hopeless_motion(
                check, self._equations, self._trajectory()
            )
        if reason or not check.is_stalled:
            return reason
        return check.describe_stall(
            stop_causes.describe_singular_position(
                self._plan.equations, self._time, history.last_state
            )
        )

    def _find_stop(self, reason: str = "") -> Stop | None:
        """Drop the steps after the first stop in the rows not searched before; return the stop.

        Without an earlier one, the run ends after the last row for this `reason`. Where it
        restarts, it restarts again inside the contact or peak, where the error test sees it.
        Samples of controllers after a stop are taken again.
        """
        stop = self._search.find(self._segments[-1], self.steps, reason)
        if stop and stop.force:
            self.force_peaks.setdefault(stop.force, stop.probe)
        if stop and stop.is_restart:
            ends = {self._history.end, stop.probe, *self._interval_ends}
            self._interval_ends = tuple(sorted(ends))
        return stop

    def _switch_parts(self, event: EventTerm) -> Stop | None:
        """Apply the actions of an event; return the next stop at the same time."""
        detector, t = self.detector, self._history.end
        assert detector is not None
        assert self._configuration is not None
        try:
            result = apply_event(
                self._equations,
                self._configuration,
                self._plan,
                event,
                self._time,
                self._interval_ends,
                self._history.last_state,
            )
            self._configuration, self._plan = result.configuration, result.plan
            self._interval_ends = result.ends
            self.method = self.methods.get(result.plan, result.configuration)
            self._adapt_to_active_parts()
        except BeamdaeError as problem:
            raise BeamdaeError(f"event {event.name}: {problem}") from problem
        self._begin_segment(t, result.branch, result.state)
        detector.record_switch(self._segments[-1], result.impulses, result.energy_lost)
        if stall := self._stall_check.reason(event, t, result.impulses):
            return Stop(t, t, stall)
        following = detector.next_simultaneous_event(self._segments[-1])
        return Stop(t, t, event=following) if following else None
