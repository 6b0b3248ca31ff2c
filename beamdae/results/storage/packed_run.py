"""All a run computed as arrays and plain values, to be kept in a file or sent to a process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.equations.assembly.configurations import Configuration
from beamdae.equations.equations_of_motion import EquationsOfMotion, Start, State
from beamdae.parts.joints.event_constraints import FrozenGap
from beamdae.results.event_records import EventRecord
from beamdae.results.outcome import Statistics, Status
from beamdae.results.trajectory import Interval, Trajectory

if TYPE_CHECKING:
    from beamdae.results.solution import Solution

Array = np.ndarray


class PackedRun(NamedTuple):
    """Arrays and plain values (of JSON) a solution can be made of anew, given its equations."""

    arrays: dict[str, Array]
    plain: dict[str, Any]


def pack_run(solution: Solution) -> PackedRun:
    """All of a solution but its equations."""
    e, intervals = solution.equations, solution.trajectory.intervals
    sizes = (e.n, e.n, e.n, e.m)
    arrays = {
        "t": solution.t,
        "q0": e.q0,
        "v0": e.v0,
        "nodes": np.concatenate([x.nodes for x in intervals]),
        "ends": np.cumsum([0, *(len(x.nodes) for x in intervals)]),
        "branches": np.array([x.branch for x in intervals]),
        "event times": np.array([(x.t, x.branch) for x in solution.event_records]).reshape(-1, 2),
        **_rows("", [x.rows for x in intervals], sizes),
        **_rows("event ", [[row[None] for row in x.state] for x in solution.event_records], sizes),
    }
    plain = {
        "status": asdict(solution.status),
        "statistics": asdict(solution.statistics),
        "integrator": solution.integrator,
        "model": solution.model,
        "per step": [x.per_step for x in intervals],
        "active": [_active(x.configuration) for x in intervals],
        "events": [_event(x) for x in solution.event_records],
        "sides": solution.event_signs,
        "begun": list(solution.resume_warnings),
        "start": None,
    }
    if e.start is not None:
        arrays |= {"start q": e.start.q, "start v": e.start.v}
        plain["start"] = {"told": e.start.told, "moves": e.start.moves}
    return PackedRun(arrays, plain)


def unpack_run(equations: EquationsOfMotion, kept: PackedRun, made_by: Any = None) -> Solution:
    """The solution again, of equations that are the same but for their start."""
    from beamdae.results.solution import Solution

    arrays, plain = kept
    start = plain["start"]
    if start is not None:
        start = Start(start["told"], arrays["start q"], arrays["start v"], start["moves"])
    equations = replace(equations, q0=arrays["q0"], v0=arrays["v0"], start=start)
    intervals = [
        Interval(
            arrays["nodes"][first:last],
            State(*(arrays[name][first:last] for name in State._fields)),
            float(branch),
            per_step,
            _configuration(equations, active),
        )
        for (first, last), branch, per_step, active in zip(
            pairwise(arrays["ends"].tolist()),
            arrays["branches"],
            plain["per step"],
            plain["active"],
            strict=True,
        )
    ]
    event_records = tuple(
        EventRecord(
            t=float(t),
            branch=float(branch),
            state=State(*(arrays[f"event {name}"][k] for name in State._fields)),
            **told,
        )
        for k, ((t, branch), told) in enumerate(
            zip(arrays["event times"], plain["events"], strict=True)
        )
    )
    return Solution(
        equations=equations,
        trajectory=Trajectory(tuple(intervals)),
        t=arrays["t"],
        status=Status(**plain["status"]),
        statistics=Statistics(**plain["statistics"]),
        integrator=plain["integrator"],
        model=plain["model"],
        made_by=made_by,
        event_records=event_records,
        event_signs=plain["sides"],
        resume_warnings=tuple(plain["begun"]),
    )


def _rows(
    prefix: str, states: Sequence[Sequence[Array]], sizes: Sequence[int]
) -> Mapping[str, Array]:
    columns = zip(*states, strict=True) if states else [()] * len(sizes)
    return {
        f"{prefix}{name}": np.concatenate([np.zeros((0, size)), *column])
        for name, size, column in zip(State._fields, sizes, columns, strict=True)
    }


def _active(configuration: Configuration | None) -> dict[str, Any] | None:
    if configuration is None:
        return None
    found = {name: asdict(held) for name, held in configuration.frozen_gaps.items()}
    return {"inactive": sorted(configuration.inactive), "found": found}


def _configuration(equations: EquationsOfMotion, active: Any) -> Configuration | None:
    known = equations.configurations
    if active is None or known is None:
        return None
    found = {
        name: FrozenGap(tuple(x["found"]), x["event"], x["since"])
        for name, x in active["found"].items()
    }
    return known.configuration_without(equations, frozenset(active["inactive"]), found)


def _event(one: EventRecord) -> dict[str, Any]:
    told = {name: getattr(one, name) for name in ("name", "direction", "energy_lost", "done")}
    return {**told, "impulses": dict(one.impulses)}
