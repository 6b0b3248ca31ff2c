"""Following an equilibrium path: predictor and corrector, with cut-back, to one target or more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beamdae.analysis.statics.corrector import Corrector, CorrectorError, EquilibriumPoint
from beamdae.analysis.statics.critical_points import Path, PathSegment
from beamdae.analysis.statics.path_controls import Control, LoadControl, PathDirection, StepNorm
from beamdae.results.outcome import Status

Array = np.ndarray

# A step is cut to this share where it fails, and given up below the least of the largest step.
_CUT, _LEAST = 0.25, 1e-6
# It grows by this factor where Newton's method takes at most so many iterations.
_GROWTH, _EASY = 1.5, 4
# How far a point may be from its prediction, of the way made: farther off it is another path.
_ASTRAY, _ROUNDING = 0.5, 1e-7
# Cosines of how far a path may turn in a step by arc length, where paths cross the other leaves at
# a larger angle, and for steps to grow; the share of the largest step below which it has a corner.
_STRAIGHT, _GENTLE, _CORNER = 0.7, 0.95, 1e-3
_CLOSED = (
    "the path is closed, it comes back to a branch point that it went through; leave it on the way "
    "by one branch point more, as in switch=[1, 1]"
)
# Of a step: how far branch points are from each other that are the same.
_SAME = 1e-2


@dataclass(frozen=True)
class ContinuationSettings:
    """How a path is followed.

    Attributes
    ----------
    aim
        What the targets are values of.
    by_arc
        Whether steps go by arc length; if not by the aim.
    step
        The largest step: of the aim, or by arc length of what moves.
    load
        The change of the factor in the first step by arc length, and at most where the aim is a
        load.
    most
        Points at most.
    leave_at
        Which branch point ends the path, counted from 1; 0: none.
    """

    aim: Control
    by_arc: bool
    step: float
    load: float
    norm: StepNorm
    most: int
    leave_at: int = 0


def follow_path(
    corrector: Corrector,
    path: Path,
    stepping: ContinuationSettings,
    targets: Sequence[float],
    way: PathDirection | None = None,
) -> None:
    """Follow a path from its end to the targets, one after the other.

    `way` is the direction in which it begins by arc length; None: that of a growing factor, or to
    the first target if that is one.
    """
    path.size, left = np.inf, len(path.branches)
    for target in targets:
        reached = stepping.aim.value(path.end.x, path.end.mu) == target
        while not reached:
            if len(path.points) >= stepping.most:
                path.status = Status("limited", f"ended after {len(path.points)} points")
                return
            before = len(path.branches)
            try:
                way, reached = _take_step(corrector, path, stepping, target, way)
            except CorrectorError as problem:
                path.status, path.stuck = Status("failed", str(problem)), True
                return
            if stepping.leave_at and len(path.branches) - left >= stepping.leave_at:
                return
            if len(path.branches) > before and _revisits_branch_point(path, stepping):
                path.status = Status("failed", _CLOSED)
                return


def _revisits_branch_point(path: Path, stepping: ContinuationSettings) -> bool:
    """Whether the last branch point of a path is one that it went through before."""
    *others, last = (path.points[one.place] for one in path.branches)
    off = [stepping.norm.largest(one.x - last.x, one.mu - last.mu) for one in others]
    return min(off, default=np.inf) < _SAME * stepping.step


def _take_step(
    corrector: Corrector,
    path: Path,
    stepping: ContinuationSettings,
    target: float,
    way: PathDirection | None,
) -> tuple[PathDirection | None, bool]:
    """Add the points of one step to the path; its direction, and whether the target is reached."""
    at, norm, aim = path.end, stepping.norm, stepping.aim
    sign, control = 1.0, aim
    if stepping.by_arc:
        way = _arc_direction(corrector, stepping, at, target, way)
        control, reach = norm.arc(at.x, at.mu, way), _max_arc_step(stepping, way, path.size)
        size = min(path.size, reach)
    else:
        way = way or corrector.tangent(at, aim)
        ahead = target - aim.value(at.x, at.mu)
        sign, reach = float(np.sign(ahead)), abs(ahead)
        size = min(path.size, reach, stepping.step)
    begin = control.value(at.x, at.mu)
    # The last step but one leaves no splinter, and rounding no step.
    if not stepping.by_arc and size < reach < 1.2 * size:
        size = reach if reach < 1.001 * size else 0.5 * reach
    least = min(_LEAST * stepping.step, size)
    while True:
        end = target if size == reach and not stepping.by_arc else begin + sign * size
        try:
            found = _correct_prediction(corrector, control, end, at, way.times(sign * size), norm)
            after = corrector.direction(found, control)
            straight = norm.cosine(way, after or way) if stepping.by_arc else 1.0
            if straight < _STRAIGHT and size > _CORNER * stepping.step:
                raise CorrectorError("the path turns away from its direction")
            stretch = PathSegment(corrector, control, at, found, (begin, end), (way, after))
            landed = stretch.up_to(aim, target) if stepping.by_arc else None
            stretch = landed or stretch
            critical = stretch.critical()
            break
        except CorrectorError as problem:
            size *= _CUT
            if size < least:
                raise CorrectorError(str(problem)) from None
    path.add(stretch, critical)
    grown = _GROWTH if found.iterations <= _EASY and straight > _GENTLE else 1.0
    arrived = landed is not None or (not stepping.by_arc and end == target)
    # A step that is short because it arrives says nothing of the next.
    path.size = max(size * grown, path.size * arrived)
    return stretch.ways[1], arrived


def _max_arc_step(stepping: ContinuationSettings, way: PathDirection, size: float) -> float:
    """The largest step by arc length; `size` is that of the last one, if there is one."""
    tiny = np.finfo(float).tiny
    moved = stepping.step / max(stepping.norm.largest(way.x), tiny)
    if isinstance(stepping.aim, LoadControl) or size == np.inf:
        return min(moved, stepping.load / max(abs(way.mu), tiny))
    # Nobody knows what load it takes: where little moves steps grow without bound.
    return moved


def _correct_prediction(
    corrector: Corrector,
    control: Control,
    value: float,
    at: EquilibriumPoint,
    way: PathDirection,
    norm: StepNorm,
) -> EquilibriumPoint:
    """The point with this value of the control near to where a way leads."""
    guess = at.x + way.x, at.mu + way.mu
    found = corrector.corrected(control, value, *guess)
    off = norm.largest(found.x - guess[0])
    if off > _ASTRAY * norm.largest(found.x - at.x) + _ROUNDING:
        raise CorrectorError("the path turns away from its direction")
    return found


def _arc_direction(
    corrector: Corrector,
    stepping: ContinuationSettings,
    at: EquilibriumPoint,
    target: float,
    way: PathDirection | None,
) -> PathDirection:
    """The direction of the path by arc length, of length one, going on from `way`."""
    if way is None:
        way = corrector.tangent(at, LoadControl())
        ahead = target - at.mu if isinstance(stepping.aim, LoadControl) else 1.0
        way = way.times(float(np.sign(ahead)) or 1.0)
    return way.times(1.0 / stepping.norm.largest(way.x, way.mu))


def switch_branch(
    corrector: Corrector, path: Path, stepping: ContinuationSettings, side: float
) -> PathDirection:
    """Go from the last branch point of a path onto the path that crosses it there.

    The path then ends with the first point of the other; the direction it goes on in is returned.

    Raises
    ------
    StepError
        If no other path is found.
    """
    branch, norm = path.branches[-1], stepping.norm
    del path.points[branch.place + 1 :]
    path.critical = [one for one in path.critical if one.place <= branch.place]
    at, before = path.end, path.points[branch.place - 1]
    own = PathDirection(at.x - before.x, at.mu - before.mu)
    way = _crossing_direction(corrector, norm, at, branch.index, own)
    way = way.times(side / norm.largest(way.x, way.mu))
    control = norm.arc(at.x, at.mu, way)
    size = 0.5 * stepping.step
    while True:
        try:
            guess = at.x + size * way.x, at.mu + size * way.mu
            found = corrector.corrected(control, size, *guess)
            break
        except CorrectorError as problem:
            size *= _CUT
            if size < _LEAST * stepping.step:
                raise CorrectorError(
                    f"no other path was found at the branch point, {problem}"
                ) from None
    path.points.append(found)
    return PathDirection(found.x - at.x, found.mu - at.mu)


def _crossing_direction(
    corrector: Corrector, norm: StepNorm, at: EquilibriumPoint, index: int, own: PathDirection
) -> PathDirection:
    """About the direction of the path that crosses one of direction `own`.

    Both lie in the plane of the mode that is lost and of where the load leads besides; what is at
    right angles to `own` there is near enough for Newton's method.
    """
    if not len(at.stability.values):
        raise CorrectorError("paths that cross are not told apart where loads have no potential")
    mode = np.zeros_like(at.x)
    mode[: len(norm.scale)] = at.stability.mode(index)
    lost = PathDirection(mode, 0.0)
    ways = (lost, corrector.loaded(at, norm.row(lost)[0]))
    across = [norm.across(way, own) for way in ways]
    left = [
        norm.product(a, a) / norm.product(way, way) for a, way in zip(across, ways, strict=True)
    ]
    return across[int(np.argmax(left))]
