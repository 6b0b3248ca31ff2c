"""The result of a run: tables, files, figures, section forces."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations import measures
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.assembly.building import add_observable
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, require_finite, require_sequence, short_repr
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.results.displays import Animation, Plot, load_views
from beamdae.results.event_records import tabulate_events
from beamdae.results.run_data import RunData
from beamdae.results.section_forces.recovery import recover_section_forces
from beamdae.results.section_forces.section_forces import SectionForces
from beamdae.results.storage.checkpoint import Checkpoint
from beamdae.results.storage.files import write_result
from beamdae.results.storage.packed_run import PackedRun, pack_run, unpack_fields
from beamdae.results.storage.saved_run import save_run
from beamdae.results.time_series import TimeSeries
from beamdae.results.trajectory import Instant, Trajectory
from beamdae.symbolic.statements import Quantity

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray


@dataclass(frozen=True, repr=False)
class Solution(RunData, TimeSeries):
    """Result of a run, see `simulate`.

    `solution["tip.y"]` returns a column over time, `solution.table()` all of them. A run that did
    not reach its end is a Solution as well; see `status`.

    Attributes
    ----------
    t
        Output times that the run reached (k,) [s].
    q, v, a
        Coordinates, velocities and accelerations at the output times (k, n), in the units of the
        coordinates and their rates; `coordinates()` names them.
    lam
        Lagrange multipliers of the constraints at the output times (k, m), the reactions of the
        joints.
    status
        How the run ended: its kind ("ok", "limited", "interrupted" or "failed") and the reason.
    statistics
        Numbers of steps, evaluations and factorizations, and times [s].
    integrator
        Settings of the integrator, with the values that "auto" resolved to.
    model
        Name, parameters and end time of the model.
    equations
        The equations of motion that were integrated.
    trajectory
        All accepted steps, with dense output.
    made_by
        The integrator that was used.
    event_records
        The events that occurred, in order of time; `events` is their table.
    event_signs
        Side of its value on which the quantity of each event was at the end: 1, -1, or 0 if this is
        not known.
    resume_warnings
        Warnings about the run from whose end this one resumed.
    """

    def __repr__(self) -> str:
        names = dict.fromkeys(o.name for o in self.equations.observables)
        observed = f"; observed: {', '.join(names)}" if names else ""
        return (
            f"<Solution by {self.label}: {self.status.kind}, {self.status.sentence}; "
            f"t = {self.t[0]:g} to {self.trajectory.end:g} s in {len(self.t)} rows{observed}>"
        )

    def _repr_html_(self) -> str:
        return load_views().summarize_as_html(self)

    @cached_property
    def observed(self) -> pd.DataFrame:
        """Observed columns at the output times, one row per time; headers carry units."""
        import pandas as pd

        return pd.DataFrame(self.columns, index=range(len(self.t)))

    @cached_property
    def ledger(self) -> pd.DataFrame:
        """Energies, works and the energy imbalance at the output times [J].

        The columns are the kinetic, strain and gravitational energy, the works of the loads and of
        the drivers, the dissipated energy, and the imbalance, which is zero in an exact solution.
        """
        import pandas as pd

        rows = self._energy_ledger.at(self.t)
        return pd.DataFrame(rows, columns=list(measures.LEDGER_COLUMNS))

    @cached_property
    def drift(self) -> pd.DataFrame:
        """Largest constraint violations |g| and |g_dot| over the joints at the output times."""
        import pandas as pd

        return pd.DataFrame(self.drift_columns)

    @property
    def events(self) -> pd.DataFrame:
        """Events that occurred, one row each: name, direction, time, and the observed columns."""
        import pandas as pd

        return pd.DataFrame(tabulate_events(self.equations, self.event_records))

    def coordinates(self) -> pd.DataFrame:
        """Return time, coordinates, velocities and multipliers, named by part, with units."""
        import pandas as pd

        headers, rows = self.coordinate_table()
        return pd.DataFrame(rows, columns=headers)

    def observe(self, name: str, what: Attachment | Quantity) -> Solution:
        """Return the solution with one more observable, without integrating again.

        Parameters
        ----------
        name, what
            As for `Mechanism.observe`.

        Raises
        ------
        BeamdaeError
            If the name is taken, the quantity does not belong to the mechanism, or the run is not
            that of a mechanism.
        """
        return replace(self, equations=add_observable(self.equations, name, what))

    def at(self, t: float) -> Instant:
        """Return the state at a time of the run [s], also between output times.

        It can be passed to `modes` and `linearize`.

        Raises
        ------
        BeamdaeError
            If the time is outside the run.
        """
        return Instant.of(self.trajectory, t)

    def at_times(self, times: Array) -> Solution:
        """Return the solution with other output times.

        Parameters
        ----------
        times
            Ascending times within the run (k,) [s].

        Raises
        ------
        BeamdaeError
            If the times do not ascend or are outside the run.
        """
        numbers = require_sequence("at_times", "times", times, "a list of times [s]")
        t = np.array([require_finite("at_times", "times", number) for number in numbers])
        first, end = self.trajectory.start, self.trajectory.end
        if not len(t) or np.any(np.diff(t) <= 0.0) or t[0] < first or t[-1] > end:
            raise BeamdaeError(
                f"at_times: times must ascend within the run, {first:g} to {end:g} s, "
                f"got {short_repr(times)}."
            )
        return replace(self, t=t)

    def animate(
        self,
        path: str | Path | None = None,
        speed: float = 1.0,
        frames: int | None = None,
        color: str | None = None,
        trail: Any = False,
    ) -> Animation | Path:
        """Animate the motion, for a notebook or as a file; see `beamdae.animate`."""
        return load_views().animate(self, path, speed, frames, color, trail)

    def section_forces(self, beam: Any, t: Any = None, s: Any = None) -> SectionForces:
        """Return normal force, shear force and bending moment of a beam.

        Parameters
        ----------
        beam
            The beam, or its name.
        t
            One time or several ascending times of the run [s]; default the output times.
        s
            One arc length or several [m]; default the element boundaries and the sections at which
            forces act, with three sections in between.

        Raises
        ------
        BeamdaeError
            If the mechanism has no such beam, or a time or an arc length is out of range.
        """
        return recover_section_forces(self, beam, t, s)

    def diagram(self, beam: Any, what: str = "M", t: Any = None) -> Plot:
        """Draw the section force "N", "Q" or "M" of a beam over its arc length.

        Parameters
        ----------
        beam
            The beam, or its name.
        what
            The section force.
        t
            One time [s], or several for the envelope; default the envelope over the output times.
        """
        return recover_section_forces(self, beam, t).diagram(what)

    def to_csv(self, path: str | Path, **further: Any) -> Path:
        """Write the table as CSV, and settings, versions and statistics as JSON of the same name.

        If the run did not reach its end, the CSV has a last column "status" with "failed",
        "limited" or "interrupted" in each row. The JSON begins with "status" and "reason". Each
        file is replaced at once. Headers that a spreadsheet would read as formulas get an
        apostrophe in front.

        Parameters
        ----------
        path
            Path of the CSV file.
        further
            Additional entries of the JSON file.

        Returns
        -------
        Path
            The path of the CSV file.

        Raises
        ------
        BeamdaeError
            If a file cannot be written.
        """
        return write_result(path, self.all_columns(), self.status, self.metadata(**further))

    def save(self, path: str | Path) -> Path:
        """Write all data of the run to one file, see `load`; return the path.

        The file is a zip archive of NumPy arrays and JSON. Loading it executes no code.

        Raises
        ------
        BeamdaeError
            If the file cannot be written.
        """
        return save_run(self, path)

    def checkpoint(self, path: str | Path) -> Path:
        """Write the last state as JSON, from which `simulate(..., start=path)` resumes.

        Raises
        ------
        BeamdaeError
            If the file cannot be written.
        """
        return Checkpoint.of(self).write(path)

    def followed_by(self, later: Solution) -> Solution:
        """Join this run and one that resumed from its end.

        Integrator, model and status are those of the later run. If this run failed, the status is
        "failed".

        Raises
        ------
        BeamdaeError
            If the later run does not start at the end of this one, or its model has other
            coordinates or parameters.
        """
        if not isinstance(later, Solution):
            raise BeamdaeError(f"followed_by: later must be a solution, got {short_repr(later)}.")
        end, start = self.trajectory.end, float(later.t[0])
        if end != start:
            raise BeamdaeError(
                f"followed_by: the later run begins at t = {start:g} s, but this one ends at "
                f"{end:g} s; simulate it with start= this run."
            )
        one, other = self.equations, later.equations
        if one.q_names != other.q_names or not np.array_equal(one.p, other.p):
            raise BeamdaeError(
                "followed_by: the runs have different models or parameters; join runs of the same "
                "model."
            )
        costs = {
            cost.name: getattr(self.statistics, cost.name) + getattr(later.statistics, cost.name)
            for cost in fields(self.statistics)
        }
        # Events that this run did not execute are among the events of the later one.
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

    @classmethod
    def from_packed(
        cls, equations: EquationsOfMotion, packed: PackedRun, made_by: Any = None
    ) -> Solution:
        """Return the solution that was packed by `pack_run`.

        Parameters
        ----------
        equations
            The equations of the run; their start may be another one.
        made_by
            The integrator of the run.
        """
        return cls(**unpack_fields(equations, packed), made_by=made_by)

    def __reduce__(self) -> Any:
        mechanism = self.equations.mechanism
        if mechanism is None:
            raise BeamdaeError(
                "Solution: a run of equations cannot be pickled; use solution.save(path), and "
                "bd.load(path, model) in the other process."
            )
        # Laws are often local functions of a model function, which pickle does not support.
        import cloudpickle

        return _unpickle, (cloudpickle.dumps((mechanism, self.made_by)), pack_run(self))


def _unpickle(source: bytes, packed: PackedRun) -> Solution:
    # CasADi expressions cannot be pickled; the equations are assembled again.
    mechanism, made_by = pickle.loads(source)
    return Solution.from_packed(equations_of_motion(mechanism, AS_DRAWN), packed, made_by)
