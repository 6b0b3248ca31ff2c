"""The arrows of loads: in drawings of one length, in motions as long as the load is large."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from beamdae.beams.beam_loads import DistributedForce, MovingForce
from beamdae.parts.forces.force_law import ForceLaw
from beamdae.parts.forces.loads import Force, Moment
from beamdae.parts.laws import Law
from beamdae.report.scene.joint_symbols import symbol, tip
from beamdae.report.scene.scene_builder import SceneBuilder

Array = np.ndarray

# Of the size of a symbol: the largest force; of the largest load: what is not drawn.
_REACH, _NOTHING = 4.0, 0.02
_ALONG_BEAM, _SECTIONS = 9, 101
# Angle of the arrow of the largest moment [rad], and its radius.
_SWEEP, _RADIUS = 1.3 * math.pi, 1.6
# Times at which a load that begins with nothing is looked at [s].
_LATER = (1e-3, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)


@symbol.register
def _force(part: Force, sketch: SceneBuilder) -> None:
    row = sketch.at(part.on)
    load = _values(part.laws, sketch)
    _push(sketch, row, _turned(load, row, sketch) if part.axes == "body" else load)
    sketch.name(row)


def _turned(load: Array, row: int, sketch: SceneBuilder, drawn: float = 0.0) -> Array:
    """Components of the axes of a body in those of the drawing; `drawn` is their angle there."""
    angle = sketch.pose(row)[:, 2] + drawn
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * load[:, 0] - s * load[:, 1], s * load[:, 0] + c * load[:, 1]], axis=-1)


@symbol.register
def _moment(part: Moment, sketch: SceneBuilder) -> None:
    row = sketch.at(part.on)
    _twist(sketch, row, _values(part.laws, sketch)[:, 0])
    sketch.name(row)


@symbol.register
def _law(part: ForceLaw, sketch: SceneBuilder) -> None:
    """Arrows where velocities are known, diamonds in a drawing."""
    rows = [sketch.at(place) for place in part.on]
    if sketch.measure is None:
        symbol.dispatch(object)(part, sketch)
        return
    loads = sketch.measure(part.load).reshape(len(sketch.times), -1, 3)
    for k, row in enumerate(rows):
        _push(sketch, row, loads[:, k, :2])
        _twist(sketch, row, loads[:, k, 2])
    sketch.name(rows[0])


@symbol.register
def _distributed(part: DistributedForce, sketch: SceneBuilder) -> None:
    places = [part.beam.at(s) for s in np.linspace(0.0, part.beam.length, _ALONG_BEAM)]
    rows = [sketch.at(place) for place in places]
    if not part.laws:
        # A formula of the place has no one direction.
        for row in rows:
            sketch.carried("load", row, tip(sketch.size))
        sketch.name(rows[_ALONG_BEAM // 2])
        return
    load = _values(part.laws, sketch)
    tails = []
    for row, place in zip(rows, places, strict=True):
        turned = _turned(load, row, sketch, place.inclination)
        tails.append(_push(sketch, row, turned if part.axes == "section" else load, 0.5))
    sketch.curve("load", np.stack([sketch.pose(tail)[:, :2] for tail in tails], axis=1))
    sketch.name(tails[_ALONG_BEAM // 2])


@symbol.register
def _moving(part: MovingForce, sketch: SceneBuilder) -> None:
    beam = part.beam
    at = np.linspace(0.0, beam.length, _SECTIONS)
    axis = sketch.through([beam.at(s) for s in at])
    s = part.start + part.speed * sketch.times
    pose = np.zeros((len(s), 3))
    for k in range(2):
        pose[:, k] = [np.interp(x, at, y) for x, y in zip(s, axis[..., k], strict=True)]
    # In the drawing it is shown before it comes and after it has gone.
    gone = (s < 0.0) | (s > beam.length)
    load = np.where(gone[:, None] & (len(s) > 1), 0.0, np.array(part.force))
    sketch.name(_push(sketch, sketch.follow(pose), load))


def _push(sketch: SceneBuilder, row: int, load: Array, share: float = 1.0) -> int:
    """An arrow that ends at a pose, of a force (frames, 2); returns where it begins."""
    tail = sketch.pose(row).copy()
    tail[:, :2] -= share * _REACH * sketch.size * _of_largest(load)
    tail[:, 2] = np.arctan2(load[:, 1], load[:, 0])
    begin = sketch.follow(tail)
    sketch.link("load", begin, row)
    head = np.column_stack([np.ones(4), tip(sketch.size)])
    sketch.stretched("load tip", begin, row, head)
    return begin


def _twist(sketch: SceneBuilder, row: int, moment: Array) -> None:
    """An arrow around a pose, counter-clockwise for a positive moment (frames,)."""
    share = _of_largest(moment[:, None])[:, 0]
    if not np.any(np.isfinite(share)):
        return
    start, sweep, radius = -0.25 * math.pi, _SWEEP * share, _RADIUS * sketch.size
    ends = np.tile(sketch.pose(row), (2, 1, 1))
    ends[0, :, 2], ends[1, :, 2] = start, start + sweep
    angle = ends[1, :, 2] + np.sign(sweep) * 0.5 * math.pi
    head = ends[1].copy()
    head[:, :2] += radius * np.column_stack([np.cos(ends[1, :, 2]), np.sin(ends[1, :, 2])])
    head[:, 2] = angle
    first, last = map(sketch.follow, ends)
    arc = [(x, radius, 0.0) for x in np.linspace(0.0, 0.95, 24)]
    sketch.between("load", first, last, np.array(arc))
    sketch.carried(
        "load tip", sketch.follow(head), np.add(tip(sketch.size), (0.2 * sketch.size, 0.0))
    )


def _of_largest(load: Array) -> Array:
    """Loads (frames, k) over the size of the largest of them; what is next to nothing is nan."""
    size = np.hypot(*load.T) if load.shape[1] == 2 else np.abs(load[:, 0])
    largest = float(np.max(size[np.isfinite(size)], initial=0.0))
    seen = size > _NOTHING * largest
    shares = np.full(load.shape, math.nan)
    shares[seen] = load[seen] / largest
    return shares


def _values(laws: Sequence[Law], sketch: SceneBuilder) -> Array:
    """What laws give in the frames (frames, laws).

    In a drawing, a frame alone, what they give at the first time at which they give something.
    """
    if len(sketch.times) > 1:
        return np.array([[law.at(t) for law in laws] for t in sketch.times])
    for t in (0.0, *_LATER):
        values = [law.at(t) for law in laws]
        if any(values):
            return np.array([values])
    # What never is anything is shown all the same, forces downward.
    return np.array([[1.0] if len(laws) == 1 else [0.0, -1.0]])
