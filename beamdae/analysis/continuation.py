"""Following an equilibrium path: predictor and corrector, with cut-back, to one target or more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beamdae.analysis.controls import Control, LoadControl, Norm
from beamdae.analysis.corrector import Corrector, Point, StepError
from beamdae.analysis.path import Path, Stretch
from beamdae.results.outcome import Status

Array = np.ndarray

# A step is cut to this share where it fails, and given up below the least of the largest step.
_CUT, _LEAST = 0.25, 1e-6
# It grows by this factor where Newton's method takes at most so many iterations.
_GROWTH, _EASY = 1.5, 4
# How far a point may be from its prediction, of the way made: farther off it is another path.
_ASTRAY, _ROUNDING = 0.5, 1e-7


@dataclass(frozen=True)
class Stepping:
    """How a path is followed.

    Attributes
    ----------
    aim
        What the targets are values of.
    by_arc
        Whether steps go by arc length; if not by the aim.
    step
        The largest step: of the aim, or of the norm.
    most
        Points at most.
    leave_at
        Which branch point ends the path, counted from 1; 0: none.
    """

    aim: Control
    by_arc: bool
    step: float
    norm: Norm
    most: int
    leave_at: int = 0


@dataclass(frozen=True)
class Way:
    """The direction of a path at a point, of x = (q, lam) and of the factor."""

    x: Array
    mu: float

    def times(self, factor: float) -> Way:
        """So many times as far."""
        return Way(factor * self.x, factor * self.mu)


def follow(
    corrector: Corrector,
    path: Path,
    stepping: Stepping,
    targets: Sequence[float],
    way: Way | None = None,
) -> None:
    """Follow a path from its end to the targets, one after the other.

    `way` is the direction in which it begins by arc length; None: that of a growing factor, or to
    the first target if that is one.
    """
    path.size, left = stepping.step, len(path.branches)
    for target in targets:
        reached = stepping.aim.value(path.end.x, path.end.mu) == target
        while not reached:
            if len(path.points) >= stepping.most:
                path.status = Status("limited", f"ended after {len(path.points)} points")
                return
            try:
                way, reached = _stepped(corrector, path, stepping, target, way)
            except StepError as problem:
                path.status = Status("failed", str(problem))
                return
            if stepping.leave_at and len(path.branches) - left >= stepping.leave_at:
                return


def _stepped(
    corrector: Corrector, path: Path, stepping: Stepping, target: float, way: Way | None
) -> tuple[Way, bool]:
    """Add the points of one step to the path; its direction, and whether the target is reached."""
    at, norm, aim = path.end, stepping.norm, stepping.aim
    sign, control, reach = 1.0, aim, stepping.step
    if stepping.by_arc:
        way = _arc_way(corrector, stepping, at, target, way)
        control = norm.arc(at.x, at.mu, way.x, way.mu)
        if not isinstance(aim, LoadControl):
            # Nobody knows what load it takes: where little moves its steps grow without bound.
            reach = stepping.step / max(norm.largest(way.x), 1e-9)
    else:
        way = Way(*corrector.tangent(at, aim))
        ahead = target - aim.value(at.x, at.mu)
        sign, reach = float(np.sign(ahead)), abs(ahead)
    begin = control.value(at.x, at.mu)
    size = min(path.size, reach)
    # The last step but one leaves no splinter.
    if not stepping.by_arc and size < reach < 1.2 * size:
        size = 0.5 * reach
    least = min(_LEAST * stepping.step, size)
    while True:
        end = target if size == reach and not stepping.by_arc else begin + sign * size
        try:
            found = _near(corrector, control, end, at, way.times(sign * size), norm)
            break
        except StepError as problem:
            size *= _CUT
            if size < least:
                raise StepError(str(problem)) from None
    stretch = Stretch(corrector, control, at, found, (begin, end))
    landed = stretch.up_to(aim, target) if stepping.by_arc else None
    path.add(landed or stretch)
    grown = _GROWTH if found.iterations <= _EASY else 1.0
    arrived = landed is not None or (not stepping.by_arc and end == target)
    # A step that is short because it arrives says nothing of the next.
    path.size = max(size * grown, path.size * arrived)
    return way, arrived


def _near(
    corrector: Corrector, control: Control, value: float, at: Point, way: Way, norm: Norm
) -> Point:
    """The point with this value of the control near to where a way leads."""
    guess = at.x + way.x, at.mu + way.mu
    found = corrector.corrected(control, value, *guess)
    off = norm.largest(found.x - guess[0])
    if off > _ASTRAY * norm.largest(found.x - at.x) + _ROUNDING:
        raise StepError("the path turns away from its direction")
    return found


def _arc_way(
    corrector: Corrector, stepping: Stepping, at: Point, target: float, way: Way | None
) -> Way:
    """The direction of the path by arc length, of length one, going on from `way`."""
    if way is None:
        way = Way(*corrector.tangent(at, LoadControl()))
        ahead = target - at.mu if isinstance(stepping.aim, LoadControl) else 1.0
        way = way.times(float(np.sign(ahead)) or 1.0)
    else:
        along = stepping.norm.arc(at.x, at.mu, way.x, way.mu)
        way = Way(*corrector.tangent(at, along))
    return way.times(1.0 / stepping.norm.largest(way.x, way.mu))


def switched(corrector: Corrector, path: Path, stepping: Stepping, side: float) -> Way:
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
    at = path.end
    n = len(norm.scale)
    mode = np.zeros_like(at.x)
    mode[:n] = at.stability.mode(branch.index)
    # What of the mode goes along the path that is left belongs to that.
    before = path.points[branch.place - 1]
    own = Way(at.x - before.x, at.mu - before.mu)
    along = norm.arc(np.zeros_like(at.x), 0.0, own.x, own.mu)
    share = along.value(mode, 0.0)
    way = Way(mode - share * own.x, -share * own.mu)
    way = way.times(side / norm.largest(way.x, way.mu))
    control = norm.arc(at.x, at.mu, way.x, way.mu)
    size = 0.5 * stepping.step
    while True:
        try:
            guess = at.x + size * way.x, at.mu + size * way.mu
            found = corrector.corrected(control, size, *guess)
            break
        except StepError as problem:
            size *= _CUT
            if size < _LEAST * stepping.step:
                raise StepError(f"no other path was found at the branch point, {problem}") from None
    path.points.append(found)
    return Way(found.x - at.x, found.mu - at.mu)
