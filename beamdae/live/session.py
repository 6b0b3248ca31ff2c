"""Answers of the live view: the drawing of a model with given parameters, and runs."""

from __future__ import annotations

import inspect
import math
import threading
import time as clock
from collections.abc import Mapping
from typing import Any, Literal, get_args, get_origin

import numpy as np

from beamdae.errors import BeamdaeError, format_exception, require_mapping, require_pair
from beamdae.integrators.auto import Auto
from beamdae.model_functions import Model
from beamdae.model_parameters import ModelParameter
from beamdae.parts.mechanism import Mechanism
from beamdae.report.scene.mechanism_scene import build_scene, reference_poses
from beamdae.report.scene.run_scene import export_frames, export_run_frames
from beamdae.report.tables import range_rows, table_of
from beamdae.results.columns import observed_columns
from beamdae.results.solution import Solution
from beamdae.simulation import simulate

# Enough for a picture; `beamdae run` is more accurate.
RTOL = 1e-3
_SUPERSEDED = "superseded"


# The slider of a number reaches from the default divided by this factor to the default times it.
_RANGE_FACTOR = 4.0
# A slider with positive ends is logarithmic from this ratio of its ends on.
_MIN_LOGARITHMIC_RATIO = 8.0
_FULL_TURN = {"rad": math.pi, "deg": 180.0, "°": 180.0}  # half a turn, in both directions


class LiveSession:
    """Drawings and runs of a model for the live view.

    Requests of several threads are answered one after another; each ends the run of an earlier
    one.

    Parameters
    ----------
    model
        The model.
    ranges
        Ends of the sliders, see `create_controls`.
    t_end
        End time of the runs [s].
    time_limit
        Maximum wall time of a run [s].
    """

    def __init__(
        self,
        model: Model,
        ranges: Mapping[str, Any] | None,
        t_end: float,
        time_limit: float,
    ) -> None:
        self._model, self._t_end, self._time_limit = model, t_end, time_limit
        self.name, self.controls = model.name, create_controls(model, ranges)
        self._lock, self._latest = threading.Lock(), 0
        self._count_lock = threading.Lock()

    def describe(self) -> dict[str, Any]:
        """Return the title, the controls and the first drawing, as data of the page."""
        return {
            "name": self.name,
            "summary": self._model.summary,
            "controls": self.controls,
            "t_end": self._t_end,
            "first": self.draw({}),
        }

    def draw(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the "frames" of the drawing with parameters `values`, or an "error"."""
        return self._answer(values, self._draw)

    def run(self, values: Mapping[str, Any], t_end: Any = None) -> dict[str, Any]:
        """Return the "frames", "status", "warnings" and "table" of a run, or an "error".

        A run that a later request ended is only marked as "superseded".
        """
        return self._answer(values, lambda mechanism, number: self._run(mechanism, number, t_end))

    def close(self) -> None:
        """End the run in progress."""
        self._count_request()

    def _count_request(self) -> int:
        """Return the number of a new request, which supersedes all earlier ones."""
        with self._count_lock:
            self._latest += 1
            return self._latest

    def _answer(self, values: Mapping[str, Any], function: Any) -> dict[str, Any]:
        number = self._count_request()
        with self._lock:
            if number != self._latest:
                return {_SUPERSEDED: True}
            try:
                mechanism = self._model(**values)
                if not isinstance(mechanism, Mechanism):
                    raise BeamdaeError(
                        f"view: {self.name} consists of equations without a shape; only a "
                        "Mechanism can be viewed."
                    )
                answer: dict[str, Any] = function(mechanism, number)
            except BeamdaeError as problem:
                return {"error": str(problem)}
            except Exception as problem:  # The model function can raise any error.
                return {"error": f"{self.name}: {format_exception(problem)}"}
            return answer

    def _draw(self, mechanism: Mechanism, number: int) -> dict[str, Any]:
        times = np.zeros(1)
        scene = build_scene(mechanism, reference_poses, times, name="view")
        return {"frames": export_frames(scene, times)}

    def _run(self, mechanism: Mechanism, number: int, t_end: Any) -> dict[str, Any]:
        # The first step follows compilation, which takes seconds once on a machine.
        begin = 0.0

        def stop(t: float) -> str | None:
            nonlocal begin
            begin = begin or clock.perf_counter()
            if clock.perf_counter() - begin > self._time_limit:
                return f"reached the time limit of {self._time_limit:g} s"
            return _SUPERSEDED if number != self._latest else None

        end = self._t_end if t_end is None else t_end
        solution = simulate(mechanism, Auto(rtol=RTOL), end, progress=stop)
        if number != self._latest:
            return {_SUPERSEDED: True}
        return {"frames": export_run_frames(solution), **summarize(solution)}


def summarize(solution: Solution) -> dict[str, Any]:
    """Return status, warnings and the table of observed columns for the page."""
    cost = solution.statistics
    columns = solution.all_columns()
    observed = {name: columns[name] for name in observed_columns(columns)}
    rows = range_rows(observed, steps=solution.step_extremes)
    head, *texts = table_of(rows).texts if rows else [[]]
    return {
        "status": f"{solution.status.sentence}; {cost.steps} steps, {cost.wall_time:.2g} s",
        "ok": solution.status.success,
        "warnings": list(solution.warnings),
        "table": {"head": head, "rows": texts},
    }


def create_controls(model: Model, ranges: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return one control per parameter, as plain data for the page.

    Parameters
    ----------
    model
        The model.
    ranges
        Pairs (first, last) of slider ends by parameter, numbers or texts with units.

    Returns
    -------
    list of dict
        "name", "value", "unit", "description", "kind" ("number", "integer", "flag", "choice" or
        "text"); for numbers with a slider, its ends "low" and "high" and whether it is logarithmic
        ("log"); for choices, annotated as `Literal` texts, these values ("choices").

    Raises
    ------
    BeamdaeError
        If `ranges` has the wrong form, or names an unknown or another kind of parameter.
    """
    pairs = require_mapping(
        "view", "ranges", {} if ranges is None else ranges, "a dict of pairs by parameter"
    )
    ends = {str(name): _require_range(model, str(name), x) for name, x in pairs.items()}
    controls = [_create_control(x, ends.get(x.name)) for x in model.parameter_info.values()]
    literals = _read_literals(model)
    for control in controls:
        if control["kind"] != "text":
            continue
        name, default = control["name"], control["value"]
        if default in literals.get(name, ()):
            control |= {"kind": "choice", "choices": literals[name]}
    return controls


def _read_literals(model: Model) -> dict[str, list[str]]:
    """Return the texts of the parameters that are annotated as `Literal` texts."""
    try:
        annotations = inspect.get_annotations(model.build, eval_str=True)
    except Exception:  # Annotations can be any code, also of names that only type checkers import.
        return {}
    choices = {
        name: list(get_args(annotation))
        for name, annotation in annotations.items()
        if get_origin(annotation) is Literal
    }
    return {name: x for name, x in choices.items() if all(isinstance(text, str) for text in x)}


def _create_control(x: ModelParameter, ends: tuple[Any, Any] | None) -> dict[str, Any]:
    control = {"name": x.name, "unit": x.unit, "description": x.description}
    if isinstance(x.default, bool):
        return control | {"kind": "flag", "value": x.default}
    if not isinstance(x.default, (int, float)) or not math.isfinite(x.default):
        value = x.default if isinstance(x.default, str) else repr(x.default)
        return control | {"kind": "text", "value": value}
    kind = "integer" if isinstance(x.default, int) else "number"
    low, high = _default_range(x) if ends is None else ends
    is_log = kind == "number" and low > 0.0 and high >= _MIN_LOGARITHMIC_RATIO * low
    slider = {"low": low, "high": high, "log": is_log} if low < high else {}
    return control | {"kind": kind, "value": x.default, **slider}


def _default_range(x: ModelParameter) -> tuple[Any, Any]:
    """Return the ends of a slider; equal ends mean no slider, for a default of 0."""
    if x.unit in _FULL_TURN:
        return -_FULL_TURN[x.unit], _FULL_TURN[x.unit]
    if isinstance(x.default, int):
        return (1, int(_RANGE_FACTOR) * x.default) if x.default > 0 else (x.default, x.default)
    low, high = sorted((x.default / _RANGE_FACTOR, x.default * _RANGE_FACTOR))
    return (low, high) if math.isfinite(high - low) else (x.default, x.default)


def _require_range(model: Model, name: str, value: Any) -> tuple[Any, Any]:
    pair = require_pair("view", f"the range of {name}", value, "a pair (first, last)")
    low, high = (model.complete({name: x})[name] for x in pair)
    is_number = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in (low, high))
    if not is_number or not low < high:
        raise BeamdaeError(
            f"view: the range of {name} must be two ascending numbers, got {low} and {high}."
        )
    return low, high
