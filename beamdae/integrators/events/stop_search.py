"""Search of the accepted steps of a run for times at which they must end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.watched_terms import (
    compile_formula_forces,
    compile_surface_gaps,
    compile_table_arguments,
)
from beamdae.integrators.events.watches import ClosingWatch, Stop, Watch
from beamdae.integrators.run_plan import RunPlan
from beamdae.integrators.step_history import RunSegment

# Imported where it is created: most models have no events.
if TYPE_CHECKING:
    from beamdae.integrators.events.event_detection import EventDetector

# Number of steps between two searches, so large that they take a small part of the time.
_STEPS_PER_SEARCH = 256
# Events may end a segment; the steps beyond them are wasted.
_STEPS_PER_EVENT_SEARCH = 16


class StopSearch:
    """Watches of a run, and the rows and steps that they have searched.

    Peaks of tables and forces are searched for adaptive steps only, whose error test they evade.

    Parameters
    ----------
    equations
        Equations of all parts, active or not.
    rtol
        Tolerance of adaptive steps; None for fixed steps.

    Attributes
    ----------
    detector
        Detector of events; None if there are no events.
    longest_batch
        Largest number of steps that a method may take between two searches.
    row
        Number of rows of the segment that have been searched.
    """

    def __init__(self, equations: EquationsOfMotion, rtol: float | None) -> None:
        self._rtol = rtol
        self.detector: EventDetector | None = None
        self.longest_batch, self.row, self._steps = _STEPS_PER_SEARCH, 1, 0
        if equations.events:
            from beamdae.integrators.events.event_detection import EventDetector

            self.detector = EventDetector(equations)
            if self.detector.may_stop:
                self.longest_batch = _STEPS_PER_EVENT_SEARCH
        self._arguments = compile_table_arguments(equations)
        gaps = compile_surface_gaps(equations)
        limited = [term for term in self._arguments if term.is_limited]
        closings = ClosingWatch(gaps, limited, equations.length)
        self._of_all_parts: tuple[Watch, ...] = (closings,) if gaps or limited else ()
        self._watches: tuple[Watch, ...] = self._of_all_parts

    def adapt(self, plan: RunPlan) -> None:
        """Watch the forces of the active parts, those of the plan."""
        self._watches, self._starter = self._of_all_parts, plan.starter
        if self._rtol is not None and (terms := compile_formula_forces(plan.equations)):
            from beamdae.integrators.events.force_peaks import ForcePeakWatch

            self._watches += (ForcePeakWatch(terms, self._arguments, plan, self._rtol),)

    def begin(self, steps: int) -> None:
        """Begin a segment after this number of steps of the run."""
        self.row, self._steps = 1, steps

    @property
    def is_empty(self) -> bool:
        """True if there is nothing to search for."""
        return not (self._watches or self.detector)

    def is_due(self, steps: int) -> bool:
        """Return True if the steps must be searched after this number of steps of the run."""
        return self.detector is not None or steps >= self._steps + _STEPS_PER_SEARCH

    def find(self, segment: RunSegment, steps: int, reason: str = "") -> Stop | None:
        """Return the first stop in the rows not searched before, and truncate the segment there.

        `steps` is the number of steps of the run, which ends after the last row for a `reason`.
        """
        history = segment.history
        limit = stop = Stop(history.end, history.end, reason) if reason else None
        if history.count > self.row and not self.is_empty:
            found = [limit, *(watch.find_first(segment, self.row) for watch in self._watches)]
            stop = min((x for x in found if x is not None), default=None)
            if stop is not limit and stop is not None:
                history.truncate(stop.t, self._starter)
            # Events are recorded in the steps that remain.
            if self.detector and (event := self.detector.find_first(segment, self.row)):
                history.truncate(event.t, self._starter)
                stop = event
            self.row, self._steps = history.count, steps
        return stop

    def reason_outside_table(self, segment: RunSegment) -> str:
        """Return the reason why the present state or time is outside a table, or ""."""
        t, branch, state = segment.history.end, segment.branch, segment.history.last_state
        inactive = segment.configuration.inactive if segment.configuration else frozenset()
        arguments = (x for x in self._arguments if x.part not in inactive)
        reasons = [
            *(x.reason_to_stop(t, branch) for x in segment.ranges),
            *(x.reason_to_stop(t, branch, state) for x in arguments),
        ]
        return next(filter(None, reasons), "")
