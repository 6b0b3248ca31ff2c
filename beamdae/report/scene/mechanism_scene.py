"""Scene of a mechanism: poses of attachments, beam axes, outlines of bodies and symbols."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.sections import VaryingSection
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.errors import BeamdaeError
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Drawing, Part
from beamdae.report.scene.scene import (
    Measure,
    Poses,
    Scene,
    SceneBuilder,
    bounding_box,
    circle,
    outline,
    round_down_scale,
)
from beamdae.report.scene.symbols import draw_symbol
from beamdae.results.section_forces.section_motions import (
    evaluate_sections,
    position_and_angle,
)

Array = np.ndarray

# Step of the central differences, for a mode shape whose largest component is 1.
_DIFFERENCE_STEP = 1e-5
_SMALLEST_SHAPE = 1e-300  # avoids division by zero for a mode without motion
MAX_BEAM_SECTIONS = 49  # per beam, enough for a smooth curve in a figure
_MIN_BEAM_SECTIONS = 9  # per beam
_MAX_SECTIONS = 600  # total of all beams, unless the minimum per beam requires more
_SYMBOL_SIZE = 0.022  # relative to the extent of the scene
# Section heights are enlarged until the largest one has this size, relative to the mechanism.
_VISIBLE_HEIGHT = 0.025
# Radii of a particle and of a body with a single point, relative to the symbol size. A particle is
# larger than the pin of a joint at the same point.
_PARTICLE_RADIUS = 0.42
_SINGLE_POINT_RADIUS = 0.28
# Largest displacements relative to the size of the mechanism: those that are visible, those of
# enlarged motions, and those that may be rounding noise.
_VISIBLE_RATIO = 0.01
_ENLARGED_RATIO = 0.12
_NOISE_RATIO = 1e-7
# [rad]; enlarged motions of rotating bodies stretch rigid bodies by 0.5 % and beams by 4 %.
_MAX_ENLARGED_ROTATION = {"beam": 0.3, "rigid": 0.1}


def reference_poses(attachments: Sequence[Attachment]) -> Array:
    """Return the poses (1, attachments, 3) in the reference configuration."""
    poses = [[(*attachment.point, 0.0) for attachment in attachments]]
    return np.array(poses, float).reshape(1, -1, 3)


def coordinate_poses(mechanism: Mechanism, q: Array) -> Poses:
    """Return the poses of a mechanism at coordinates q (frames, n), one frame per row."""
    coordinates = map_coordinates(mechanism)

    def poses(attachments: Sequence[Attachment]) -> Array:
        result = np.repeat(reference_poses(attachments), len(q), axis=0)
        bodies: dict[int, list[int]] = {}
        for k, attachment in enumerate(attachments):
            # Attachments without coordinates stay at their reference position.
            if attachment.size:
                bodies.setdefault(id(attachment.body), []).append(k)
        for members in bodies.values():
            of_body = q[:, coordinates.slice_of(attachments[members[0]].body)]
            functions = [
                (attachments[k].operator, attachments[k].checked_kinematics) for k in members
            ]
            at_rest = np.zeros_like(of_body)
            result[:, members] = evaluate_sections(
                position_and_angle, functions, of_body, at_rest, at_rest
            )
        return result

    return poses


def enlarge(values: Array, scale: float) -> Array:
    """Return values whose differences from the first entry are multiplied by `scale`."""
    return values[:1] + scale * (values - values[:1])


def vibration_poses(mechanism: Mechanism, q: Array, shape: Array, phases: Array) -> Poses:
    """Return the poses of a small vibration about a state, one frame per phase.

    The pose p(q) of an attachment becomes p(q) + Re(phase * dp/dq . shape).

    Parameters
    ----------
    mechanism
        The mechanism.
    q
        Coordinates (n,) of the state.
    shape
        Complex mode shape (n,).
    phases
        Complex phases, one per frame.
    """
    step = _DIFFERENCE_STEP / max(float(np.max(np.abs(shape))), _SMALLEST_SHAPE)
    ends = [step * s for s in (shape.real, -shape.real, shape.imag, -shape.imag)]
    displaced = coordinate_poses(mechanism, np.concatenate([q[None], q + ends]))

    def poses(attachments: Sequence[Attachment]) -> Array:
        rest, *at_ends = displaced(attachments)
        slope = (at_ends[0] - at_ends[1] + 1j * (at_ends[2] - at_ends[3])) / (2.0 * step)
        return rest + (slope * phases[:, None, None]).real

    return poses


def build_scene(
    mechanism: Mechanism,
    poses: Poses,
    times: Array,
    measure: Measure | None = None,
    is_hidden: Callable[[Part], bool] = lambda part: False,
    name: str = "draw",
    scale: float | None = 1.0,
) -> Scene:
    """Return the scene of a mechanism.

    Parameters
    ----------
    mechanism
        The mechanism.
    poses, times, measure
        See `SceneBuilder`.
    is_hidden
        Function that returns True for parts whose symbols are not drawn. Bodies are always drawn.
    name
        Name of the calling function, used in error messages.
    scale
        Factor of the displacements from the first frame; None for one that makes them visible, see
        `choose_scale`.

    Raises
    ------
    BeamdaeError
        If the mechanism has no parts that can be drawn.
    """
    if scale is None:
        scene = build_scene(mechanism, poses, times, measure, is_hidden, name)
        scale = choose_scale(mechanism, poses, scene)
        if scale == 1.0:
            return scene
    shown = poses if scale == 1.0 else lambda attachments: enlarge(poses(attachments), scale)
    builder = SceneBuilder(shown, times, measure)
    drawings = collect_drawings(mechanism, count_beam_sections(mechanism))
    bodies = [(body, drawing) for body, drawing in drawings if drawing.kind != "ground"]
    lines = [builder.positions(drawing.places) for _, drawing in bodies]
    attachments = [a for part in mechanism.parts.values() for a in part.attachments]
    points = [line.reshape(-1, 2) for line in lines]
    points += [builder.pose(builder.add_attachment(a))[:, :2] for a in attachments]
    if not points:
        raise BeamdaeError(f"{name}: the mechanism has no parts that can be drawn; add a body.")
    low, high = bounding_box(np.concatenate(points))
    builder.size = _SYMBOL_SIZE * (float(np.max(high - low)) or 1.0)
    heights, caption = _collect_heights(mechanism, bodies)
    for (body, drawing), line in zip(bodies, lines, strict=True):
        builder.part = body
        if body in heights:
            drawing, line = drawing._replace(kind="beam solid"), outline(line, heights[body])
        _draw_body(drawing, line, builder)
    body_names = {body for body, _ in bodies}
    for part in mechanism.parts.values():
        if part.name not in body_names and not is_hidden(part):
            builder.part = part.name
            draw_symbol(part, builder)
    captions = [f"displacements \u00d7 {scale:.4g}" if scale != 1.0 else "", caption]
    return builder.build(", ".join(filter(None, captions)), scale)


def choose_scale(mechanism: Mechanism, poses: Poses, scene: Scene) -> float:
    """Return the factor of displacements that makes the motion of these poses visible.

    It is 1 if the largest displacement from the first frame exceeds 1 % of the size of the scene,
    if the motion is so small that it may be rounding noise, and if there are contacts: gaps between
    bodies and surfaces are not enlarged. Enlarged rotations are at most 0.3 rad for sections of
    beams and 0.1 rad for rigid bodies, because points of a rotating body move along straight lines
    in enlarged motions.
    """
    if any(part.symbol == "contact" for part in mechanism.parts.values()):
        return 1.0
    drawings = collect_drawings(mechanism, count_beam_sections(mechanism))
    moving = [drawing for _, drawing in drawings if drawing.kind != "ground"]
    places = [x for drawing in moving for x in drawing.places]
    limits = [_MAX_ENLARGED_ROTATION.get(x.kind, np.inf) for x in moving for _ in x.places]
    places_over_time = poses(places)
    x, y, rotations = np.moveaxis(places_over_time - places_over_time[:1], -1, 0)
    low, high = scene.extent()
    ratio = float(np.nanmax(np.hypot(x, y), initial=0.0) / np.max(high - low))
    if not _NOISE_RATIO < ratio < _VISIBLE_RATIO:
        return 1.0
    scale = _ENLARGED_RATIO / ratio
    rotation = float(np.nanmax(np.abs(rotations) / limits, initial=0.0))  # relative to its limit
    if scale * rotation > 1.0:
        scale = max(1.0 / rotation, 1.0)
    return round_down_scale(scale)


def collect_drawings(mechanism: Mechanism, points: int) -> list[tuple[str, Drawing]]:
    """Return names and drawings of the ground and of all bodies that can be drawn.

    Beams are drawn through `points` sections; for other bodies, see their `Part.draw`.
    """
    parts = list(mechanism.parts.values())
    drawings = []
    for body in (mechanism.ground, *parts):
        # Attachments of all parts to the body, without repeated points.
        attachments = (a for part in parts for a in part.attachments if a.body is body)
        places = list({a.point: a for a in attachments}.values())
        drawing = body.draw(places, points)
        if drawing is not None and drawing.places:
            drawings.append((body.name, drawing))
    return drawings


def count_beam_sections(mechanism: Mechanism) -> int:
    """Return the number of sections used to draw each beam of a mechanism."""
    count = max(len(beams_of(mechanism)), 1)
    return int(np.clip(_MAX_SECTIONS // count, _MIN_BEAM_SECTIONS, MAX_BEAM_SECTIONS))


def _collect_heights(
    mechanism: Mechanism, bodies: Sequence[tuple[str, Drawing]]
) -> tuple[dict[str, Array], str]:
    """Return the visible section heights [m] of beams by name, and a caption with their factor.

    The factor is the same in all states of a mechanism. Beams without a height are lines of
    constant width, as are all beams if no section varies.
    """
    if not any(isinstance(beam.section, VaryingSection) for beam in beams_of(mechanism)):
        return {}, ""
    heights = {}
    for body, drawing in bodies:
        if isinstance(beam := mechanism.parts.get(body), Beam):
            along = [beam.section.at(x.s or 0.0).height for x in drawing.places]
            if None not in along:
                heights[body] = np.array(along)
    points = np.array([x.point for _, drawing in bodies for x in drawing.places])
    largest = max((float(np.max(x)) for x in heights.values()), default=np.inf)
    size = float(np.max(np.ptp(points, 0)))
    scale = round_down_scale(max(_VISIBLE_HEIGHT * size / largest, 1.0))
    caption = "" if scale == 1.0 or not heights else f"section heights \u00d7 {scale:.4g}"
    return {body: scale * x for body, x in heights.items()}, caption


def _draw_body(drawing: Drawing, line: Array, builder: SceneBuilder) -> None:
    attachments = drawing.places
    if drawing.kind == "rigid" and len({id(a.body) for a in attachments}) == 1:
        # A closed outline through the attachments, a line for two, or a circle for one.
        row = builder.add_attachment(attachments[0])
        points = np.array([a.point for a in attachments]) - attachments[0].point
        if len(points) > 1:
            polygon = points[[*range(len(points)), *([0] if len(points) > 2 else [])]]
            builder.add_rigid("rigid", row, polygon / builder.size)
        else:
            builder.add_rigid("joint", row, circle(_SINGLE_POINT_RADIUS))
        arm, center = points.mean(axis=0), builder.pose(row).copy()
        c, s = np.cos(center[:, 2]), np.sin(center[:, 2])
        center[:, 0] += c * arm[0] - s * arm[1]
        center[:, 1] += s * arm[0] + c * arm[1]
        builder.add_name(builder.add_pose(center))
    elif drawing.kind == "point":
        row = builder.add_attachment(attachments[0])
        builder.add_rigid("point", row, circle(_PARTICLE_RADIUS))
        builder.add_name(row)
    else:
        builder.add_curve(drawing.kind, line)
        builder.add_name(builder.add_attachment(attachments[len(attachments) // 2]))
