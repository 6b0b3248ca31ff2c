"""The result of a run as users look at it: tables, files and pictures."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations import measures
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.assembly.observation import add_observable
from beamdae.errors import BeamdaeError, require_finite, require_sequence, short_repr
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.results.displays import Animation, Plot, load_views
from beamdae.results.event_records import tabulate_events
from beamdae.results.joined_runs import joined
from beamdae.results.run import Run
from beamdae.results.section_forces.recovery import recover_section_forces
from beamdae.results.section_forces.section_forces import SectionForces
from beamdae.results.storage.checkpoint import Checkpoint
from beamdae.results.storage.files import write_result
from beamdae.results.storage.packed_run import PackedRun, pack_run, unpack_run
from beamdae.results.storage.saved_run import save_run
from beamdae.results.time_series import TimeSeries
from beamdae.results.trajectory import Instant
from beamdae.symbolic.statements import Named, Quantity

# Tables are made for those who ask for them: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd


Array = np.ndarray


@dataclass(frozen=True, repr=False)
class Solution(Run, TimeSeries):
    """Result of one run.

    Attributes
    ----------
    t
        Output times reached (k,) [s].
    q, v, a, lam
        Rows at these times.
    status
        How it ended, and a sentence.
    integrator
        Settings of the integrator, including what "auto" came to.
    made_by
        The integrator itself.
    occurred
        The events that happened, in the order of time.
    sides
        On which side of its value the quantity of each event was left at the end: 1, -1, or 0 where
        that is not known.
    begun
        Sentences on what is not to be trusted of the run it goes on from.
    """

    @property
    def label(self) -> str:
        """Short name of the integrator."""
        return str(getattr(self.made_by, "label", self.integrator.get("integrator", "run")))

    def __reduce__(self) -> Any:
        mechanism = self.equations.mechanism
        if mechanism is None:
            raise BeamdaeError(
                "Solution: a run of equations cannot be pickled; take solution.save(path), and "
                "bd.load(path, model) in the other process."
            )
        import cloudpickle

        # Laws are often functions within that which makes the model.
        return _rebuilt, (cloudpickle.dumps((mechanism, self.made_by)), pack_run(self))

    def __repr__(self) -> str:
        method = self.label
        names = dict.fromkeys(o.name for o in self.equations.observables)
        observed = f"; observed: {', '.join(names)}" if names else ""
        return (
            f"<Solution by {method}: {self.status.kind}, {self.status.sentence}; "
            f"t = {self.t[0]:g} to {self.trajectory.end:g} s in {len(self.t)} rows{observed}>"
        )

    def _repr_html_(self) -> str:
        return load_views().summarize_as_html(self)

    @cached_property
    def observed(self) -> pd.DataFrame:
        """The observed columns at the output times."""
        import pandas as pd

        return pd.DataFrame(self.columns, index=range(len(self.t)))

    def observe(self, name: str, what: Attachment | Quantity) -> Solution:
        """The run with one more observable, see `Mechanism.observe`; nothing is integrated again.

        Raises
        ------
        BeamdaeError
            If the name is taken, the quantity is none of the mechanism's, or the run not one of a
            mechanism.
        """
        return replace(self, equations=add_observable(self.equations, name, what))

    def animate(
        self,
        path: str | Path | None = None,
        speed: float = 1.0,
        frames: int | None = None,
        color: str | None = None,
        trail: Any = False,
    ) -> Animation | Path:
        """Moving pictures of the run, see `beamdae.animate`."""
        return load_views().animate(self, path, speed, frames, color, trail)

    @property
    def events(self) -> pd.DataFrame:
        """The events that happened: name, direction, time, and the observed columns there."""
        import pandas as pd

        return pd.DataFrame(tabulate_events(self.equations, self.event_records))

    def at(self, t: float) -> Instant:
        """Where the run was at a time [s] within it, also between output times; see `modes`."""
        return Instant.of(self.trajectory, t)

    @cached_property
    def ledger(self) -> pd.DataFrame:
        """Energies and works [J] at the output times; `imbalance` is what the books are off by."""
        import pandas as pd

        return pd.DataFrame(self._books.at(self.t), columns=list(measures.LEDGER_COLUMNS))

    @cached_property
    def drift(self) -> pd.DataFrame:
        """Largest |g| and |g_dot| over the joints at the output times."""
        import pandas as pd

        return pd.DataFrame(self.drift_columns)

    def coordinates(self) -> pd.DataFrame:
        """Time, all coordinates, velocities and multipliers, named by part, with units."""
        import pandas as pd

        e = self.equations
        columns = [
            *e.coordinates,
            *(coordinate.rate for coordinate in e.coordinates),
            *(Named(f"lam.{held.name}", held.unit) for held in e.multipliers),
        ]
        headers = [column.header for column in columns]
        frame = pd.DataFrame(np.hstack([self.q, self.v, self.lam]), columns=headers)
        frame.insert(0, "t [s]", self.t)
        return frame

    def section_forces(self, beam: Any, t: Any = None, s: Any = None) -> SectionForces:
        """N, Q and M of a beam (or its name) at times and arc lengths, see `SectionForces`."""
        return recover_section_forces(self, beam, t, s)

    def diagram(self, beam: Any, what: str = "M", t: Any = None) -> Plot:
        """Draw "N", "Q" or "M" of a beam at a time, or least and largest over several."""
        return recover_section_forces(self, beam, t).diagram(what)

    def to_csv(self, path: str | Path, **further: Any) -> Path:
        """Write the table as CSV, and settings, versions and statistics as JSON beside it.

        The JSON begins with "status" and "reason". Where the run did not reach its end the CSV says
        so too: its last column, which others do not have, is called "status" and holds "failed",
        "limited" or "interrupted" in each row. The path stays, for scripts that look for it, and so
        do all other columns.

        `further` entries go to the JSON as well. Both files appear whole or not at all. Headers a
        spreadsheet would take for formulas have an apostrophe in front. Returns the path of the CSV
        file.

        Raises
        ------
        BeamdaeError
            If a file cannot be written.
        """
        return write_result(path, self.all_columns(), self.status, self.beside(**further))

    def save(self, path: str | Path) -> Path:
        """Write all of the run to one file, see `beamdae.load`.

        The file is a zip archive of NumPy arrays and JSON, without anything that is executed.

        Raises
        ------
        BeamdaeError
            If it cannot be written.
        """
        return save_run(self, path)

    def at_times(self, times: Array) -> Solution:
        """The same run with other output times [s], ascending and within it.

        Raises
        ------
        BeamdaeError
            If they are not.
        """
        given = require_sequence("at_times", "times", times, "a list of times [s]")
        t = np.array([require_finite("at_times", "times", one) for one in given])
        first, end = float(self.trajectory.intervals[0].t[0]), self.trajectory.end
        if not len(t) or np.any(np.diff(t) <= 0.0) or t[0] < first or t[-1] > end:
            raise BeamdaeError(
                f"at_times: times must ascend within the run, {first:g} to {end:g} s, "
                f"got {short_repr(times)}."
            )
        return replace(self, t=t)

    def checkpoint(self, path: str | Path) -> Path:
        """Write where the run ended as JSON, for `simulate(..., start=path)` to go on from."""
        return Checkpoint.of(self).write(path)

    def followed_by(self, later: Solution) -> Solution:
        """Join the run and one that went on from its end."""
        return joined(self, later)


def _rebuilt(made_of: bytes, kept: PackedRun) -> Solution:
    """In another process: expressions of CasADi do not travel, what they are made of does."""
    mechanism, made_by = pickle.loads(made_of)
    return unpack_run(equations_of_motion(mechanism, AS_DRAWN), kept, made_by)
