"""Packed runs: data of a run as arrays and plain values, for files and other processes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.equations.assembly.configurations import Configuration
from beamdae.equations.equations_of_motion import EquationsOfMotion, Start, State
from beamdae.parts.joints.event_constraints import FrozenGap
from beamdae.results.column_derivatives import ColumnDerivatives
from beamdae.results.outcome import EventRecord, Statistics, Status
from beamdae.results.run_data import RunData
from beamdae.results.storage.documents import ContentError, as_plain
from beamdae.results.trajectory import Interval, StepRecord, Trajectory

Array = np.ndarray


@dataclass(frozen=True)
class _Configuration:
    inactive: list[str]
    frozen_gaps: dict[str, FrozenGap]


@dataclass(frozen=True)
class _Interval:
    """An interval, with the names of its inactive parts and its frozen gaps."""

    nodes: Array
    rows: State
    branch: float
    nodes_per_step: int
    configuration: _Configuration | None
    record: StepRecord | None


@dataclass(frozen=True)
class PackedRun:
    """Data of a run without its equations and its integrator; for the fields, see `Solution`."""

    t: Array
    q0: Array
    v0: Array
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
    derivatives: ColumnDerivatives | None


def pack_run(run: RunData) -> PackedRun:
    """Pack all data of a run except its equations and its integrator."""
    e, derivatives, intervals = run.equations, run.derivatives, []
    for x in run.trajectory.intervals:
        parts = None
        if x.configuration is not None:
            gaps = dict(x.configuration.frozen_gaps)
            parts = _Configuration(sorted(x.configuration.inactive), gaps)
        branch, per_step = float(x.branch), x.nodes_per_step
        intervals.append(_Interval(x.nodes, x.rows, branch, per_step, parts, x.record))
    return PackedRun(
        run.t,
        e.q0,
        e.v0,
        run.status,
        run.statistics,
        as_plain(run.integrator),
        as_plain(run.model),
        intervals,
        list(run.event_records),
        run.event_signs,
        list(run.resume_warnings),
        run.versions,
        None if e.start is None else e.start._replace(request=None),
        None if derivatives is None else replace(derivatives.at_times(run.t), evaluate=None),
    )


def unpack_fields(
    equations: EquationsOfMotion, packed: PackedRun, made_by: Any = None
) -> tuple[Any, ...]:
    """Return the fields of a `Solution` from the output of `pack_run`.

    Parameters
    ----------
    equations
        The equations of the run; their start may differ.
    packed
        The packed run, which contains the start.
    made_by
        The integrator of the run.
    """
    intervals = (
        Interval(
            x.nodes,
            x.rows,
            x.branch,
            x.nodes_per_step,
            _unpack_configuration(equations, x.configuration),
            x.record and replace(x.record),
        )
        for x in packed.intervals
    )
    return (
        replace(equations, q0=packed.q0, v0=packed.v0, start=packed.start),
        Trajectory(tuple(intervals)),
        packed.t,
        packed.status,
        packed.statistics,
        packed.integrator,
        packed.model,
        made_by,
        tuple(map(replace, packed.events)),
        packed.event_signs,
        tuple(packed.resume_warnings),
        packed.versions,
        packed.derivatives and replace(packed.derivatives),
    )


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
