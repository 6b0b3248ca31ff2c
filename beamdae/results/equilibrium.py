"""Result of a static analysis: a path of equilibria with its critical points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from beamdae import deferred
from beamdae.equations.commands import limit_warnings
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.measures import ObservedRows
from beamdae.equations.watched_terms import list_arguments_outside
from beamdae.errors import format_count, require_count
from beamdae.interrupts import interruptible
from beamdae.read_only import read_only_data
from beamdae.results.columns import Header
from beamdae.results.displays import HasPage, Plot
from beamdae.results.outcome import Status
from beamdae.results.section_forces.balance import RowGroup
from beamdae.results.section_forces.recovery import SectionSampler, find_beam
from beamdae.results.section_forces.section_forces import SectionForces
from beamdae.results.storage.checkpoint import Checkpoint
from beamdae.results.time_series import HasColumns

Array = np.ndarray

# Headers of the table.
FACTOR = "load factor [-]"
UNSTABLE = "unstable directions [-]"
KIND = "point"


def static_headers(equations: EquationsOfMotion) -> list[str]:
    """Return the headers of `Equilibrium.columns`: without rates and accelerations."""
    return [
        header
        for o in equations.observables
        if not o.has_accelerations
        for header in o.headers
        if not Header.of(header).suffix.endswith("_dot")
    ]


def static_coordinate_headers(equations: EquationsOfMotion) -> list[str]:
    """Return the headers of `Equilibrium.coordinates`."""
    coordinates = [coordinate.header for coordinate in equations.coordinates]
    return [*coordinates, *(f"lam.{multiplier.header}" for multiplier in equations.multipliers)]


class CriticalPoint(NamedTuple):
    """Point of an equilibrium path at which the stability under constant loads may change.

    Attributes
    ----------
    kind
        "limit point" (extremum of the load factor), "branch point" (intersection with another
        path) or "flutter point" (onset of growing oscillations under forces without a potential).
    row
        Index of the point in the path.
    factor
        Factor of the loads scaled in the stage of this point [-], or value of `Equilibrium.over`.
    moves
        Name of the coordinate that moves most in the critical mode. At limit and branch points,
        this mode has no stiffness.
    multiplicity
        Number of modes that become critical together, such as 2 for two equal columns. Each of them
        is a critical point of the path.
    """

    kind: str
    row: int
    factor: float
    moves: str
    multiplicity: int = 1

    @property
    def description(self) -> str:
        """Kind of the point, with the number of its modes if there are several."""
        if self.multiplicity == 1:
            return self.kind
        return f"{self.kind} of {self.multiplicity} modes"


@read_only_data
@dataclass(frozen=True)
class Equilibrium(HasColumns, HasPage):
    """Path of equilibria of a mechanism under varying load factors.

    Attributes
    ----------
    equations
        The equations of motion.
    t
        Time at which the loads are evaluated [s].
    status
        Termination status and its reason: "ok" if the path reached its last target, otherwise
        "limited", "failed" or "interrupted".
    loads
        Names of the scaled loads, one tuple per stage.
    factors
        Load factors (k, number of stages) [-], or values (k, 1) of the quantity `over`.
    q
        Coordinates (k, n) [m or rad].
    lam
        Lagrange multipliers of the constraints (k, m) [N or N m].
    unstable
        Number of unstable directions of each equilibrium under constant loads (k,), or -1 if it is
        not known. If it is 0, the equilibrium is stable, unless it can move without stiffness. At a
        critical point, the motion that becomes critical does not count.
    critical
        Limit, branch and flutter points, in the order of the path.
    settings
        Settings of the path, and the number of Newton iterations.
    model
        Name and parameters of the model; empty unless a model function was analyzed.
    notes
        Remarks on the interpretation of the result.
    free_coordinates
        For each row, name of the coordinate that moves most in a motion without stiffness, along
        which the equilibrium is arbitrary; "" if there is none. The critical modes of critical
        points are not counted.
    over
        Header of the quantity that varies in place of a load factor, such as "t [s]"; "" if none.
    times
        Time of each row, and the time that selects pieces of laws (k, 2) [s]; None if all are `t`.
    numbers
        Numbers of the equations for each row, if `over` changes them; otherwise None.
    """

    _result_name = "Equilibrium"

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
    free_coordinates: tuple[str, ...] = field(default=(), repr=False)
    over: str = ""
    times: Array | None = field(default=None, repr=False)
    numbers: Array | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        critical = "".join(f"; {point.kind} at {point.factor:.6g}" for point in self.critical)
        return (
            f"<Equilibrium: {self.status.kind}, {self.status.sentence}; {len(self.q)} rows to "
            f"{self.quantity} {self.factor:g}, {'' if self.stable else 'not '}stable{critical}>"
        )

    @property
    def quantity(self) -> str:
        """Name of the quantity that varies along the path."""
        return self.over or "load factor"

    @property
    def header(self) -> str:
        """Header of this quantity in `table`."""
        return self.over or FACTOR

    @property
    def factor(self) -> float:
        """Load factor of the last stage at the end of the path [-]; 1 if no load is scaled.

        With `over`, the last value of this quantity.
        """
        return float(self.factors[-1, -1]) if self.factors.shape[1] else 1.0

    @property
    def free(self) -> str:
        """Entry of `free_coordinates` at the end of the path; "" if nothing can move freely."""
        return self.free_coordinates[-1] if self.free_coordinates else ""

    @property
    def stable(self) -> bool:
        """True if the end of the path is stable under constant loads and cannot move freely."""
        return bool(self.unstable[-1] == 0) and not self.free

    @property
    def end_warning(self) -> str:
        """Warning for analyses of the end of a path that ended early; "" if it reached its target.

        The end is an equilibrium, but under other loads than requested.
        """
        if self.status.success:
            return ""
        return (
            "the equilibrium path ended before its target, so this state is its last equilibrium, "
            f"at {self.quantity} {self.factor:.6g} ({self.status.sentence}); repeat the path, or "
            "select a row with Equilibrium.at."
        )

    @property
    def instability(self) -> str:
        """Sentence on an unstable end of the path; "" if there is none.

        A prescribed displacement, or arc length, also holds equilibria that are unstable under
        constant loads. Such a path has a sentence if it follows the arc length to a load factor, if
        no critical point shows where it became unstable, because it began unstable, or if it
        switched to an unstable path. A critical point at the end is neither stable nor unstable.
        """
        count, end = int(self.unstable[-1]), len(self.q) - 1
        if count <= 0 or any(point.row == end for point in self.critical):
            return ""
        state = "the equilibrium" + (
            f" at {self.quantity} {self.factor:.6g}" if self.loads or self.over else ""
        )
        state += f" is unstable in {format_count(count, 'direction')}"
        last_stable = max(np.flatnonzero(self.unstable == 0), default=-1)
        onset = next((x for x in self.critical if x.row >= last_stable >= 0), None)
        by_load = self.settings.get("control", "load") == "load"
        if onset is None:
            if not by_load and np.any(self.unstable <= 0):
                if not np.all(self.unstable[last_stable + 1 :] > 0):
                    return ""
                factor = self.factors[last_stable].sum()
                return (
                    f"equilibrium: {state} since about {self.quantity} {factor:.6g}, where no "
                    "critical point was found; use a smaller step=."
                )
            return (
                f"equilibrium: {state} from the beginning of the path; choose other positions with "
                "start= to look for a stable one."
            )
        number = sum(x.kind == "branch point" for x in self.critical if x.row <= onset.row)
        is_branch = onset.kind == "branch point"
        switches = np.cumsum(np.abs(self.settings.get("switch", []))).tolist()
        is_switched = not by_load and is_branch and number in switches
        is_asked = isinstance(self.settings["to"], Mapping) or not self.status.success
        if is_asked and not (by_load or is_switched):
            return ""
        remedy = "simulate what the structure does beyond this point"
        if by_load and is_branch:
            crossing = f"follow the crossing path with switch={number}, or "
            remedy = (
                f"{crossing if len(self.loads) == 1 else ''}analyze an imperfect structure "
                "(bd.imperfect, bd.knock_down)"
            )
        what = "the path switches" if is_switched else "a real structure leaves this path"
        return (
            f"equilibrium: {state} since the {onset.kind} at {self.quantity} {onset.factor:.6g}, "
            f"where {what}; {remedy}."
        )

    @property
    def positions(self) -> dict[str, float]:
        """Coordinates at the end of the path [m or rad] by name, for `Mechanism(start=)`."""
        return dict(zip(self.equations.q_names, self.q[-1].tolist(), strict=True))

    def at(self, row: int) -> Equilibrium:
        """Return the path up to and including a row, for example up to a critical point.

        `settings` and `notes` remain those of the whole path. Each row is an equilibrium, so
        `status` is "ok" for every row but the last one, which keeps the status of the path.

        Parameters
        ----------
        row
            Index of the row, for example `CriticalPoint.row`.

        Raises
        ------
        BeamdaeError
            If `row` is not a whole number from 0 to the index of the last row.
        """
        row = require_count("Equilibrium.at", "row", row, 0, len(self.q) - 1)
        is_end = row == len(self.q) - 1
        names = "times", "numbers", "factors", "q", "lam", "unstable", "free_coordinates"
        values = {name: getattr(self, name) for name in names}
        rows: dict[str, Any] = {x: None if y is None else y[: row + 1] for x, y in values.items()}
        return replace(
            self,
            status=self.status if is_end else Status("ok", f"row {row} of a longer path"),
            equations=self._equations_of_row(row),
            t=self.t if self.times is None else float(self.times[row, 0]),
            critical=tuple(point for point in self.critical if point.row <= row),
            **rows,
        )

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Observed columns (k,) by header, without rates and accelerations, which are zero."""
        e = self.equations
        headers = e.observed_headers
        if not headers:
            return {}
        present = set(static_headers(e))
        at_rest = np.zeros_like(self.q)
        states = self._times, self.q, at_rest, at_rest, self.lam
        if self.numbers is None:
            values = ObservedRows(self.observed_equations)(*states).T
        else:
            values = np.array(
                [
                    ObservedRows(replace(self.observed_equations, p=p))(
                        *(x[k : k + 1] for x in states)
                    )[0]
                    for k, p in enumerate(self.numbers)
                ]
            ).T
        return {
            header: column
            for header, column in zip(headers, values, strict=True)
            if header in present
        }

    def all_columns(self) -> dict[str, Any]:
        """Return the columns (k,) of `table` by header."""
        kinds = np.full(len(self.q), "", object)
        for point in self.critical:
            kinds[point.row] = point.kind
        names = [self.header] * min(self.factors.shape[1], 1)
        names += [f"load factor {k} [-]" for k in range(2, len(self.loads) + 1)]
        return {
            **dict(zip(names, self.factors.T, strict=True)),
            **self.columns,
            UNSTABLE: self.unstable,
            KIND: kinds,
        }

    @property
    def _index(self) -> tuple[str, Array]:
        return self.header, self.factors.sum(axis=1)

    def plot(self, *names: str, x: str | None = None) -> Plot:
        """Plot the load factor over columns, or columns over a column; one panel per column.

        Unstable segments are dashed, and critical points are marked. If the path has several
        stages, their load factors are added.

        Parameters
        ----------
        *names
            Names of observed columns, coordinates or multipliers, as in `equilibrium[name]`.
            Defaults to up to six observed columns that change; at most twelve are plotted.
        x
            Column on the horizontal axis, such as "tip.x" for the path of a point; the named
            columns are then on the vertical axes. Defaults to the quantity of `over` or, for load
            factors, to the named columns, with the load factor on the vertical axes.

        Raises
        ------
        BeamdaeError
            If a name selects no column, or `x` selects several columns.
        """
        return deferred.module("report.result_displays").draw_result(self, *names, x=x)

    def coordinate_columns(self) -> dict[str, Array]:
        """Return the columns of `coordinates`, one value per point of the path, by header."""
        rows = np.hstack([self.q, self.lam])
        return dict(zip(static_coordinate_headers(self.equations), rows.T, strict=True))

    @interruptible
    def section_forces(self, beam: Any, s: Any = None) -> SectionForces:
        """Return the section forces of a beam at the end of the path.

        Parameters
        ----------
        beam
            The beam, or its name.
        s
            An arc length or several arc lengths [m]; see `Solution.section_forces`.

        Raises
        ------
        BeamdaeError
            If the mechanism does not contain the beam, or an arc length is out of range.
        Interrupted
            If Ctrl-C ends the call.
        """
        sampler = self._sample_sections(beam)

        def refine() -> SectionSampler | None:
            other = deferred.module("accuracy.runs").find_companion(self)
            return other and other.path._sample_sections(sampler.beam.name)

        return sampler.recover(np.full(1, self.t), s, np.zeros(0), refine)

    def _sample_sections(self, beam: Any) -> SectionSampler:
        at_rest, time = np.zeros_like(self.q[-1:]), np.full((1, 2), self.t)
        state = State(self.q[-1:], at_rest, at_rest, self.lam[-1:])
        factors = dict.fromkeys(self._inactive, 0.0)
        # A path over another quantity has no scaled loads.
        for names, factor in zip(self.loads, self.factors[-1].tolist(), strict=False):
            factors |= dict.fromkeys(names, factor)
        groups: list[RowGroup] = [(np.zeros(1, int), factors)]
        beam = find_beam(self.equations, beam)
        return SectionSampler(self.equations, beam, lambda _: (time, state, groups))

    def diagram(self, beam: Any, what: str = "M") -> Plot:
        """Plot a section force of a beam at the end of the path over its arc length.

        Parameters
        ----------
        beam
            The beam, or its name.
        what
            The section force: "N", "Q" or "M".

        Raises
        ------
        BeamdaeError
            If the mechanism does not contain the beam, or `what` is invalid.
        """
        return self.section_forces(beam).diagram(what)

    @cached_property
    def errors(self) -> Any:
        """Errors of the end and of critical points, see `Errors`, measured with refined beams."""
        return deferred.module("accuracy.statics").measure_equilibrium(self)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the model and the reliability of the result; `equilibrium` issues them."""
        free = ""
        if self.free and self.status.success:
            names = self.equations.q_names
            if self.free in [names[k] for k in self.equations.states]:
                free = (
                    f"{self.free}: the rate of this state does not depend on its value, so that "
                    "the value in equilibrium is arbitrary."
                )
            else:
                free = (
                    f"{self.free}: this coordinate can move without stiffness, so its value in "
                    "equilibrium depends on the start; add a spring or a joint, or choose it with "
                    f"start={{{self.free!r}: ...}}."
                )
        strain_limits = deferred.module("model_checks.validity_ranges")
        strains: Iterable[str] = ()
        if not strain_limits.names_strains(self.status):
            strains = strain_limits.strain_warnings(self.equations, self._checked_positions)
        outside = list_arguments_outside(self.equations, self._times[-1], self._checked_positions)
        limits: Iterable[str] = ()
        if self.status.success:
            limits = limit_warnings(
                self.equations,
                np.full(2, self.t),
                self.q[-1],
                np.zeros_like(self.q[-1]),
                "so this equilibrium is that of the limit, not of the loop; enlarge the limits, or "
                "change the target or the load.",
            )
        of_model = self.equations.build_warnings
        found = (
            *of_model,
            *strains,
            *self.notes,
            self.instability,
            free,
            *deferred.module("accuracy.statics").check_equilibrium(self),
            *outside,
            *limits,
        )
        return tuple(filter(None, found))

    def metadata(self, **further: Any) -> dict[str, Any]:
        """Return status, settings and warnings for `to_csv`; `further` adds or replaces entries."""
        return {
            "status": self.status.kind,
            "reason": self.status.sentence,
            "model": self.model,
            "loads": [list(stage) for stage in self.loads],
            "settings": self.settings,
            self.quantity: self.factor,
            "stable": self.stable,
            "free to move": self.free,
            "critical points": [point._asdict() for point in self.critical],
            "warnings": list(self.warnings),
            **further,
        }

    def to_checkpoint(self) -> Checkpoint:
        """Return a checkpoint that starts a run at rest from the end of the path."""
        at_rest = dict.fromkeys(self.equations.q_names, 0.0)
        doubt = "" if self.status.success else self.status.sentence
        return Checkpoint(self.t, self.positions, at_rest, inactive=self._inactive, doubt=doubt)

    @property
    def observed_equations(self) -> EquationsOfMotion:
        """Equations whose observed loads are zero for inactive parts."""
        return self.equations.without_loads_of(frozenset(self._inactive))

    @property
    def _times(self) -> Array:
        return np.full((len(self.q), 2), self.t) if self.times is None else self.times

    @property
    def _checked_positions(self) -> Array:
        """Positions of the rows whose numbers are those of `equations`."""
        return self.q if self.numbers is None else self.q[-1:]

    @property
    def end_equations(self) -> EquationsOfMotion:
        """Equations with the numbers of the end of the path."""
        return self._equations_of_row(-1)

    def _equations_of_row(self, row: int) -> EquationsOfMotion:
        if self.numbers is None:
            return self.equations
        return replace(self.equations, p=self.numbers[row])

    @property
    def _inactive(self) -> tuple[str, ...]:
        """Names of the parts that are inactive until an event activates them."""
        configurations = self.equations.configurations
        return () if configurations is None else tuple(sorted(configurations.initially_inactive))
