"""Packed runs: data of a run as arrays and plain values, for files and other processes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np

from beamdae.equations.assembly.configurations import Configuration
from beamdae.equations.equations_of_motion import EquationsOfMotion, Start, State
from beamdae.parts.joints.event_constraints import FrozenGap
from beamdae.results.column_derivatives import ColumnDerivatives
from beamdae.results.outcome import EventRecord, Statistics, Status
from beamdae.results.run_data import RunData
from beamdae.results.storage.documents import ContentError
from beamdae.results.trajectory import Interval, StepRecord, Trajectory

Array = np.ndarray

_DERIVATIVES = "derivatives"  # array with one row per parameter, column and output time


@dataclass(frozen=True)
class _Configuration:
    inactive: list[str]
    frozen_gaps: dict[str, FrozenGap]


@dataclass(frozen=True)
class _Interval:
    """An interval; its nodes, states and energies follow those of the previous one in arrays."""

    nodes: int
    branch: float
    nodes_per_step: int
    configuration: _Configuration | None
    recorded_nodes: int = 0
    recorded_nodes_per_step: int = 1


@dataclass(frozen=True)
class _DerivedColumns:
    """Parameters with their values, and headers of the derivatives of `ColumnDerivatives`."""

    parameters: dict[str, float]
    observed: list[str]
    coordinates: list[str]


@dataclass(frozen=True)
class PlainRun:
    """Data of a run that are no arrays; for the fields, see `RunData`."""

    status: Status
    statistics: Statistics
    integrator: dict[str, Any]
    model: dict[str, Any]
    intervals: list[_Interval]
    events: list[EventRecord]
    event_signs: dict[str, int]
    resume_warnings: list[str]
    versions: dict[str, str]
    start: Start | None
    derivatives: _DerivedColumns | None


class PackedRun(NamedTuple):
    """Data of a run without its equations and its integrator.

    Attributes
    ----------
    arrays
        Output times, nodes of all intervals and the states there, the start, the `StepRecord` of
        long runs, and derivatives of the columns.
    plain
        The remaining data.
    """

    arrays: dict[str, Array]
    plain: PlainRun


def pack_run(run: RunData) -> PackedRun:
    """Pack all data of a run except its equations and its integrator."""
    e, intervals = run.equations, run.trajectory.intervals
    records = [x.record for x in intervals if x.record is not None]
    arrays = {
        "t": run.t,
        "q0": e.q0,
        "v0": e.v0,
        "nodes": np.concatenate([x.nodes for x in intervals]),
        **{k: np.concatenate([getattr(x.rows, k) for x in intervals]) for k in State._fields},
    }
    if records:
        arrays["record nodes"] = np.concatenate([x.nodes for x in records])
        arrays["record values"] = np.concatenate([x.values for x in records])
    derivatives = None
    if run.derivatives is not None:
        by_time = run.derivatives.at_times(run.t)
        derivatives = _DerivedColumns(
            {name: float(x) for name, x in by_time.parameters.items()},
            *(list(next(iter(x.values()))) for x in (by_time.observed, by_time.coordinates)),
        )
        arrays[_DERIVATIVES] = np.array(
            [
                [*by_time.observed[name].values(), *by_time.coordinates[name].values()]
                for name in by_time.parameters
            ]
        )
    plain = PlainRun(
        status=run.status,
        statistics=run.statistics,
        integrator=run.integrator,
        model=run.model,
        intervals=[_pack_interval(x) for x in intervals],
        events=list(run.event_records),
        event_signs=run.event_signs,
        resume_warnings=list(run.resume_warnings),
        versions=run.versions,
        start=None if e.start is None else e.start._replace(request=None),
        derivatives=derivatives,
    )
    return PackedRun(arrays, plain)


def _pack_interval(interval: Interval) -> _Interval:
    configuration, record = interval.configuration, interval.record
    return _Interval(
        len(interval.nodes),
        float(interval.branch),
        interval.nodes_per_step,
        None
        if configuration is None
        else _Configuration(sorted(configuration.inactive), dict(configuration.frozen_gaps)),
        *(() if record is None else (len(record.nodes), record.nodes_per_step)),
    )


def unpack_fields(equations: EquationsOfMotion, packed: PackedRun) -> dict[str, Any]:
    """Return the arguments of `RunData` for a packed run, except `made_by`.

    Parameters
    ----------
    equations
        The equations of the run; their start may differ.
    packed
        Output of `pack_run`; it contains the start of the run.
    """
    arrays, plain = packed
    return {
        "equations": replace(equations, q0=arrays["q0"], v0=arrays["v0"], start=plain.start),
        "trajectory": unpack_trajectory(packed, equations),
        "t": arrays["t"],
        "status": plain.status,
        "statistics": plain.statistics,
        "integrator": plain.integrator,
        "model": plain.model,
        "event_records": tuple(map(replace, plain.events)),
        "event_signs": plain.event_signs,
        "resume_warnings": tuple(plain.resume_warnings),
        "loaded_versions": plain.versions,
        "derivatives": unpack_derivatives(packed),
    }


def unpack_derivatives(packed: PackedRun) -> ColumnDerivatives | None:
    """Return the derivatives of the columns of a packed run, or None."""
    columns = packed.plain.derivatives
    if columns is None:
        return None
    rows, count = packed.arrays[_DERIVATIVES], len(columns.observed)
    by_name = dict(zip(columns.parameters, rows, strict=True))
    return ColumnDerivatives(
        packed.arrays["t"],
        columns.parameters,
        {k: dict(zip(columns.observed, x[:count], strict=True)) for k, x in by_name.items()},
        {k: dict(zip(columns.coordinates, x[count:], strict=True)) for k, x in by_name.items()},
    )


def unpack_trajectory(packed: PackedRun, equations: EquationsOfMotion) -> Trajectory:
    """Return the trajectory of a packed run."""
    arrays, intervals = packed.arrays, packed.plain.intervals
    rows = _slices([x.nodes for x in intervals])
    recorded_rows = _slices([x.recorded_nodes for x in intervals])
    return Trajectory(
        tuple(
            Interval(
                arrays["nodes"][here],
                State(*(arrays[name][here] for name in State._fields)),
                x.branch,
                x.nodes_per_step,
                _unpack_configuration(equations, x.configuration),
                StepRecord(
                    arrays["record nodes"][recorded],
                    arrays["record values"][recorded],
                    x.recorded_nodes_per_step,
                )
                if x.recorded_nodes
                else None,
            )
            for x, here, recorded in zip(intervals, rows, recorded_rows, strict=True)
        )
    )


def _slices(counts: Sequence[int]) -> list[slice]:
    """Return the rows of consecutive blocks with these numbers of rows."""
    return [slice(*ends) for ends in pairwise(accumulate(counts, initial=0))]


def _unpack_configuration(
    equations: EquationsOfMotion, packed: _Configuration | None
) -> Configuration | None:
    if packed is None:
        return None
    configurations = equations.configurations
    if configurations is None:
        raise ContentError("parts of the run were switched, but no event of the model does this")
    inactive = frozenset(packed.inactive)
    return configurations.configuration_without(equations, inactive, packed.frozen_gaps)
