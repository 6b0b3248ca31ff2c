"""Solution: the result of a run, with tables, files, figures and section forces."""

from __future__ import annotations

import pickle
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae import deferred
from beamdae.equations import measures
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.assembly.observables import add_observable
from beamdae.errors import (
    BeamdaeError,
    format_distinct,
    hold_messages,
    require_finite,
    require_sequence,
    short_repr,
    warnings_are_ignored,
)
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.read_only import read_only_data
from beamdae.results.displays import Animation, HasPage, Plot
from beamdae.results.outcome import tabulate_events
from beamdae.results.run_data import RunData, coordinate_headers
from beamdae.results.time_series import TimeSeries
from beamdae.results.trajectory import Instant, Trajectory
from beamdae.symbolic.statements import SX, Quantity

# Imported by the methods that need them: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

    from beamdae.results.section_forces.section_forces import SectionForces
    from beamdae.results.storage.packed_run import PackedRun

Array = np.ndarray


@read_only_data
@dataclass(frozen=True, repr=False)
class Solution(RunData, TimeSeries, HasPage):
    """Result of a run, see `simulate`.

    `solution["tip.y"]` returns one column over time, and `solution.table()` returns all columns. A
    run that ended early is also a Solution; check its `status`.

    Attributes
    ----------
    t
        Output times (k,) up to the end of the run [s].
    q, v, a
        Coordinates [m or rad], velocities and accelerations (per s and s^2) at the output times
        (k, n). `coordinates()` returns coordinates and velocities with their names and units.
    lam
        Lagrange multipliers of the constraints (joint reactions) at the output times (k, m)
        [N or N m].
    status
        Termination status ("ok", "limited", "interrupted" or "failed") and its reason.
    statistics
        Numbers of steps, evaluations and factorizations, and computing times [s].
    integrator
        Settings of the integrator, including the values selected by "auto".
    model
        Requested end time of the run [s] and, if a model function built the model, its name and
        parameters.
    equations
        The equations of motion that were integrated.
    trajectory
        All accepted steps, with dense output.
    made_by
        The integrator of the run; None for a run loaded from a file.
    event_records
        The events that occurred, in chronological order; `events` returns them as a table.
    event_signs
        State of each event at the end of the run, by name: 1 if the monitored quantity was above
        the value to be crossed, -1 if below, 0 if not known.
    resume_warnings
        Warnings about the earlier run that this run resumed; empty for other runs.
    loaded_versions
        Package versions with which a run from a file or another process was computed; empty if
        this process computed the run. `versions` contains the versions in both cases.
    derivatives
        Derivatives of the columns with respect to parameters, see `simulate`; None without them.
    """

    def __repr__(self) -> str:
        # The observables of a constrained system may have no name.
        names = dict.fromkeys(
            name
            for o in self.equations.observables
            for name in ([o.name] if o.name else (column.name for column in o.columns))
        )
        observed = f"; observed: {', '.join(names)}" if names else ""
        return (
            f"<Solution by {self.label}: {self.status.kind}, {self.status.sentence}; "
            f"t = {self.t[0]:g} to {self.trajectory.end:g} s in {len(self.t)} rows{observed}>"
        )

    def _repr_html_(self) -> str:
        return deferred.module("report.tables").summarize_as_html(self)

    @property
    def observed(self) -> pd.DataFrame:
        """Observed columns by time [s]; headers contain units."""
        import pandas as pd

        return pd.DataFrame(dict(self.columns), index=pd.Index(self.t, name=measures.TIME))

    @property
    def energies(self) -> pd.DataFrame:
        """Energies, works and energy imbalance [J] by time [s]; also columns of `table`.

        The columns are the kinetic, strain and gravitational energies, the work of the loads and of
        the drivers, the dissipated energy, and the imbalance, which is zero for an exact
        solution.
        """
        import pandas as pd

        index = pd.Index(self.t, name=measures.TIME)
        headers = list(measures.LEDGER_COLUMNS)
        return pd.DataFrame(self._ledger_rows, index, headers, copy=True)

    @property
    def drift(self) -> pd.DataFrame:
        """Largest constraint violations of the active joints, one row per output time.

        The columns are "drift.position", |g| [m or rad], and "drift.velocity", |g_dot| [m/s or
        rad/s].
        """
        import pandas as pd

        return pd.DataFrame(self.drift_columns)

    @property
    def events(self) -> pd.DataFrame:
        """Table of the events: name, direction, time, and observed columns.

        If events have impulses, the table also contains the impulses and the energy lost.
        """
        import pandas as pd

        return pd.DataFrame(
            tabulate_events(self.equations, self.event_records, self._observe_events)
        )

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the reliability of the run and the model; `simulate` issues them.

        The `model_warnings` are followed by a sentence on the `errors` of columns above 4 %, which
        are measured unless this takes more than 2 s and eight times the run.
        """
        check = deferred.module("accuracy.runs").check_errors
        return (*self.model_warnings, *check(self, self))

    @cached_property
    def model_warnings(self) -> tuple[str, ...]:
        """Those of the `warnings` that do not depend on a refined run.

        Causes in the model and the start come first, followed by the motion and the deformation, by
        missed extremes, by single forces, and by remarks. If strains are meaningless, missed
        extremes are omitted.
        """
        return tuple(chain.from_iterable(self._sentences.values()))

    @cached_property
    def errors(self) -> Any:
        """Errors of the observed columns, see `Errors`, measured by a run that is refined."""
        return deferred.module("accuracy.runs").measure_run(self)

    @property
    def row_warnings(self) -> tuple[str, ...]:
        """Those of the `warnings` about peaks and vibrations that the output rows do not show."""
        of_rows = deferred.module("model_checks.run_checks").ROW_CHECKS
        return tuple(chain.from_iterable(self._sentences[check] for check in of_rows))

    @cached_property
    def _sentences(self) -> dict[Any, tuple[str, ...]]:
        # Checks search equilibria, whose messages are not about the run.
        with single_threaded, hold_messages():
            checks = deferred.module("model_checks.run_checks").RUN_CHECKS
            return {check: tuple(check(self)) for check in checks}

    def coordinate_columns(self) -> dict[str, Array]:
        """Return the columns (k,) of `coordinates` by header."""
        rows = np.hstack([self.t[:, None], self.q, self.v, self.lam])
        return dict(zip(coordinate_headers(self.equations), rows.T, strict=True))

    def observe(
        self, name: str, what: Attachment | Quantity | SX, unit: str | None = None
    ) -> Solution:
        """Return the solution with an additional observable, without integrating again.

        Parameters
        ----------
        name, what, unit
            See `Mechanism.observe`.

        Raises
        ------
        BeamdaeError
            If the name or the unit is invalid, a column of this name exists, `what` does not belong
            to the mechanism, or the solution has no mechanism.
        """
        return replace(self, equations=add_observable(self.equations, name, what, unit))

    def sensitivity(self, column: str, parameter: str) -> pd.Series:
        """Return the derivative of a column with respect to a parameter, over time.

        The run must have been computed by `simulate(..., sensitivities=[...])`.

        Parameters
        ----------
        column
            Header of an observed column, coordinate, velocity or multiplier, with or without its
            unit, as in `solution["tip.y"]`.
        parameter
            Name of the parameter.

        Returns
        -------
        pandas.Series
            Derivative (k,) in the unit of the column per unit of the parameter, indexed by time
            [s].

        Raises
        ------
        BeamdaeError
            If the run has no derivatives with respect to the parameter, or the name selects no
            column or several columns.
        """
        from beamdae.results.column_derivatives import require_derivatives

        return require_derivatives(self.derivatives).sensitivity(column, parameter)

    def at(self, t: float) -> Instant:
        """Return the state at a time within the run, interpolated by the dense output.

        The state can be passed to `modes` and `linearize`.

        Parameters
        ----------
        t
            Time [s].

        Raises
        ------
        BeamdaeError
            If the time is not a finite number or lies outside the run.
        """
        instant = Instant.of(self.trajectory, t)
        has_pending_event = any(not record.done for record in self.event_records)
        if t < self.trajectory.end or not self.status.is_unreliable(has_pending_event):
            return instant
        return instant._replace(doubt=self.status.sentence)

    def at_times(self, times: Array) -> Solution:
        """Return the solution with other output times.

        Parameters
        ----------
        times
            Ascending times within the run (k,) [s].

        Raises
        ------
        BeamdaeError
            If `times` is empty, the times are not numbers, do not ascend or lie outside the run, or
            a run from a file has derivatives and no row at one of the times.
        """
        numbers = require_sequence("at_times", "times", times, "a list of times [s]")
        t = np.array([require_finite("at_times", "times", number) for number in numbers])
        first, end = self.trajectory.start, self.trajectory.end
        if not len(t) or np.any(np.diff(t) <= 0.0) or t[0] < first or t[-1] > end:
            raise BeamdaeError(
                "at_times: times must be a nonempty ascending list within the run, "
                f"{first:.12g} to {end:.12g} s, got {short_repr(times)}."
            )
        self.trajectory.warn_between_rows("at_times", t)
        return replace(self, t=t, derivatives=self.derivatives and self.derivatives.at_times(t))

    def animate(
        self,
        path: str | Path | None = None,
        speed: float = 1.0,
        frames: int | None = None,
        color: str | None = None,
        trail: Any = False,
        scale: float | None = None,
    ) -> Animation | Path:
        """Animate a run in a notebook or in a file.

        Bodies, joints, guides, springs, dampers, contacts and loads are drawn as in
        `Mechanism.draw`. The length of a load arrow is proportional to the load, relative to the
        largest value in the frames.

        Parameters
        ----------
        path
            Path of a file with the suffix .gif or .mp4; MP4 requires the program ffmpeg. Without a
            path, the animation is displayed in a notebook.
        speed
            Playback speed relative to real time.
        frames
            Number of frames, 2 to 500. Defaults to 25 per second of the animation, within these
            limits.
        color
            Quantity that colors the beams: "strain" or "stress" (largest magnitude in each
            section), or the section force "N", "Q" or "M". The color scale covers the whole run.
        trail
            True to show the trails of all observed points, or the names of the points to trace.
        scale
            Factor of the displacements from the first frame. Defaults to 1 if the largest
            displacement exceeds 1 % of the size of the mechanism or the mechanism contains
            contacts, whose gaps are not enlarged. Otherwise, it defaults to a factor that makes the
            motion visible while no section of a beam is drawn rotated by more than 0.3 rad and no
            rigid body by more than 0.1 rad from the first frame, or to 1 if there is none. The
            animation shows factors other than 1.

        Returns
        -------
        Animation or Path
            Animation for a notebook, or the path of the file.

        Raises
        ------
        BeamdaeError
            If an argument is invalid, the run has no mechanism, the color quantity or a traced
            point does not exist, ffmpeg is required but missing, or the file cannot be written.
        """
        return deferred.module("report.pictures.animations").animate(
            self, path, speed, frames, color, trail, scale
        )

    @interruptible
    def section_forces(self, beam: Any, t: Any = None, s: Any = None) -> SectionForces:
        """Return axial force, shear force and bending moment along a beam.

        Parameters
        ----------
        beam
            The beam, or its name.
        t
            A time or ascending times within the run [s]. Defaults to the output times.
        s
            An arc length or several arc lengths [m]. Defaults to the element boundaries, the
            sections at which concentrated loads are fixed, and three sections between neighbors.
            Loads, and jumps of the cross-section or curvature, have sections on both sides. If the
            cross-section varies, its kinks and further sections are added, between which stresses
            are at most 0.2 % larger. Given sections are those just beyond a load or a jump, except
            at the end of the beam.

        Raises
        ------
        BeamdaeError
            If the mechanism does not contain the beam, the times do not ascend, or a time or an arc
            length is out of range.
        Interrupted
            If Ctrl-C ends the call.
        """
        from beamdae.results.section_forces.recovery import recover_section_forces

        def find_companion() -> Solution | None:
            companion: Solution | None = deferred.module("accuracy.runs").find_companion(self)
            return companion

        return recover_section_forces(self, beam, t, s, find_companion)

    def diagram(self, beam: Any, what: str = "M", t: Any = None) -> Plot:
        """Plot a section force of a beam over its arc length.

        Parameters
        ----------
        beam
            The beam, or its name.
        what
            The section force: "N", "Q" or "M".
        t
            A time [s], or ascending times for an envelope. Defaults to the envelope over the output
            times.

        Raises
        ------
        BeamdaeError
            If the mechanism does not contain the beam, `what` is invalid, the times do not ascend,
            or a time lies outside the run.
        """
        return self.section_forces(beam, t).diagram(what)

    def metadata(self, **further: Any) -> dict[str, Any]:
        """Return the metadata of the run for `to_csv`; `further` adds or replaces entries."""
        # Files repeat no run whose warnings nobody sees.
        is_checked = "warnings" in vars(self) or not warnings_are_ignored()
        return {
            "status": self.status.kind,
            "reason": self.status.sentence,
            "model": self.model,
            "integrator": self.integrator,
            "result": self.summary(),
            "start": {
                "asked": self.start.request,
                "changed by the joints": [asdict(change) for change in self.start.changes],
            },
            "singular positions": [asdict(position) for position in self.singular_positions],
            "events": [record.as_dict() for record in self.event_records],
            "warnings": list(self.warnings if is_checked else self.model_warnings),
            "equations": self._provenance,
            "versions": self.versions,
            **further,
        }

    @cached_property
    def _provenance(self) -> dict[str, Any]:
        # Imported here, because few runs are stored.
        from beamdae.results.provenance import describe_provenance

        return describe_provenance(self.equations)

    def save(self, path: str | Path) -> Path:
        """Write all data of the run to one file and return the path; `load` reads the file.

        The file is a zip archive of NumPy arrays and JSON. Loading the file does not execute code.
        `simulate(..., start=path)` resumes from the last state of the run.

        Parameters
        ----------
        path
            Path of the file, with any suffix. An existing file is replaced.

        Raises
        ------
        BeamdaeError
            If the file cannot be written.
        """
        written: Path = deferred.module("results.storage.saved_run").save_run(self, path)
        return written

    def followed_by(self, later: Solution) -> Solution:
        """Return this run and a later run that resumed from the end of this run as one solution.

        Integrator, model and status are taken from the later run. If the later run succeeded but
        this run failed, the combined status is "failed", unless this run failed while executing an
        event. Costs are added.

        Parameters
        ----------
        later
            Solution of `simulate(..., start=self)`.

        Raises
        ------
        BeamdaeError
            If `later` is not a solution or does not start at the end time of this run, or the
            coordinates or numerical values of the models differ.
        """
        if not isinstance(later, Solution):
            raise BeamdaeError(f"followed_by: later must be a solution, got {short_repr(later)}.")
        end, start = self.trajectory.end, float(later.t[0])
        if end != start:
            begins, ends = format_distinct(start, end)
            raise BeamdaeError(
                f"followed_by: the later run begins at t = {begins} s, but this run ends at "
                f"{ends} s; simulate the later run with start= set to this solution."
            )
        one, other = self.equations, later.equations
        if one.q_names != other.q_names or not np.array_equal(one.p, other.p):
            raise BeamdaeError(
                "followed_by: the runs have different models or parameters; join only "
                "runs of the same model."
            )
        costs = {
            cost.name: getattr(self.statistics, cost.name) + getattr(later.statistics, cost.name)
            for cost in fields(self.statistics)
        }
        # Events that this run did not execute are recorded by the later run.
        executed = tuple(record for record in self.event_records if record.done)
        has_pending_event = len(executed) < len(self.event_records)
        intervals = (*self.trajectory.intervals, *later.trajectory.intervals)
        return replace(
            later,
            status=self.status.followed_by(later.status, has_pending_event),
            equations=one,
            trajectory=Trajectory(intervals),
            t=np.concatenate([self.t, later.t[1:]]),
            statistics=replace(later.statistics, **costs),
            event_records=(*executed, *later.event_records),
        )

    def __reduce__(self) -> Any:
        mechanism = self.equations.mechanism
        if mechanism is None:
            raise BeamdaeError(
                "Solution: a solution without a mechanism cannot be pickled; save it with "
                "solution.save(path), and call bd.load(path, model) in the other process."
            )
        from beamdae.results.storage.packed_run import pack_run
        from beamdae.symbolic.signal_pickling import pickle_with_signals

        return _unpickle, (pickle_with_signals((mechanism, self.made_by)), pack_run(self))


def _unpickle(source: bytes, packed: PackedRun) -> Solution:
    from beamdae.results.storage.packed_run import unpack_fields

    # CasADi expressions cannot be pickled, so the equations are assembled again.
    mechanism, made_by = pickle.loads(source)
    return Solution(*unpack_fields(equations_of_motion(mechanism, AS_DRAWN), packed, made_by))
