"""What a run computed: states at the output times and what follows from them, as arrays.

Nothing here imports pandas, which takes as long as a short run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.equations import measures
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.results.diagnostics.energy_balance import EnergyLedger, Quality
from beamdae.results.diagnostics.quality_warnings import quality_warnings
from beamdae.results.diagnostics.singular_positions import (
    SingularPosition,
    find_singular_positions,
    singularity_warnings,
)
from beamdae.results.diagnostics.start_changes import StartSummary, compare_start
from beamdae.results.diagnostics.strain_validity import BeamRange, measure_beam_ranges_of_run
from beamdae.results.event_records import EventRecord
from beamdae.results.outcome import Statistics, Status
from beamdae.results.provenance import describe_provenance
from beamdae.results.storage.checkpoint import state_hash
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Rows that are looked at before somebody asks for them.
_LOOKED_AT = 10_000


@dataclass(frozen=True, repr=False)
class Run:
    """What a run computed, see `Solution`, which makes tables, files and pictures of it."""

    equations: EquationsOfMotion
    trajectory: Trajectory = field(repr=False)
    t: Array
    status: Status
    statistics: Statistics
    integrator: dict[str, Any]
    model: dict[str, Any] = field(default_factory=dict)
    made_by: Any = field(default=None, repr=False)
    event_records: tuple[EventRecord, ...] = field(default=(), repr=False)
    event_signs: dict[str, int] = field(default_factory=dict, repr=False)
    resume_warnings: tuple[str, ...] = field(default=(), repr=False)

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

    @property
    def _end(self) -> dict[str, Any]:
        """What runs that go on from here are told by: a hash of the last state, and all works."""
        end, last = self.trajectory.end, self.trajectory.intervals[-1].state
        books = self._books.at(np.array([end]))[0].tolist()
        state = state_hash(end, last.q[-1], last.v[-1])
        return {"state": state, **dict(zip(measures.LEDGER_COLUMNS, books, strict=True))}

    @cached_property
    def quality(self) -> Quality:
        """Largest residual, drift and energy imbalance over all steps."""
        return self._books.quality

    @cached_property
    def start(self) -> StartSummary:
        """What was asked for as the start, and what the joints changed of it, by part."""
        first = self.trajectory.intervals[0].rows
        return compare_start(self.equations, State(*(rows[0] for rows in first)))

    @cached_property
    def validity(self) -> tuple[BeamRange, ...]:
        """How far each beam went from its floating frame, and what that makes of its strains."""
        return measure_beam_ranges_of_run(self.equations, self.trajectory)

    @cached_property
    def singular_positions(self) -> tuple[SingularPosition, ...]:
        """Positions the run passed in which the joints lose rank and motions branch."""
        return find_singular_positions(self.equations, self.trajectory)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what is not to be trusted as it stands; `simulate` warns of each."""
        beams = (beam.warning for beam in self.validity)
        doubtful = quality_warnings(self.equations, self._books, *self._looked_at())
        moved = self.start.warning
        return (
            *self.resume_warnings,
            *filter(None, (moved, *beams)),
            *singularity_warnings(self.singular_positions),
            *doubtful,
        )

    def all_columns(self) -> dict[str, Array]:
        """The columns of `table` by header, as arrays."""
        ledger = zip(measures.LEDGER_COLUMNS, self._books.at(self.t).T, strict=True)
        return {measures.TIME: self.t, **self.columns, **dict(ledger)}

    @cached_property
    def drift_columns(self) -> dict[str, Array]:
        """The columns of `Solution.drift` by header, of the joints that are active at each time."""
        times, state = self._output
        configurations = [interval.configuration for interval in self.trajectory.intervals]
        which = self.trajectory.which(self.t)
        rows = np.zeros((len(times), len(measures.DRIFT_COLUMNS)))
        for active in dict.fromkeys(configurations):
            here = np.array([x is active for x in configurations])[which]
            if not here.any():
                continue
            found = State(*(x[here] for x in state))
            equations = self.equations
            if active is not None:
                equations, found = (
                    active.equations,
                    found._replace(lam=active.select_multipliers(found.lam)),
                )
            rows[here] = measures.balance_rows(equations)(times[here], *found)[:, -2:]
        return dict(zip(measures.DRIFT_COLUMNS, rows.T, strict=True))

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
            "events": [one.plain for one in self.event_records],
            "warnings": list(self.warnings),
            "end": self._end,
            "equations": describe_provenance(self.equations),
            **further,
        }
