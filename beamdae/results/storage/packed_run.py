"""Packed runs: data of a run as arrays and plain values, for files and other processes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from beamdae.equations.assembly.configurations import Configuration
from beamdae.equations.equations_of_motion import EquationsOfMotion, Start, State
from beamdae.parts.joints.event_constraints import FrozenGap
from beamdae.results.event_records import EventRecord
from beamdae.results.outcome import Statistics, Status
from beamdae.results.run_data import RunData
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray


class PackedRun(NamedTuple):
    """Data of a run without its equations and its integrator.

    Attributes
    ----------
    arrays
        Output times, states at the nodes of all intervals, states at the events, and the start.
    plain
        The remaining data as JSON-compatible values.
    """

    arrays: dict[str, Array]
    plain: dict[str, Any]


def pack_run(run: RunData) -> PackedRun:
    """Pack all data of a run except its equations and its integrator."""
    e, intervals, records = run.equations, run.trajectory.intervals, run.event_records
    sizes = (e.n, e.n, e.n, e.m)
    arrays = {
        "t": run.t,
        "q0": e.q0,
        "v0": e.v0,
        "nodes": np.concatenate([interval.nodes for interval in intervals]),
        "ends": np.cumsum([0, *(len(interval.nodes) for interval in intervals)]),
        "branches": np.array([interval.branch for interval in intervals]),
        "event times": np.array([(record.t, record.branch) for record in records]).reshape(-1, 2),
        **_stack_states("", [interval.rows for interval in intervals], sizes),
        **_stack_states("event ", [[x[None] for x in record.state] for record in records], sizes),
    }
    plain = {
        "status": asdict(run.status),
        "statistics": asdict(run.statistics),
        "integrator": run.integrator,
        "model": run.model,
        "per step": [interval.nodes_per_step for interval in intervals],
        "active": [_pack_configuration(interval.configuration) for interval in intervals],
        "events": [_pack_event(record) for record in records],
        "sides": run.event_signs,
        "begun": list(run.resume_warnings),
        "start": None,
    }
    if e.start is not None:
        arrays |= {"start q": e.start.q, "start v": e.start.v}
        plain["start"] = {"told": e.start.description, "moves": e.start.moves}
    return PackedRun(arrays, plain)


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
    start = plain["start"]
    if start is not None:
        start = Start(start["told"], arrays["start q"], arrays["start v"], start["moves"])
    equations = replace(equations, q0=arrays["q0"], v0=arrays["v0"], start=start)
    intervals = [
        Interval(
            arrays["nodes"][first:last],
            State(*(arrays[name][first:last] for name in State._fields)),
            float(branch),
            nodes_per_step,
            _unpack_configuration(equations, active),
        )
        for (first, last), branch, nodes_per_step, active in zip(
            pairwise(arrays["ends"].tolist()),
            arrays["branches"],
            plain["per step"],
            plain["active"],
            strict=True,
        )
    ]
    records = [
        EventRecord(
            t=float(t),
            branch=float(branch),
            state=State(*(arrays[f"event {name}"][k] for name in State._fields)),
            **event,
        )
        for k, ((t, branch), event) in enumerate(
            zip(arrays["event times"], plain["events"], strict=True)
        )
    ]
    return {
        "equations": equations,
        "trajectory": Trajectory(tuple(intervals)),
        "t": arrays["t"],
        "status": Status(**plain["status"]),
        "statistics": Statistics(**plain["statistics"]),
        "integrator": plain["integrator"],
        "model": plain["model"],
        "event_records": tuple(records),
        "event_signs": plain["sides"],
        "resume_warnings": tuple(plain["begun"]),
    }


def _stack_states(
    prefix: str, states: Sequence[Sequence[Array]], sizes: Sequence[int]
) -> Mapping[str, Array]:
    """Concatenate the rows of several states into one array per field of `State`."""
    columns = zip(*states, strict=True) if states else [()] * len(sizes)
    return {
        f"{prefix}{name}": np.concatenate([np.zeros((0, size)), *column])
        for name, size, column in zip(State._fields, sizes, columns, strict=True)
    }


def _pack_configuration(configuration: Configuration | None) -> dict[str, Any] | None:
    if configuration is None:
        return None
    gaps = {name: gap.to_record() for name, gap in configuration.frozen_gaps.items()}
    return {"inactive": sorted(configuration.inactive), "found": gaps}


def _unpack_configuration(equations: EquationsOfMotion, packed: Any) -> Configuration | None:
    configurations = equations.configurations
    if packed is None or configurations is None:
        return None
    gaps = {name: FrozenGap.from_record(record) for name, record in packed["found"].items()}
    return configurations.configuration_without(equations, frozenset(packed["inactive"]), gaps)


def _pack_event(record: EventRecord) -> dict[str, Any]:
    names = ("name", "direction", "energy_lost", "done")
    return {**{name: getattr(record, name) for name in names}, "impulses": dict(record.impulses)}
