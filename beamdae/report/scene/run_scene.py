"""The scene of a run: its frames, its loads, the trails of what it observed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from beamdae.equations.assembly.observation import add_observable
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

# Points of a trail, as far as frames are fewer, and at most so many a frame.
_TRAIL, _BETWEEN = 2000, 10


def build_run_scene(
    name: str, solution: Solution, times: Array, trail: Any = False, **settings: Any
) -> Scene:
    """What is seen of a run at these times; `name` asks for it.

    Parameters
    ----------
    trail
        Whether observed points leave a line behind them; or the names of those that do.
    settings
        Of `build_scene`.

    Raises
    ------
    BeamdaeError
        If the run is not one of a mechanism, nothing can be drawn, or no such point is observed.
    """
    mechanism = solution.equations.mechanism
    if mechanism is None:
        raise BeamdaeError(f"{name}: the run is not one of a mechanism, there is nothing to draw.")
    branched, state = solution.trajectory.at(times)

    measure = _measure(solution, branched, state)
    poses = CoordinatePoses(mechanism, state.q)
    scene = build_scene(mechanism, poses, times, measure, name=name, **settings)
    observed = _observed_points(mechanism.observables)
    chosen = {x: observed[x] for x in _chosen(name, trail, observed)}
    trails = _trails(solution, chosen, times)
    absent = _absent(solution, times)
    return replace(scene, glyphs=(*trails, *scene.glyphs), absent=absent)


def _absent(solution: Solution, times: Array) -> dict[str, Array]:
    """When parts were not active, of those that were not at some time."""
    which, found = solution.trajectory.which(times), dict[str, Array]()
    for k, interval in enumerate(solution.trajectory.intervals):
        active = interval.configuration
        for part in () if active is None else active.inactive:
            found.setdefault(part, np.zeros(len(times), bool))[which == k] = True
    return found


def _measure(solution: Solution, branched: Array, state: State) -> Measure:
    def measure(quantity: Quantity) -> Array:
        e = add_observable(solution.equations, "load that is drawn", quantity)
        rows = ObservedRows(replace(e, observables=e.observables[-1:]))
        return rows(branched, *state)

    return measure


def _observed_points(observables: dict[str, Quantity]) -> dict[str, Quantity]:
    """Those that are the motion of an attachment."""
    wanted = {"x", "y", "x_dot", "y_dot"}
    return {
        name: quantity
        for name, quantity in observables.items()
        if wanted <= {column.name for column in quantity.columns}
    }


def _chosen(name: str, trail: Any, observed: Iterable[str]) -> list[str]:
    if isinstance(trail, bool):
        return list(observed) if trail else []
    what = "True, False or names of observed points"
    chosen = [trail] if isinstance(trail, str) else require_iterable(name, "trail", trail, what)
    for one in chosen:
        if not isinstance(one, str) or one not in observed:
            raise BeamdaeError(
                f"{name}: trail must be {what}, {short_repr(one)} is none{suggest(one, observed)}."
            )
    return chosen


def _trails(solution: Solution, observed: dict[str, Quantity], times: Array) -> list[MovingCurve]:
    """Of each point where it has been up to each frame, at several times between frames."""
    between = int(np.clip(_TRAIL // len(times), 1, _BETWEEN))
    fine = np.interp(np.arange(between * (len(times) - 1) + 1) / between, range(len(times)), times)
    measure = _measure(solution, *solution.trajectory.at(fine))
    been = np.arange(len(fine)) <= between * np.arange(len(times))[:, None]
    found = []
    for name, quantity in observed.items():
        columns = [column.name for column in quantity.columns]
        places = measure(quantity)[:, [columns.index("x"), columns.index("y")]]
        found.append(MovingCurve(name, "trail", np.where(been[..., None], places, np.nan)))
    return found
