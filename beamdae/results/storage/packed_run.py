"""Packed runs: data of a run as arrays and plain values, for files and other processes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from itertools import pairwise
from typing import Any, NamedTuple, get_args

import numpy as np

from beamdae.equations.assembly.configurations import Configuration
from beamdae.equations.equations_of_motion import EquationsOfMotion, Start, State
from beamdae.equations.measures import N_BALANCE_VALUES
from beamdae.equations.smooth_intervals import SAME_TIME
from beamdae.parts.joints.event_constraints import FrozenGap
from beamdae.results import column_derivatives
from beamdae.results.column_derivatives import ColumnDerivatives
from beamdae.results.event_records import DOWN, UP, EventRecord
from beamdae.results.outcome import Kind, Statistics, Status
from beamdae.results.run_data import RunData
from beamdae.results.storage.schema import (
    ArrayRule,
    FieldError,
    anything,
    choice,
    flag,
    integer,
    mapping,
    number,
    optional,
    record,
    require_ascending,
    require_equal,
    sequence,
    start_value,
    text,
)
from beamdae.results.trajectory import Interval, StepRecord, Trajectory

Array = np.ndarray

_MAX_STAGES = 10  # nodes per step; Radau has 3

# Rule for `FrozenGap.to_record`.
GAP = record({"found": sequence(start_value), "event": text, "since": start_value})
_CONFIGURATION = record({"inactive": sequence(text), "found": mapping(GAP)})
_STATUS = record({"kind": choice(*get_args(Kind)), "sentence": text})
_STATISTICS = record(
    {f.name: integer(0) if f.type == "int" else number(0.0) for f in fields(Statistics)}
)
_EVENT = record(
    {
        "name": text,
        "direction": choice(UP, DOWN),
        "energy_lost": number(finite=False),
        "done": flag,
        "impulses": mapping(number(finite=False)),
    }
)
# Rule for `PackedRun.plain`, see `pack_run`.
PLAIN = record(
    {
        "status": _STATUS,
        "statistics": _STATISTICS,
        "integrator": record({"integrator": text}, others=True),
        "model": record({}, {"name": text, "parameters": mapping(anything)}, others=True),
        "per step": sequence(integer(1, _MAX_STAGES)),
        "active": sequence(optional(_CONFIGURATION)),
        "events": sequence(_EVENT),
        "sides": mapping(choice(-1, 0, 1)),
        "begun": sequence(text),
        "start": optional(record({"told": text, "moves": flag}, {"closed": flag})),
        "versions": mapping(text),
    },
    {
        "recorded": sequence(integer(0, _MAX_STAGES)),
        column_derivatives.ARRAY: column_derivatives.RECORD,
    },
)


class PackedRun(NamedTuple):
    """Data of a run without its equations and its integrator.

    Attributes
    ----------
    arrays
        Output times, nodes of all intervals and the states there, times and states of the events,
        the start, the `StepRecord` of long runs, and derivatives of the columns.
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
        "versions": run.versions,
        "start": None,
    }
    step_records = [interval.record for interval in intervals]
    if any(step_records):
        # Nodes per step; 0 for intervals that store all steps.
        plain["recorded"] = [0 if x is None else x.nodes_per_step for x in step_records]
        present = [x for x in step_records if x is not None]
        sizes_of_records = (0 if x is None else len(x.nodes) for x in step_records)
        arrays |= {
            "record ends": np.cumsum([0, *sizes_of_records]),
            "record nodes": np.concatenate([x.nodes for x in present]),
            "record values": np.concatenate([x.values for x in present]),
        }
    if run.derivatives is not None:
        name, derivatives = column_derivatives.ARRAY, run.derivatives.at_times(run.t)
        plain[name], arrays[name] = derivatives.to_record()
    if e.start is not None:
        arrays |= {"start q": e.start.q, "start v": e.start.v}
        start = {"told": e.start.description, "moves": e.start.moves}
        if e.start.closed_q is not None:
            start["closed"] = True
            arrays["start closed q"] = e.start.closed_q
        plain["start"] = start
    return PackedRun(arrays, plain)


def unpack_fields(equations: EquationsOfMotion, packed: PackedRun) -> dict[str, Any]:
    """Return the arguments of `RunData` for a packed run, except `made_by`.

    Parameters
    ----------
    equations
        The equations of the run; their start may differ.
    packed
        Output of `pack_run`; it contains the start of the run.

    Raises
    ------
    FieldError
        If the numbers of coordinates or multipliers differ from the equations, or parts were
        switched that the equations cannot switch.
    """
    arrays, plain = packed
    require_equal("q0", len(arrays["q0"]), "the number of coordinates of the model", equations.n)
    require_equal("lam", arrays["lam"].shape[1], "the number of multipliers", equations.m)
    for k, active in enumerate(plain["active"]):
        if active and equations.configurations is None and any(active.values()):
            raise FieldError(
                "contains inactive parts, but no event switches parts", str(k), "active"
            )
    start = plain["start"]
    if start is not None:
        closed_q = arrays["start closed q"] if start.get("closed") else None
        request = (arrays["start q"], arrays["start v"], start["moves"], closed_q)
        start = Start(start["told"], *request)
    equations = replace(equations, q0=arrays["q0"], v0=arrays["v0"], start=start)
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
        "trajectory": unpack_trajectory(packed, equations),
        "t": arrays["t"],
        "status": Status(**plain["status"]),
        "statistics": Statistics(**plain["statistics"]),
        "integrator": plain["integrator"],
        "model": plain["model"],
        "event_records": tuple(records),
        "event_signs": plain["sides"],
        "resume_warnings": tuple(plain["begun"]),
        "loaded_versions": plain["versions"],
        "derivatives": unpack_derivatives(packed),
    }


def unpack_derivatives(packed: PackedRun) -> ColumnDerivatives | None:
    """Return the derivatives of the columns of a packed run, or None."""
    arrays, name = packed.arrays, column_derivatives.ARRAY
    if name not in arrays:
        return None
    return ColumnDerivatives.from_record(arrays["t"], packed.plain[name], arrays[name])


def unpack_trajectory(packed: PackedRun, equations: EquationsOfMotion | None = None) -> Trajectory:
    """Return the trajectory of a packed run; without `equations`, its configurations are None."""
    arrays, plain = packed
    return Trajectory(
        tuple(
            Interval(
                arrays["nodes"][first:last],
                State(*(arrays[name][first:last] for name in State._fields)),
                float(branch),
                nodes_per_step,
                None if equations is None else _unpack_configuration(equations, active),
                step_record,
            )
            for (first, last), branch, nodes_per_step, active, step_record in zip(
                pairwise(arrays["ends"].tolist()),
                arrays["branches"],
                plain["per step"],
                plain["active"],
                _unpack_step_records(packed),
                strict=True,
            )
        )
    )


def _unpack_step_records(packed: PackedRun) -> list[StepRecord | None]:
    arrays, plain = packed
    if "recorded" not in plain:
        return [None] * len(plain["active"])
    return [
        StepRecord(arrays["record nodes"][first:last], arrays["record values"][first:last], count)
        if count
        else None
        for (first, last), count in zip(
            pairwise(arrays["record ends"].tolist()), plain["recorded"], strict=True
        )
    ]


def array_rules(plain: dict[str, Any]) -> dict[str, ArrayRule]:
    """Return the rules for the arrays of a run, given its `PackedRun.plain`."""
    intervals, events = len(plain["active"]), len(plain["events"])
    rules = {
        "t": ArrayRule(("rows",)),
        "q0": ArrayRule(("n",)),
        "v0": ArrayRule(("n",)),
        "nodes": ArrayRule(("nodes",)),
        "ends": ArrayRule((intervals + 1,), "i"),
        "branches": ArrayRule((intervals,)),
        "event times": ArrayRule((events, 2)),
    }
    if plain["start"] is not None:
        rules |= {"start q": ArrayRule(("n",)), "start v": ArrayRule(("n",))}
        if plain["start"].get("closed"):
            rules["start closed q"] = ArrayRule(("n",))
    if column_derivatives.ARRAY in plain:
        rules |= column_derivatives.array_rules(plain[column_derivatives.ARRAY])
    if "recorded" in plain:
        rules |= {
            "record ends": ArrayRule((intervals + 1,), "i"),
            "record nodes": ArrayRule(("record nodes",)),
            "record values": ArrayRule(("record nodes", N_BALANCE_VALUES), finite=False),
        }
    for prefix, rows in (("", "nodes"), ("event ", events)):
        rules |= {f"{prefix}{name}": ArrayRule((rows, "n")) for name in ("q", "v", "a")}
        rules[f"{prefix}lam"] = ArrayRule((rows, "m"))
    return rules


def require_consistent(packed: PackedRun) -> None:
    """Raise FieldError unless times, intervals and events of a packed run form one run.

    Types and shapes must have been checked with `PLAIN` and `array_rules`.
    """
    arrays, plain = packed
    t, nodes, ends = (arrays[name] for name in ("t", "nodes", "ends"))
    if not (len(t) and len(plain["active"])):
        raise FieldError("must contain at least one time", "t")
    require_equal("per step", len(plain["per step"]), "the number of intervals", len(ends) - 1)
    require_ascending("ends", ends)
    if ends[0] != 0 or ends[-1] != len(nodes):
        raise FieldError(f"must begin with 0 and end with {len(nodes)}", "ends")
    require_ascending("t", t)
    if column_derivatives.ARRAY in plain:
        column_derivatives.require_consistent(plain[column_derivatives.ARRAY])
    begins = ends[1:-1]
    if (((np.diff(ends) - 1) % np.array(plain["per step"])) != 0).any():
        raise FieldError("must divide the number of nodes after the first", "per step")
    intervals = zip(np.split(nodes, begins), plain["per step"], strict=True)
    ascends = all(_are_steps(*interval) for interval in intervals)
    if (nodes[begins] != nodes[begins - 1]).any() or not ascends:
        raise FieldError("must ascend within each interval and continue the previous one", "nodes")
    if "recorded" in plain:
        _require_consistent_records(arrays, plain)
    rounding = SAME_TIME * abs(nodes[-1])
    for name, times in (("t", t), ("event times", arrays["event times"][:, 0])):
        if len(times) and not (
            nodes[0] - rounding <= times.min() and times.max() <= nodes[-1] + rounding
        ):
            raise FieldError(f"must lie within the run, {nodes[0]:g} to {nodes[-1]:g} s", name)


def _are_steps(nodes: Array, per_step: int) -> bool:
    """Return True if nodes ascend, except in steps of length zero, at samples of controllers."""
    differences = np.diff(nodes).reshape(-1, per_step)
    is_jump = (differences == 0.0).all(axis=1)
    return bool(((differences > 0.0).all(axis=1) | is_jump).all())


def _require_consistent_records(arrays: dict[str, Array], plain: dict[str, Any]) -> None:
    """Raise FieldError unless the records of steps belong to the intervals."""
    ends, record_ends, nodes = (arrays[x] for x in ("ends", "record ends", "record nodes"))
    require_equal("recorded", len(plain["recorded"]), "the number of intervals", len(ends) - 1)
    if record_ends[0] != 0 or record_ends[-1] != len(nodes) or (np.diff(record_ends) < 0).any():
        raise FieldError(f"must ascend from 0 to {len(nodes)}", "record ends")
    for k, count in enumerate(plain["recorded"]):
        t = nodes[record_ends[k] : record_ends[k + 1]]
        if not count and not len(t):
            continue
        stored = arrays["nodes"][ends[k] : ends[k + 1]]
        if not (count and len(t) and (len(t) - 1) % count == 0 and _are_steps(t, count)):
            raise FieldError("must ascend and contain complete steps", "record nodes")
        if t[0] != stored[0] or t[-1] != stored[-1]:
            raise FieldError("must cover the interval", "record nodes")


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
