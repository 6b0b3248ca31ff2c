"""The result of a static analysis: a path of equilibria, what is critical on it, tables of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.measures import ObservedRows
from beamdae.errors import require_count
from beamdae.results.columns import Header, merge_columns, select_columns
from beamdae.results.diagnostics.strain_validity import BeamRange, measure_beam_ranges
from beamdae.results.displays import Plot, load_views
from beamdae.results.outcome import Status
from beamdae.results.section_forces.recovery import recover_section_forces_at_state
from beamdae.results.section_forces.section_forces import SectionForces
from beamdae.results.storage.checkpoint import Checkpoint
from beamdae.results.storage.files import write_result

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

FACTOR, UNSTABLE, KIND = "load factor [-]", "unstable directions [-]", "point"


class CriticalPoint(NamedTuple):
    """A point of a path at which the tangent stiffness loses a direction.

    Attributes
    ----------
    kind
        "limit point", where the load factor turns; "branch point", where another path crosses;
        "flutter point", where a follower load begins to swing what it acts on.
    row
        Of the path.
    factor
        The load factor.
    moves
        The coordinate that moves most in what is lost.
    """

    kind: str
    row: int
    factor: float
    moves: str


@dataclass(frozen=True)
class Equilibrium:
    """A path of equilibria of a mechanism, at the end of which it rests.

    Attributes
    ----------
    equations
        Its equations of motion, under loads as they are at the time `t` [s].
    status
        How the path ended: "ok" at its last target, "limited" or "failed"; and a sentence.
    loads
        Names of the loads that were scaled, of each stage.
    factors
        Load factors, (k, number of stages).
    q, lam
        Coordinates (k, n) and multipliers (k, m).
    unstable
        In how many directions each equilibrium is unstable under loads that stay (k,): 0 where it
        is stable, -1 where that is not known.
    critical
        Limit and branch points, in order.
    settings
        What was asked for, and what it took.
    notes
        Sentences on what the result is to be read with.
    free
        The coordinate that moves most in a motion that nothing resists where it ends, if there is
        one: it rests anywhere along that motion.
    """

    equations: EquationsOfMotion
    t: float
    status: Status
    loads: tuple[tuple[str, ...], ...]
    factors: Array = field(repr=False)
    q: Array = field(repr=False)
    lam: Array = field(repr=False)
    unstable: Array = field(repr=False)
    critical: tuple[CriticalPoint, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)
    model: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = field(default=(), repr=False)
    free: str = ""

    def __repr__(self) -> str:
        critical = "".join(f"; {one.kind} at {one.factor:.6g}" for one in self.critical)
        return (
            f"<Equilibrium: {self.status.kind}, {self.status.sentence}; {len(self.q)} rows to load "
            f"factor {self.factor:g}, {'' if self.stable else 'not '}stable{critical}>"
        )

    @property
    def factor(self) -> float:
        """The load factor at its end, of the last stage; 1 where nothing is scaled."""
        return float(self.factors[-1, -1]) if self.factors.shape[1] else 1.0

    @property
    def stable(self) -> bool:
        """Whether it comes back to its end from all around, under loads that stay."""
        return bool(self.unstable[-1] == 0) and not self.free

    @property
    def positions(self) -> dict[str, float]:
        """Coordinates at its end by name, such as `Mechanism(start=)` takes."""
        return dict(zip(self.equations.q_names, self.q[-1].tolist(), strict=True))

    def at(self, row: int) -> Equilibrium:
        """The path up to a row of it, to start from there; critical points name rows."""
        row = require_count("Equilibrium.at", "row", row, 0, len(self.q) - 1)
        return replace(
            self,
            factors=self.factors[: row + 1],
            q=self.q[: row + 1],
            lam=self.lam[: row + 1],
            unstable=self.unstable[: row + 1],
            critical=tuple(one for one in self.critical if one.row <= row),
        )

    @cached_property
    def columns(self) -> dict[str, Array]:
        """The observed columns but for rates, by header, (k,) each."""
        e, rows = self.equations, len(self.q)
        headers = [header for o in e.observables for header in o.headers]
        if not headers:
            return {}
        still = np.zeros_like(self.q)
        times = np.full((rows, 2), self.t)
        values = ObservedRows(e)(times, self.q, still, still, self.lam).T
        found = dict(zip(headers, values, strict=True))
        return {k: x for k, x in found.items() if not Header.of(k).suffix.endswith("_dot")}

    def all_columns(self) -> dict[str, Any]:
        """The columns of `table` by header."""
        kinds = np.full(len(self.q), "", object)
        for one in self.critical:
            kinds[one.row] = one.kind
        names = [FACTOR] * min(len(self.loads), 1)
        names += [f"load factor {k} [-]" for k in range(2, len(self.loads) + 1)]
        return {
            **dict(zip(names, self.factors.T, strict=True)),
            **self.columns,
            UNSTABLE: self.unstable,
            KIND: kinds,
        }

    def __getitem__(self, name: str) -> pd.Series | pd.DataFrame:
        """Columns over the load factor (of several stages their sum), by name as of a `Solution`.

        Raises
        ------
        BeamdaeError
            If there is none of the name.
        """
        import pandas as pd

        observed = self.all_columns()
        every = merge_columns(observed, self.coordinates())
        headers = select_columns(every, name, "Equilibrium", observed)
        index = pd.Index(self.factors.sum(axis=1), name=FACTOR)
        found = pd.DataFrame({h: np.asarray(every[h]) for h in headers}).set_index(index)
        return found[headers[0]] if len(headers) == 1 else found

    def plot(self, *names: str) -> Plot:
        """Draw the load factor over columns by name, default all that change, twelve at most.

        Dashed where it is unstable, with limit and branch points marked.

        Raises
        ------
        BeamdaeError
            If there is no column of such a name.
        """
        return load_views().plot_equilibrium_path(self, names)

    def table(self) -> pd.DataFrame:
        """Load factors, observed quantities, stability and kind of each point of the path."""
        import pandas as pd

        return pd.DataFrame(self.all_columns())

    def coordinates(self) -> pd.DataFrame:
        """All coordinates and multipliers, named by part, with units."""
        import pandas as pd

        e = self.equations
        held = [f"lam.{one.header}" for one in e.multipliers]
        headers = [*(one.header for one in e.coordinates), *held]
        return pd.DataFrame(np.hstack([self.q, self.lam]), columns=headers)

    def section_forces(self, beam: Any, s: Any = None) -> SectionForces:
        """N, Q and M of a beam (or its name) at its end, as `Solution.section_forces`."""
        still = np.zeros_like(self.q[-1:])
        state = State(self.q[-1:], still, still, self.lam[-1:])
        known = self.equations.configurations
        factors = dict.fromkeys(known.initially_inactive if known is not None else (), 0.0)
        for names, factor in zip(self.loads, self.factors[-1].tolist(), strict=True):
            factors |= dict.fromkeys(names, factor)
        return recover_section_forces_at_state(self.equations, beam, self.t, state, factors, s)

    def diagram(self, beam: Any, what: str = "M") -> Plot:
        """Draw "N", "Q" or "M" of a beam at its end, as `Solution.diagram`."""
        return self.section_forces(beam).diagram(what)

    @cached_property
    def validity(self) -> tuple[BeamRange, ...]:
        """How far each beam went from its floating frame, and what that makes of its strains."""
        return measure_beam_ranges(self.equations, self.q)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what is not to be trusted as it stands; `equilibrium` warns of each."""
        free = (
            f"{self.free}: it is free to move without stiffness, it rests anywhere along a motion "
            "in which this coordinate moves most."
        )
        rests = bool(self.free) and self.status.success
        told = (*self.notes, free if rests else "", *(x.warning for x in self.validity))
        return tuple(filter(None, told))

    def beside(self, **further: Any) -> dict[str, Any]:
        """What `to_csv` writes as JSON beside the table, as plain values."""
        return {
            "status": self.status.kind,
            "reason": self.status.sentence,
            "model": self.model,
            "loads": [list(stage) for stage in self.loads],
            "settings": self.settings,
            "load factor": self.factor,
            "stable": self.stable,
            "free to move": self.free,
            "critical points": [one._asdict() for one in self.critical],
            "warnings": list(self.warnings),
            **further,
        }

    def to_csv(self, path: str | Path, **further: Any) -> Path:
        """Write the table as CSV, and how it was found as JSON beside it; as `Solution.to_csv`.

        Raises
        ------
        BeamdaeError
            If a file cannot be written.
        """
        return write_result(path, self.all_columns(), self.status, self.beside(**further))

    def starting(self) -> Checkpoint:
        """Its end as the state a run begins with, at rest."""
        still = dict.fromkeys(self.equations.q_names, 0.0)
        known = self.equations.configurations
        inactive = () if known is None else tuple(sorted(known.initially_inactive))
        return Checkpoint(self.t, self.positions, still, inactive=inactive)
