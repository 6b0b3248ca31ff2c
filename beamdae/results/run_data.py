"""Data of a run as arrays: states at the output times and quantities derived from them.

At the steps and stages, elastic forces are in equilibrium with the loads. Between them,
interpolated positions have errors within the tolerance, which deform stiff parts: the axial force
at the clamp of a thin blade was wrong by 93 % of its largest value, the force of a stiff bushing by
49 %. Interpolated forces are as accurate as accelerations and reactions. Quantities with kinks,
which polynomials overshoot, follow from the positions: magnitudes, such as the largest stress, the
force of a contact, and formulas of the user. Events monitor the interpolated forces, too.

This module does not import pandas, because importing pandas takes as long as a short run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from beamdae import deferred
from beamdae.beams.beam import beams_of
from beamdae.equations import measures
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.measures import ObservedRows
from beamdae.read_only import read_only_data
from beamdae.results.column_derivatives import ColumnDerivatives
from beamdae.results.columns import UNITS_OF_ACCELERATIONS, ColumnDict, Header
from beamdae.results.energy_balance import EnergyLedger, Quality, is_at_rest
from beamdae.results.outcome import EventRecord, Statistics, Status
from beamdae.results.singular_positions import (
    SingularPosition,
    find_singular_positions,
)
from beamdae.results.start_changes import StartSummary, compare_start
from beamdae.results.step_extremes import (
    StepExtremes,
    StepMeasures,
    may_have_short_peaks,
    measure_means,
    measure_mechanism,
    measure_steps,
    refine_extremes,
)
from beamdae.results.storage.files import versions as installed_versions
from beamdae.results.trajectory import Trajectory
from beamdae.symbolic.statements import Variable

Array = np.ndarray


# Coordinates of the rows at which columns are evaluated together [bytes]; their local coordinates
# take as much again.
_MAX_BLOCK_BYTES = 2.5e7
_MAX_CACHED_BYTES = 1e8  # of states at the output times that are kept after columns are evaluated


@read_only_data
@dataclass(frozen=True, repr=False)
class RunData:
    """Data of a run; `Solution` documents the attributes and adds tables, files and figures."""

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
    loaded_versions: dict[str, str] = field(default_factory=dict, repr=False)
    derivatives: ColumnDerivatives | None = field(default=None, repr=False)

    @property
    def versions(self) -> dict[str, str]:
        """Versions of beamdae and of the other packages with which the run was computed."""
        return dict(self.loaded_versions or installed_versions())

    @property
    def label(self) -> str:
        """Short name of the integrator."""
        return str(getattr(self.made_by, "label", self.integrator.get("integrator", "run")))

    @property
    def q(self) -> Array:
        """Coordinates (k, n) at the output times [m or rad]."""
        return self._output[1].q

    @property
    def v(self) -> Array:
        """Velocities (k, n) at the output times [m/s or rad/s]."""
        return self._output[1].v

    @property
    def a(self) -> Array:
        """Accelerations (k, n) at the output times [m/s^2 or rad/s^2]."""
        return self._output[1].a

    @property
    def lam(self) -> Array:
        """Lagrange multipliers (k, m) at the output times [N or N m]."""
        return self._output[1].lam

    @cached_property
    def _output(self) -> tuple[Array, State]:
        return self.trajectory.at(self.t, limited=True)

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Observed columns (k,) at the output times, by header."""
        e = self.equations
        headers = e.observed_headers
        if not headers:
            return {}
        count, blocks = self._rows_at_once, []
        for k in range(0, max(len(self.t), 1), count):
            times, state = self._states_of_rows(slice(k, k + count))
            blocks.append(self._observe(times, *state))
        rows = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
        self._interpolate_elastic(self.t, rows)
        return dict(zip(headers, rows.T, strict=True))

    def _observe(self, times: Array, *state: Array) -> Array:
        """Return rows of the observed columns at rows of (t, branch) and of states."""
        e = self.equations
        rows = np.zeros((len(times), sum(len(o.columns) for o in e.observables)))
        for configuration, here in self.trajectory.by_configuration(times[:, 0]):
            observe = measures.ObservedRows(e.with_loads_of(configuration))
            if here.all():
                # A selection would copy the states.
                return observe(times, *state)
            rows[here] = observe(times[here], *(x[here] for x in state))
        return rows

    @cached_property
    def step_extremes(self) -> ColumnDict:
        """Extremes of the observed columns over all steps and rows, by header or name of a column.

        They include peaks between the rows and, with adaptive steps, between the steps. Columns
        that are not finite at a step are omitted, and so are accelerations in models with beams and
        without abrupt forces, such as contacts: at the steps after a sudden load, they contain
        transients of the beams that are not resolved.
        """
        e, measures = self.equations, self._step_measures
        has_transients = bool(beams_of(e.mechanism)) and not may_have_short_peaks(e)
        omitted_units = UNITS_OF_ACCELERATIONS if has_transients else ()
        (low, high), (low_times, high_times) = measures.values, measures.times
        numbers = np.stack([low, low_times, high, high_times, measures.rms], axis=1)
        return ColumnDict(
            {
                header: StepExtremes(*x)
                for header, x in zip(e.observed_headers, numbers.tolist(), strict=True)
                if Header.of(header).unit not in omitted_units and np.isfinite([x[0], x[2]]).all()
            }
        )

    @cached_property
    def _step_measures(self) -> StepMeasures:
        """Columns at the steps and the rows, with extremes between adaptive steps."""
        arguments = self.equations, self.trajectory, self.t, self.columns, self._magnitudes
        measures = measure_steps(*arguments)
        has_fixed_steps = self.integrator.get("rtol") is None
        if has_fixed_steps or not self.trajectory.stores_all_steps:
            return measures
        times, values = self._refine(measures.times, measures.values)
        return measures._replace(times=times, values=values)

    @property
    def _magnitudes(self) -> list[str]:
        """Headers of the columns of which only the largest value matters."""
        observables = self.equations.observables
        return [header for o in observables if o.is_magnitude for header in o.headers]

    def _refine(self, times: Array, values: Array) -> tuple[Array, Array]:
        """Return the times and the values of extremes with those between steps and rows."""
        nodes = np.concatenate([self.t, *(x.t for x in self.trajectory.intervals)])
        return refine_extremes(times, values, np.unique(nodes), self._observe_at)

    @cached_property
    def _sizes_of_mechanism(self) -> dict[str, float]:
        """Sizes of the rates and the reactions of all parts, see `measure_mechanism`."""
        return measure_mechanism(self.equations, self.trajectory)

    @cached_property
    def _column_ranges(self) -> ColumnDict:
        """Extremes of each observed column, including peaks between steps and rows, by header.

        Amplitudes of periodic motions must not depend on the number of output rows. Of columns
        without `step_extremes`, only the rows are considered.
        """
        if not self.columns:
            return ColumnDict()
        _, values = self._refine(self._step_measures.times, self._step_measures.values)
        at_steps = np.isin(list(self.columns), list(self.step_extremes))
        if not at_steps.all():
            rows = np.column_stack(list(self.columns.values()))
            times = self.t[np.stack([np.argmin(rows, axis=0), np.argmax(rows, axis=0)])]
            extremes = np.stack([np.min(rows, axis=0), np.max(rows, axis=0)])
            _, of_rows = refine_extremes(times, extremes, self.t, self._observe_at)
            values = np.where(at_steps, values, of_rows)
        return ColumnDict(dict(zip(self.columns, values.T.tolist(), strict=True)))

    @cached_property
    def _column_means(self) -> ColumnDict:
        """Mean of each observed column over the run, by header."""
        means = measure_means(self.trajectory, len(self.columns), self._observe)
        return ColumnDict(dict(zip(self.columns, means.tolist(), strict=True)))

    @cached_property
    def missed_peaks(self) -> ColumnDict:
        """Largest miss of the rows of each column that they miss by more than 4 %, by header.

        The entries have the attributes of `model_checks.run_checks.MissedPeak`.
        """
        return deferred.module("model_checks.run_checks").find_missed_peaks(self)

    def all_columns(self) -> dict[str, Array]:
        """Return the columns (k,) of `table` by header."""
        ledger = zip(measures.LEDGER_COLUMNS, self._ledger_rows.T, strict=True)
        derivatives = self.derivatives and self.derivatives.at_times(self.t).columns()
        return {measures.TIME: self.t, **self.columns, **(derivatives or {}), **dict(ledger)}

    @cached_property
    def drift_columns(self) -> dict[str, Array]:
        """Largest |g| and |g_dot| of the active joints (k,) at the output times, by header.

        The units are m or rad, and m/s or rad/s.
        """
        times, state = self._output
        intervals, index = self.trajectory.intervals, self.trajectory.interval_index(self.t)
        configurations = [interval.configuration for interval in intervals]
        rows = np.zeros((len(times), len(measures.DRIFT_COLUMNS)))
        for configuration in dict.fromkeys(configurations):
            here = np.array([x is configuration for x in configurations])[index]
            active, states = self.equations, State(*(x[here] for x in state))
            if configuration is not None:
                active = configuration.equations
                states = states._replace(lam=configuration.select_multipliers(states.lam))
            rows[here] = measures.BalanceRows(active)(times[here], *states)[:, -2:]
        return dict(zip(measures.DRIFT_COLUMNS, rows.T, strict=True))

    @cached_property
    def _drift(self) -> tuple[float, float]:
        """Largest drift [m, m/s] at the steps and the output times, between which it is larger."""
        at_steps = self.quality.max_position_drift, self.quality.max_velocity_drift
        at_rows = self.drift_columns.values()
        position, velocity = (
            float(np.max(x, initial=y)) for x, y in zip(at_rows, at_steps, strict=True)
        )
        return position, velocity

    @cached_property
    def quality(self) -> Quality:
        """Largest residual, drift and energy imbalance over all steps."""
        return self._energy_ledger.quality

    @cached_property
    def start(self) -> StartSummary:
        """Requested start, and its changes per part to satisfy the joints."""
        first = self.trajectory.intervals[0].rows
        return compare_start(self.equations, State(*(rows[0] for rows in first)))

    @cached_property
    def singular_positions(self) -> tuple[SingularPosition, ...]:
        """Positions at which the joint constraints lost rank and the motion may branch."""
        return find_singular_positions(self.equations, self.trajectory)

    @cached_property
    def _is_at_rest(self) -> bool:
        return is_at_rest(self.equations, self.trajectory, self._energy_ledger.largest_force)

    def _observe_at(self, times: Array) -> Array:
        """Return rows of the observed columns at ascending times [s]."""
        rows, state = self.trajectory.at(times, limited=True)
        columns = self._observe(rows, *state)
        self._interpolate_elastic(times, columns)
        return columns

    def _observe_events(self, times: Array, *state: Array) -> Array:
        """Return rows of the observed columns at rows of (t, branch) and of states at events."""
        columns = self._observe(times, *state)
        # Further events at the same time follow jumps of velocities.
        (first,) = np.nonzero(np.diff(times[:, 0], prepend=-np.inf))
        of_first = columns[first]
        self._interpolate_elastic(times[first, 0], of_first)
        columns[first] = of_first
        return columns

    def _interpolate_elastic(self, times: Array, columns: Array) -> None:
        """Replace elastic forces between steps, see the module."""
        indices, values = self._elastic_at_nodes
        index = self.trajectory.interval_index(times)
        for k, interval in enumerate(self.trajectory.intervals if len(indices) else ()):
            (here,) = np.nonzero(index == k)
            # The nodes of intervals that store only some of their steps are rows.
            if interval.record is None and len(here):
                forces = interval.interpolate_forces(values[k], times[here])
                columns[here[:, None], indices] = forces

    @cached_property
    def _elastic_at_nodes(self) -> tuple[Array, Sequence[Array]]:
        """Indices of the elastic columns, and their values (k, c) at the nodes of each interval.

        See `Quantity.is_elastic`.
        """
        e, count = self.equations, self._rows_at_once
        counts = [len(x.columns) for x in e.observables]
        (indices,) = np.nonzero(np.repeat([x.is_elastic for x in e.observables], counts))
        if not len(indices):
            return indices, []
        observables = tuple(x for x in e.observables if x.is_elastic)
        intervals = self.trajectory.intervals
        observers = {
            inactive: ObservedRows(replace(e.without_loads_of(inactive), observables=observables))
            for inactive in {x.inactive for x in intervals}
        }
        values = []
        for x in intervals:
            blocks = []
            for first in range(0, len(x.nodes), count):
                rows = slice(first, first + count)
                blocks.append(observers[x.inactive](x.times[rows], *(y[rows] for y in x.rows)))
            values.append(np.concatenate(blocks))
        return indices, values

    def summary(self) -> dict[str, Any]:
        """Return status, last time [s], statistics and quality as a flat dictionary."""
        return {
            "success": self.status.success,
            "status": self.status.kind,
            "reason": self.status.sentence,
            "last_time": self.trajectory.end,
            **asdict(self.statistics),
            **asdict(self.quality),
        }

    @cached_property
    def _ledger_rows(self) -> Array:
        return self._energy_ledger.at(self.t)

    @cached_property
    def _energy_ledger(self) -> EnergyLedger:
        return EnergyLedger.of(self.equations, self.trajectory)

    def _states_of_rows(self, rows: slice) -> tuple[Array, State]:
        """Return rows (t, branch) and the states at some of the output times."""
        # States between the steps of a large model would take as much memory as the run.
        is_large = self._row_bytes * len(self.t) > _MAX_CACHED_BYTES
        if is_large and "_output" not in vars(self):
            return self.trajectory.at(self.t[rows], limited=True)
        times, state = self._output
        return times[rows], State(*(x[rows] for x in state))

    @property
    def _rows_at_once(self) -> int:
        return max(int(_MAX_BLOCK_BYTES / self._row_bytes), 1)

    @property
    def _row_bytes(self) -> int:
        return sum(x[:1].nbytes for x in self.trajectory.intervals[0].rows)


def coordinate_headers(equations: EquationsOfMotion) -> list[str]:
    """Return the headers of `Solution.coordinate_columns`: time, then (q, v, lam)."""
    columns = [
        *equations.coordinates,
        *(coordinate.rate for coordinate in equations.coordinates),
        *(Variable(f"lam.{x.name}", x.unit) for x in equations.multipliers),
    ]
    return [measures.TIME, *(column.header for column in columns)]
