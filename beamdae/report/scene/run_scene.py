"""Scene of a run, colors along beams, and export of scenes as plain data for pages and notebooks.

Colors show strain, stress or section forces.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.strains import identity
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.assembly.observables import add_observable
from beamdae.equations.equations_of_motion import State
from beamdae.equations.measures import ObservedRows
from beamdae.errors import (
    BeamdaeError,
    plain_text,
    require_choice,
    require_iterable,
    short_repr,
    suggest,
)
from beamdae.report.scene.mechanism_scene import (
    build_scene,
    coordinate_poses,
    count_beam_sections,
    enlarge,
)
from beamdae.report.scene.scene import (
    Glyph,
    Measure,
    MovingCurve,
    Scene,
    find_layer,
)
from beamdae.report.text import engineering_order, scale_unit
from beamdae.results.section_forces.section_motions import (
    evaluate_sections,
)
from beamdae.results.solution import Solution
from beamdae.symbolic.statements import Quantity


class _ColorQuantity(NamedTuple):
    title: str
    unit: str
    is_signed: bool


_QUANTITIES = {
    "strain": _ColorQuantity("largest strain", "-", is_signed=False),
    "stress": _ColorQuantity("largest stress", "Pa", is_signed=False),
    "N": _ColorQuantity("axial force N", "N", is_signed=True),
    "Q": _ColorQuantity("shear force Q", "N", is_signed=True),
    "M": _ColorQuantity("bending moment M", "N m", is_signed=True),
}
# Color scales for magnitudes and for signed quantities, from the lower to the upper limit.
_SEQUENTIAL_SCALE = ("#3a6fc4", "#7660c4", "#b452a3", "#e0566e", "#f58538", "#f5c31d")
_DIVERGING_SCALE = ("#0072B2", "#b8b8b8", "#D55E00")


@dataclass(frozen=True, eq=False)
class BeamColors:
    """Values along beams in each frame, with a common color scale for the whole run.

    Attributes
    ----------
    title
        Name and unit of the quantity.
    values
        Values (frames, sections) by beam name, in the unit of the title.
    limits
        Lower and upper limit of the color scale, which covers all frames.
    """

    title: str
    values: Mapping[str, Array]
    limits: tuple[float, float]

    def segment_values(self, part: str, frame: int) -> Array:
        """Return the values (sections - 1,) between neighboring sections in a frame."""
        along = self.values[part][frame]
        return 0.5 * (along[:-1] + along[1:])

    @property
    def scale(self) -> tuple[str, ...]:
        """Colors at equally spaced values from the lower to the upper limit."""
        return _DIVERGING_SCALE if self.limits[0] < 0.0 else _SEQUENTIAL_SCALE


def available_colors(solution: Solution, times: Array, first: Any = None) -> list[BeamColors]:
    """Return the color quantities that the viewer of an animation can select.

    The quantity `first`, if given, is followed by stress and bending moment. Stress and moment are
    omitted if the run has no beams; stress is also omitted if a section does not define its height.
    The strain is the larger of |eps11 + eta kappa11| at the fiber offsets eta of the top and the
    bottom of the section. Stress and section forces include the damping contribution.

    Raises
    ------
    BeamdaeError
        If `first` is none of "strain", "stress", "N", "Q" and "M", the run has no beams, or strain
        or stress is requested and a section does not define its height.
    """
    quantities = ["stress", "M"]
    mechanism = solution.equations.mechanism
    beams = beams_of(mechanism)
    if first is not None:
        first = require_choice("animate", "color", first, tuple(_QUANTITIES))
        quantities = [first, *(x for x in quantities if x != first)]
        if not beams:
            raise BeamdaeError(
                f"animate: color {first!r} requires a beam, but the mechanism has none; omit color."
            )
    if mechanism is None or not beams:
        return []
    _, state = solution.trajectory.at(times)
    coordinates, count = map_coordinates(mechanism), count_beam_sections(mechanism)
    forces: list[tuple[Beam, list[float], Array]] = []
    for beam in beams:
        q, v = (x[:, coordinates.slice_of(beam)] for x in (state.q, state.v))
        places = np.linspace(0.0, beam.length, count).tolist()
        functions = [beam.kinematics.section_forces(s) for s in places]
        at_sections = evaluate_sections(identity, functions, q, v, np.zeros_like(q))
        forces.append((beam, places, at_sections))
    colors = []
    for what in quantities:
        try:
            values = {x[0].name: _compute_quantity(what, *x) for x in forces}
        except BeamdaeError:
            if what == first:
                raise
            continue
        everything = np.concatenate([np.abs(x).ravel() for x in values.values()])
        largest = float(np.max(everything[np.isfinite(everything)], initial=0.0))
        title, unit, is_signed = _QUANTITIES[what]
        order = engineering_order(largest)
        factor = 10.0**order
        limit = largest / factor or 1.0
        scaled = {part: x / factor for part, x in values.items()}
        limits = (-limit if is_signed else 0.0, limit)
        colors.append(BeamColors(f"{title} [{scale_unit(unit, order)}]", scaled, limits))
    return colors


def _compute_quantity(what: str, beam: Beam, places: list[float], values: Array) -> Array:
    """Return the quantity (frames, sections) along a beam.

    `values` are those of `Kinematics.section_forces` (frames, sections, 7) at these places [m].
    """
    elastic, viscous, rest = np.split(np.moveaxis(values, -1, 0), (3, 6))
    if what in ("N", "Q", "M"):
        k = "NQM".index(what)
        return np.asarray(elastic[k] + viscous[k] + rest[0] * (what == "N"))
    if what == "strain":
        return beam._largest_fiber_stresses(elastic, places, is_stress=False)
    return beam._largest_fiber_stresses(elastic + viscous, places)


Array = np.ndarray

DEFAULT_FRAMES = 120
_MAX_TRAIL_POINTS = 2000  # in the whole run
_MAX_TRAIL_POINTS_PER_FRAME = 10
# Columns that an observable has if it observes the motion of an attachment.
_MOTION_COLUMNS = {"x", "y", "x_dot", "y_dot"}
_TRAILS = "True, False or names of observed points"
FRAMES_PER_PERIOD = 32  # of vibrations and periodic motions


def frame_times(solution: Solution, frames: int = DEFAULT_FRAMES) -> Array:
    """Return equally spaced times (frames,) [s] from the start to the end of a run."""
    start = solution.trajectory.intervals[0].t[0]
    return np.linspace(start, solution.trajectory.end, frames)


def build_run_scene(
    name: str,
    solution: Solution,
    times: Array,
    trail: Any = False,
    scale: float | None = 1.0,
    **settings: Any,
) -> Scene:
    """Return the scene of a run at the given times.

    Parameters
    ----------
    name
        Name of the calling function, used in error messages.
    solution
        The run.
    times
        Times of the frames [s].
    trail
        True to show the trails of all observed points, or the names of the points to trace.
    scale
        See `build_scene`.
    **settings
        Further arguments of `build_scene`.

    Raises
    ------
    BeamdaeError
        If the run has no mechanism or no parts that can be drawn, or `trail` contains a name that
        is not an observed point.
    """
    mechanism = solution.equations.mechanism
    if mechanism is None:
        raise BeamdaeError(f"{name}: the run has no mechanism; only mechanisms can be drawn.")
    branches, state = solution.trajectory.at(times)
    measure = _create_measure(solution, branches, state)
    poses = coordinate_poses(mechanism, state.q)
    scene = build_scene(mechanism, poses, times, measure, name=name, scale=scale, **settings)
    # Masks of the frames in which a part is inactive.
    intervals, absent = solution.trajectory.interval_index(times), dict[str, Array]()
    for k, interval in enumerate(solution.trajectory.intervals):
        for part in interval.inactive:
            absent.setdefault(part, np.zeros(len(times), bool))[intervals == k] = True
    trails = _build_trails(name, solution, trail, times, scene.scale)
    return replace(scene, glyphs=(*trails, *scene.glyphs), absent=absent)


def _create_measure(solution: Solution, branches: Array, state: State) -> Measure:
    def measure(quantity: Quantity) -> Array:
        equations = add_observable(solution.equations, "drawn load", quantity)
        rows = ObservedRows(replace(equations, observables=equations.observables[-1:]))
        return rows(branches, *state)

    return measure


def _build_trails(
    name: str, solution: Solution, trail: Any, times: Array, scale: float
) -> list[MovingCurve]:
    """Return the path of each point up to each frame, also sampled between the frames."""
    mechanism = solution.equations.mechanism
    # Observables that contain the motion of an attachment.
    points = {
        name: quantity
        for name, quantity in ({} if mechanism is None else mechanism.observables).items()
        if _MOTION_COLUMNS.issubset(column.name for column in quantity.columns)
    }
    trail = plain_text(trail)
    names: Iterable[Any] = [trail]
    if isinstance(trail, bool):
        names = points if trail else ()
    elif not isinstance(trail, str):
        names = require_iterable(name, "trail", trail, _TRAILS)
    for one in names:
        if not isinstance(one, str) or one not in points:
            raise BeamdaeError(
                f"{name}: trail must be {_TRAILS}, got {short_repr(one)}{suggest(one, points)}."
            )
    if not names:
        return []
    between = int(np.clip(_MAX_TRAIL_POINTS // len(times), 1, _MAX_TRAIL_POINTS_PER_FRAME))
    fine = np.interp(np.arange(between * (len(times) - 1) + 1) / between, range(len(times)), times)
    measure = _create_measure(solution, *solution.trajectory.at(fine))
    is_past = np.arange(len(fine)) <= between * np.arange(len(times))[:, None]
    trails = []
    for one in names:
        columns = [column.name for column in points[one].columns]
        positions = measure(points[one])[:, [columns.index("x"), columns.index("y")]]
        positions = enlarge(positions, scale) if scale != 1.0 else positions
        trails.append(MovingCurve(one, "trail", np.where(is_past[..., None], positions, np.nan)))
    return trails


def export_run_frames(
    solution: Solution, frames: int = DEFAULT_FRAMES, enlarges: bool = False
) -> dict[str, Any] | None:
    """Return the exported scene of a run, or None if nothing can be drawn; see `export_frames`.

    If `enlarges` is True, displacements that are too small to be visible are enlarged.
    """
    times = frame_times(solution, frames)
    try:
        scale = None if enlarges else 1.0
        scene = build_run_scene("animate", solution, times, scale=scale)
    except BeamdaeError:
        return None
    return export_frames(scene, times, available_colors(solution, times))


def export_frames(scene: Scene, times: Array, colors: Sequence[BeamColors] = ()) -> dict[str, Any]:
    """Export a scene as plain data and arrays.

    Returns
    -------
    dict
        - "t": times [s].
        - "glyphs", from back to front: curves with "name", "kind", coordinates "x", "y" [m] of all
          frames, one after another, and the number of "points" per frame. A trail has a single
          list of points. Symbols, see `Symbol`, have "name", "kind", "at" and "to" (indices of
          poses), "along", and "points" with None at interruptions of the line. If the part is
          inactive at times, "absent" lists the frames without the symbol.
        - "poses": "x", "y" [m] and "turn" [rad] over the frames, or one value if it is constant.
        - "colors" of beams: "title", "limits", "scale" (colors at equally spaced values) and
          "values" by beam name, along the beam in all frames, one after another.
        - "extent": lower left and upper right corner of the scene [m].
        - "captions": factors by which displacements and section heights are enlarged.
    """
    glyphs = sorted(scene.glyphs, key=lambda glyph: find_layer(glyph.kind))
    return {
        "t": times,
        "glyphs": [_export_glyph(glyph, scene) for glyph in glyphs],
        "poses": [
            {name: x[:1] if np.all(x == x[0]) else x for name, x in zip(_POSE, pose.T, strict=True)}
            for pose in scene.poses
        ],
        "colors": [
            {"title": x.title, "limits": x.limits, "scale": x.scale, "values": dict(x.values)}
            for x in colors
        ],
        "extent": [x.tolist() for x in scene.extent()],
        "captions": scene.caption,
    }


_POSE = ("x", "y", "turn")


def _export_glyph(glyph: Glyph, scene: Scene) -> dict[str, Any]:
    data: dict[str, Any] = {"name": glyph.part, "kind": glyph.kind}
    if isinstance(glyph, MovingCurve):
        positions = glyph.positions[-1:] if glyph.kind == "trail" else glyph.positions
        return data | {"x": positions[..., 0], "y": positions[..., 1], "points": positions.shape[1]}
    if glyph.part in scene.absent:
        data["absent"] = np.flatnonzero(scene.absent[glyph.part]).tolist()
    points = [x.tolist() if np.isfinite(x).all() else None for x in glyph.points]
    return data | {"at": glyph.start, "to": glyph.end, "along": glyph.along, "points": points}
