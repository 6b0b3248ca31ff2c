"""Answers of the live view: the drawing of a model with given parameters, and runs."""

from __future__ import annotations

import threading
import time as clock
from collections.abc import Mapping
from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError, format_exception
from beamdae.integrators.auto import Auto
from beamdae.live.controls import create_controls
from beamdae.model_functions import Model
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
