"""Rules for the content of records: outcome, values, animation and trajectory of a run."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, get_args

import numpy as np
import pandas as pd

from beamdae.equations.measures import TIME
from beamdae.errors import format_distinct
from beamdae.results.outcome import Kind
from beamdae.results.storage.schema import (
    FieldError,
    Rule,
    choice,
    column_name,
    flag,
    integer,
    mapping,
    number,
    numbers,
    optional,
    record,
    require_ascending,
    scalar,
    sequence,
    text,
)
from beamdae.studies.column_measures import MEASURES
from beamdae.studies.run_values import (
    COUNT_COLUMNS,
    EVENTS_COLUMN,
    MAX_WALL_TIME_COLUMN,
    MEASURE_COLUMNS,
    MEASURED_ERROR_COLUMN,
    MEASURING_TIME_COLUMN,
    MIN_WALL_TIME_COLUMN,
    PEAK_MEMORY_COLUMN,
    REACHED_COLUMN,
    SETTING_COLUMNS,
    is_event_count,
    is_event_time,
    is_output,
)
from beamdae.studies.store.trajectory_csv import parse_trajectory
from beamdae.studies.tasks import MEASURED, Limits

_ROUNDING_OF_TIMES = 1e-9  # relative difference of the end time and the last row
_MIN_TIME_COLUMNS = (MIN_WALL_TIME_COLUMN, MAX_WALL_TIME_COLUMN, MEASURING_TIME_COLUMN)
_MEASURES = (*MEASURE_COLUMNS, MEASURED_ERROR_COLUMN, *_MIN_TIME_COLUMNS, PEAK_MEMORY_COLUMN)
_VALUES: dict[str, Rule] = {
    REACHED_COLUMN: number(0.0),
    "warnings": text,
    EVENTS_COLUMN: text,
    **dict.fromkeys(SETTING_COLUMNS, scalar),
    **dict.fromkeys(COUNT_COLUMNS, integer(0)),
    **dict.fromkeys(_MEASURES, number(finite=False)),
}


def _check_values(values: Any) -> None:
    mapping(scalar)(values)
    for name, value in values.items():
        try:
            if name in _VALUES:
                _VALUES[name](value)
            elif is_event_count(name):
                integer(0)(value)
            elif is_event_time(name):
                number()(value)
            elif not is_output(name):
                raise FieldError("is not a value of a run")
        except FieldError as problem:
            problem.fields.append(name)
            raise


def _check_frames(frames: Any) -> None:
    """Check an animation; see `beamdae.report.scene.frame_export.export_frames`."""
    record({"t": numbers()}, others=True)(frames)
    count = len(frames["t"])
    per_frame = sequence(numbers(gaps=True), [1, count])
    pose = numbers([1, count], gaps=True)
    poses = frames.get("poses")
    index = integer(0, max(len(poses) - 1, 0) if isinstance(poses, list) else 0)
    point = optional(numbers([3]))
    color = record(
        {
            "title": text,
            "limits": numbers([2]),
            "scale": sequence(text),
            "values": mapping(sequence(numbers(gaps=True), [count])),
        }
    )
    body = record(
        {"name": text, "kind": text, "x": per_frame, "y": per_frame}, {"frames": integer(1, count)}
    )
    symbol = record(
        {
            "name": text,
            "kind": text,
            "at": index,
            "to": index,
            "along": flag,
            "points": sequence(point),
        },
        {"absent": sequence(integer(0, max(count - 1, 0)))},
    )
    record(
        {
            "t": numbers(),
            "bodies": sequence(body),
            "poses": sequence(record({"x": pose, "y": pose, "turn": pose})),
            "symbols": sequence(symbol),
            "colors": sequence(color),
            "extent": sequence(numbers([2]), [2]),
        }
    )(frames)
    require_ascending("t", np.array(frames["t"]))
    for k, curve in enumerate(frames["bodies"]):
        expected = 1 if "frames" in curve else count
        lengths = {len(points) for axis in ("x", "y") for points in curve[axis]}
        if len(lengths) > 1 or {len(curve[axis]) for axis in ("x", "y")} != {expected}:
            raise FieldError(
                "must have x and y of equally many points in all frames", str(k), "bodies"
            )


_OUTCOME = record(
    {
        "status": record({"kind": choice(*get_args(Kind)), "sentence": text}),
        "values": _check_values,
        "rows": optional(
            record(
                {"sha256": text, "columns": sequence(column_name)},
                {"measures": mapping(sequence(number(finite=False), [len(MEASURES)]))},
            )
        ),
        "frames": optional(_check_frames),
        "read": mapping(optional(text)),
        "limits": record({f.name: number(0.0, optional=True) for f in fields(Limits)}),
        "repetitions": integer(1),
    }
)


def check_outcome(content: Any) -> None:
    """Raise FieldError unless a record has the fields and types that `Store.save` writes."""
    _OUTCOME(content)
    rows = content["rows"]
    was_run = content["status"]["sentence"] != MEASURED.sentence
    if rows is None and content["status"]["kind"] == "ok" and was_run:
        raise FieldError("must not be null because the run succeeded", "rows")
    if rows is not None and len(set(rows["columns"])) < len(rows["columns"]):
        raise FieldError("must be different names", "columns", "rows")


def parse_rows(text: bytes, content: dict[str, Any]) -> pd.DataFrame:
    """Return the trajectory of a record.

    Raises
    ------
    FieldError
        If the columns differ from the record, a cell is neither a number nor empty, or the times do
        not ascend from 0 to the end time in the record. An unsuccessful run may end earlier.
    """
    try:
        table = parse_trajectory(text, TIME, content["rows"]["columns"])
    except ValueError as problem:
        raise FieldError(str(problem)) from None
    times = table.index.to_numpy()
    if not (len(times) and np.isfinite(times).all() and times[0] == 0.0):
        raise FieldError("must contain finite times that begin with 0", TIME)
    require_ascending(TIME, times)
    reached = content["values"].get(REACHED_COLUMN)
    if reached is not None:
        excess, rounding = times[-1] - reached, _ROUNDING_OF_TIMES * reached
        if excess > rounding or (content["status"]["kind"] == "ok" and excess < -rounding):
            recorded, end = format_distinct(reached, times[-1])
            raise FieldError(f"must end at {recorded} s as in the record, got {end} s", TIME)
    return table
