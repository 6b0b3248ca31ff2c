"""The result of a run: how it ended, its states at the output times, tables of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from beamdae.equations import measures
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State
from beamdae.equations.observing import observing
from beamdae.errors import BeamdaeError, may_be_path, shown
from beamdae.parts.attachments import Attachment
from beamdae.results.branches import SingularPosition, branch_warnings, singular_positions
from beamdae.results.checkpoint import Checkpoint
from beamdae.results.doubts import doubts
from beamdae.results.energy_ledger import EnergyLedger, Quality
from beamdae.results.files import write
from beamdae.results.joining import joined
from beamdae.results.occurrences import Occurrence, table_of
from beamdae.results.recovered import section_forces
from beamdae.results.section_forces import SectionForces
from beamdae.results.selecting import selected
from beamdae.results.start_changes import StartFacts, start_facts
from beamdae.results.trajectory import Trajectory
from beamdae.results.validity import BeamRange, beam_ranges
from beamdae.symbolic.statements import Named, Quantity

# Tables are made for those who ask for them: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

    from beamdae.report.curves import Plot
    from beamdae.report.motion import Animation

Array = np.ndarray

# How a run may end: at its end, stopped by a limit or by the user, or because it could not go on.
Kind = Literal["ok", "limited", "interrupted", "failed"]


@dataclass(frozen=True)
class Status:
    """How a run ended: its kind, and a sentence."""

    kind: Kind
    sentence: str

    @property
    def success(self) -> bool:
        """Whether it reached its end."""
        return self.kind == "ok"


# Rows that are looked at before somebody asks for them.
_LOOKED_AT = 10_000

REACHED_END = Status("ok", "reached the end")


@dataclass(frozen=True)
class Statistics:
    """What a run cost.

    Attributes
    ----------
    steps, rejected_steps
        Accepted steps; attempts given up (error test or Newton).
    residual_calls, jacobian_calls, factorizations, solves
        Calls of the compiled residual and Jacobian, LU factorizations and solutions.
    newton_failures
        Newton iterations that did not converge with the Jacobian of an earlier step, which is then
        renewed, or for good. scikit-sundae's class does not tell: there these are Jacobians renewed
        within a step.
    setup_time, wall_time
        Building and compiling; integration alone [s].
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


@dataclass(frozen=True, repr=False)
class Solution:
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
    """

    equations: EquationsOfMotion
    trajectory: Trajectory = field(repr=False)
    t: Array
    status: Status
    statistics: Statistics
    integrator: dict[str, Any]
    model: dict[str, Any] = field(default_factory=dict)
    made_by: Any = field(default=None, repr=False)
    occurred: tuple[Occurrence, ...] = field(default=(), repr=False)

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
    def _output(self) -> tuple[Array, State]:
        return self.trajectory.at(self.t)

    @property
    def q(self) -> Array:
        """Coordinates at the output times, (k, n)."""
        return self._output[1].q

    @property
    def v(self) -> Array:
        """Velocities at the output times, (k, n)."""
        return self._output[1].v

    @property
    def a(self) -> Array:
        """Accelerations at the output times, (k, n)."""
        return self._output[1].a

    @property
    def lam(self) -> Array:
        """Multipliers at the output times, (k, m)."""
        return self._output[1].lam

    @cached_property
    def columns(self) -> dict[str, Array]:
        """The observed columns at the output times by header, as arrays."""
        e = self.equations
        headers = [header for o in e.observables for header in o.headers]
        if not headers:
            return {}
        return dict(zip(headers, self._measured(measures.ObservedRows(e)).T, strict=True))

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

    def _looked_at(self) -> tuple[dict[str, Array], Array]:
        """Observed columns and times, some thousands of them where there are more."""
        apart = len(self.t) // _LOOKED_AT + 1
        some = self if apart == 1 else replace(self, t=self.t[::apart])
        return some.columns, some.t

    def _measured(self, rows: Callable[..., Array]) -> Array:
        times, state = self._output
        return rows(times, *state)

    @cached_property
    def _books(self) -> EnergyLedger:
        return EnergyLedger.of(self.equations, self.trajectory)

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

    @cached_property
    def quality(self) -> Quality:
        """Largest residual, drift and energy imbalance over all steps."""
        return self._books.quality

    @cached_property
    def start(self) -> StartFacts:
        """What was asked for as the start, and what the joints changed of it, by part."""
        first = self.trajectory.intervals[0].rows
        return start_facts(self.equations, State(*(rows[0] for rows in first)))

    @cached_property
    def validity(self) -> tuple[BeamRange, ...]:
        """How far each beam went from its floating frame, and what that makes of its strains."""
        return beam_ranges(self.equations, self.trajectory)

    @cached_property
    def singular_positions(self) -> tuple[SingularPosition, ...]:
        """Positions the run passed in which the joints lose rank and motions branch.

        They are not looked for where redundant constraints have no full rank anywhere.
        """
        if self.equations.redundant:
            return ()
        return singular_positions(self.equations, self.trajectory)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what is not to be trusted as it stands; `simulate` warns of each."""
        beams = (beam.warning for beam in self.validity)
        doubtful = doubts(self.equations, self._books, *self._looked_at())
        moved = self.start.warning
        return (
            *filter(None, (moved, *beams)),
            *branch_warnings(self.singular_positions),
            *doubtful,
        )

    def table(self) -> pd.DataFrame:
        """Time, observed quantities and the energy ledger; headers carry units."""
        import pandas as pd

        return pd.DataFrame(self.all_columns())

    def all_columns(self) -> dict[str, Array]:
        """The columns of `table` by header, as arrays."""
        ledger = zip(measures.LEDGER_COLUMNS, self._books.at(self.t).T, strict=True)
        return {measures.TIME: self.t, **self.columns, **dict(ledger)}

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

    def summary(self) -> dict[str, Any]:
        """Status, statistics and quality as plain values."""
        return {
            "success": self.status.success,
            "status": self.status.kind,
            "reason": self.status.sentence,
            "last_time": self.trajectory.end,
            **asdict(self.statistics),
            **asdict(self.quality),
        }

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

    def beside(self, **further: Any) -> dict[str, Any]:
        """What `to_csv` writes as JSON beside the table, as plain values."""
        return {
            "status": self.status.kind,
            "reason": self.status.sentence,
            "model": self.model,
            "integrator": self.integrator,
            "result": self.summary(),
            "start": {
                "asked": self.start.asked,
                "changed by the joints": [asdict(change) for change in self.start.changes],
            },
            "validity": [asdict(beam) for beam in self.validity],
            "singular positions": [asdict(passed) for passed in self.singular_positions],
            "events": [one.plain for one in self.occurred],
            "warnings": list(self.warnings),
            **further,
        }
