"""Scene of a run: its frames, loads, inactive parts and the trails of observed points."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from beamdae.equations.assembly.building import add_observable
from beamdae.equations.equations_of_motion import State
from beamdae.equations.measures import ObservedRows
from beamdae.errors import BeamdaeError, require_iterable, short_repr, suggest
from beamdae.report.scene.mechanism_scene import build_scene
from beamdae.report.scene.poses import CoordinatePoses
from beamdae.report.scene.scene import MovingCurve, Scene
from beamdae.report.scene.scene_builder import Measure
from beamdae.results.solution import Solution
from beamdae.symbolic.statements import Quantity

Array = np.ndarray

_DEFAULT_FRAMES = 120
# Points of a trail in the whole run, and between two frames.
_MAX_TRAIL_POINTS = 2000
_MAX_TRAIL_POINTS_PER_FRAME = 10
# Columns of an observable that is the motion of an attachment.
_MOTION_COLUMNS = {"x", "y", "x_dot", "y_dot"}


def frame_times(solution: Solution, frames: int = _DEFAULT_FRAMES) -> Array:
    """Return equally spaced times from the start of a run to the last time it reached [s]."""
    start = solution.trajectory.intervals[0].t[0]
    return np.linspace(start, solution.trajectory.end, frames)


def build_run_scene(
    name: str, solution: Solution, times: Array, trail: Any = False, **settings: Any
) -> Scene:
    """Return the scene of a run at the given times.

    Parameters
    ----------
    name
        Name of the calling function, for messages.
    solution
        The run.
    times
        Times of the frames [s].
    trail
        If True, all observed points leave a trail; or the names of those that do.
    settings
        Further arguments of `build_scene`.

    Raises
    ------
    BeamdaeError
        If the run is not one of a mechanism, has nothing that can be drawn, or `trail` is not the
        name of an observed point.
    """
    mechanism = solution.equations.mechanism
    if mechanism is None:
        raise BeamdaeError(
            f"{name}: the run is not one of a mechanism; only mechanisms can be drawn."
        )
    branches, state = solution.trajectory.at(times)
    measure = _create_measure(solution, branches, state)
    poses = CoordinatePoses(mechanism, state.q)
    scene = build_scene(mechanism, poses, times, measure, name=name, **settings)
    points = _find_observed_points(mechanism.observables)
    trails = _build_trails(
        solution, {x: points[x] for x in _select_trails(name, trail, points)}, times
    )
    absent = _find_absent_frames(solution, times)
    return replace(scene, glyphs=(*trails, *scene.glyphs), absent=absent)


def _find_absent_frames(solution: Solution, times: Array) -> dict[str, Array]:
    """Return the frames in which parts are inactive, for parts inactive at some time."""
    intervals, absent = solution.trajectory.interval_index(times), dict[str, Array]()
    for k, interval in enumerate(solution.trajectory.intervals):
        configuration = interval.configuration
        for part in () if configuration is None else configuration.inactive:
            absent.setdefault(part, np.zeros(len(times), bool))[intervals == k] = True
    return absent


def _create_measure(solution: Solution, branches: Array, state: State) -> Measure:
    def measure(quantity: Quantity) -> Array:
        equations = add_observable(solution.equations, "drawn load", quantity)
        rows = ObservedRows(replace(equations, observables=equations.observables[-1:]))
        return rows(branches, *state)

    return measure


def _find_observed_points(observables: dict[str, Quantity]) -> dict[str, Quantity]:
    """Return the observables that are the motion of an attachment."""
    return {
        name: quantity
        for name, quantity in observables.items()
        if _MOTION_COLUMNS.issubset(column.name for column in quantity.columns)
    }


def _select_trails(name: str, trail: Any, points: Iterable[str]) -> list[str]:
    if isinstance(trail, bool):
        return list(points) if trail else []
    expected = "True, False or names of observed points"
    names = [trail] if isinstance(trail, str) else require_iterable(name, "trail", trail, expected)
    for one in names:
        if not isinstance(one, str) or one not in points:
            raise BeamdaeError(
                f"{name}: trail must be {expected}, got {short_repr(one)}{suggest(one, points)}."
            )
    return names


def _build_trails(
    solution: Solution, points: dict[str, Quantity], times: Array
) -> list[MovingCurve]:
    """Return the path of each point up to each frame, sampled several times between frames."""
    between = int(np.clip(_MAX_TRAIL_POINTS // len(times), 1, _MAX_TRAIL_POINTS_PER_FRAME))
    fine = np.interp(np.arange(between * (len(times) - 1) + 1) / between, range(len(times)), times)
    measure = _create_measure(solution, *solution.trajectory.at(fine))
    is_past = np.arange(len(fine)) <= between * np.arange(len(times))[:, None]
    trails = []
    for name, quantity in points.items():
        columns = [column.name for column in quantity.columns]
        positions = measure(quantity)[:, [columns.index("x"), columns.index("y")]]
        trails.append(MovingCurve(name, "trail", np.where(is_past[..., None], positions, np.nan)))
    return trails
