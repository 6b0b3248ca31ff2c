"""The result of a run as users look at it: tables, files and pictures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations import measures
from beamdae.equations.observing import observing
from beamdae.errors import BeamdaeError, may_be_path, shown
from beamdae.parts.attachments import Attachment
from beamdae.results.checkpoint import Checkpoint
from beamdae.results.files import write
from beamdae.results.instant import Instant
from beamdae.results.joining import joined
from beamdae.results.occurrences import table_of
from beamdae.results.recovered import section_forces
from beamdae.results.run import Run
from beamdae.results.section_forces import SectionForces
from beamdae.results.selecting import selected
from beamdae.symbolic.statements import Named, Quantity

# Tables are made for those who ask for them: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

    from beamdae.report.curves import Plot
    from beamdae.report.motion import Animation

Array = np.ndarray


@dataclass(frozen=True, repr=False)
class Solution(Run):
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

    def __repr__(self) -> str:
        method = getattr(self.made_by, "label", self.integrator.get("integrator", "?"))
        names = dict.fromkeys(o.name for o in self.equations.observables)
        observed = f"; observed: {', '.join(names)}" if names else ""
        return (
            f"<Solution by {method}: {self.status.kind}, {self.status.sentence}; "
            f"t = {self.t[0]:g} to {self.trajectory.end:g} s in {len(self.t)} rows{observed}>"
        )

    def _repr_html_(self) -> str:
        from beamdae.report.card import card

        return card(self)

    @cached_property
    def observed(self) -> pd.DataFrame:
        """The observed columns at the output times."""
        import pandas as pd

        return pd.DataFrame(self.columns, index=range(len(self.t)))

    def __getitem__(self, name: str) -> pd.Series | pd.DataFrame:
        """Columns over time, by name.

        Parameters
        ----------
        name
            A header, with or without its unit ("tip.y [m]" or "tip.y"), of an observed column, an
            energy, a coordinate, velocity or multiplier; or the name of an observable ("tip").

        Returns
        -------
        pandas.Series or pandas.DataFrame
            One column, or all those of an observable, over t [s].

        Raises
        ------
        BeamdaeError
            If there is none of the name.

        Examples
        --------
        >>> import beamdae as bd
        >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
        >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
        >>> mech.observe("ball", ball.point)
        >>> solution = bd.simulate(mech, t_end=1.0)
        >>> print(f"{solution['ball.y'].min():.3f} m")
        -2.905 m
        """
        import pandas as pd

        every = {**self.all_columns(), **dict(self.coordinates())}
        headers = selected(every, name)
        index = pd.Index(self.t, name=measures.TIME)
        found = pd.DataFrame({h: np.asarray(every[h]) for h in headers}).set_index(index)
        return found[headers[0]] if len(headers) == 1 else found

    def observe(self, name: str, what: Attachment | Quantity) -> Solution:
        """The run with one more observable, see `Mechanism.observe`; nothing is integrated again.

        Raises
        ------
        BeamdaeError
            If the name is taken, the quantity is none of the mechanism's, or the run not one of a
            mechanism.
        """
        return replace(self, equations=observing(self.equations, name, what))

    def plot(self, *names: str) -> Plot:
        """Draw columns over time, see `beamdae.plot`."""
        from beamdae.report.curves import plot

        return plot(self, *names)

    def animate(
        self, path: str | Path | None = None, speed: float = 1.0, frames: int = 0
    ) -> Animation | Path:
        """Moving pictures of the run, see `beamdae.animate`."""
        from beamdae.report.motion import animate

        return animate(self, path, speed, frames)

    @property
    def events(self) -> pd.DataFrame:
        """The events that happened: name, direction, time, and the observed columns there."""
        import pandas as pd

        return pd.DataFrame(table_of(self.equations, self.occurred))

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

        rows = self._measured(measures.books_of(self.equations))[:, -2:]
        return pd.DataFrame(rows, columns=list(measures.DRIFT_COLUMNS))

    def table(self) -> pd.DataFrame:
        """Time, observed quantities and the energy ledger; headers carry units."""
        import pandas as pd

        return pd.DataFrame(self.all_columns())

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
        return section_forces(self, beam, t, s)

    def diagram(self, beam: Any, what: str = "M", t: Any = None) -> Plot:
        """Draw "N", "Q" or "M" of a beam at a time, or least and largest over several."""
        return section_forces(self, beam, t).diagram(what)

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
        text = str(path) if isinstance(path, (str, Path)) else ""
        if not (may_be_path(text) and Path(text).name):
            raise BeamdaeError(f"to_csv: path must be that of a file, got {shown(path)}.")
        columns: dict[str, Any] = dict(self.all_columns())
        if not self.status.success:
            columns["status"] = [self.status.kind] * len(self.t)
        return write(Path(path), columns, self.beside(**further))

    def checkpoint(self, path: str | Path) -> Path:
        """Write where the run ended as JSON, for `simulate(..., start=path)` to go on from."""
        return Checkpoint.of(self).write(path)

    def followed_by(self, later: Solution) -> Solution:
        """Join the run and one that went on from its end."""
        return joined(self, later)
