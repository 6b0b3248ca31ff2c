"""Predictor-corrector continuation of an equilibrium path, with step control and branch switching.

Steps go by load, displacement or pseudo-arc length (Keller 1977); a step that fails is cut back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from beamdae.analysis.statics.corrector import Corrector, CorrectorError, EquilibriumPoint
from beamdae.analysis.statics.critical_points import BRANCH, PathSegment, SegmentCriticalPoint
from beamdae.analysis.statics.path_controls import Control, LoadControl, PathDirection, StepNorm
from beamdae.results.outcome import REACHED_END, Status

Array = np.ndarray

# A step that fails is cut by this factor, down to this share of the largest step.
_CUT_FACTOR = 0.25
_MIN_STEP_RATIO = 1e-6
# A step grows by this factor if the corrector took at most this many Newton iterations.
_GROWTH_FACTOR = 1.5
_MAX_ITERATIONS_TO_GROW = 4
# Corrector displacement, relative to the step, beyond which the point lies on another path; the
# allowance for rounding is relative to the size of the mechanism.
_MAX_CORRECTION_RATIO = 0.5
_CORRECTION_ROUNDING = 1e-7
# Cosines of the angle between successive directions: the least in a step by arc length (where
# paths cross, the other one leaves at a larger angle), and the least for the step to grow.
_MIN_COSINE = 0.7
_MIN_COSINE_TO_GROW = 0.95
# Steps below this share of the largest step may turn by any angle: the path has a corner there.
_CORNER_STEP_RATIO = 1e-3
# Remaining distances up to this ratio to the step are halved, so that the last step is not tiny;
# those up to the second ratio, which differ by rounding, are covered in one step.
_SPLIT_RATIO = 1.2
_ROUNDING_RATIO = 1.001
# Distance, relative to the step, within which two branch points are the same.
_SAME_POINT_RATIO = 1e-2
_CLOSED_PATH = (
    "the path is closed, it returns to a branch point it has passed; to leave it, switch at one "
    "more branch point, as in switch=[1, 1]"
)


@dataclass(frozen=True)
class PathCriticalPoint:
    """A critical point of a path.

    Attributes
    ----------
    kind
        `LIMIT`, `BRANCH` or `FLUTTER`.
    row
        Index of the point in the path.
    index
        Number of eigenvalues below the one that vanishes.
    """

    kind: str
    row: int
    index: int


@dataclass
class StagePath:
    """The equilibrium path of one load stage, extended by continuation.

    Attributes
    ----------
    points
        The equilibria in the order of the path, critical points included.
    critical
        The critical points.
    status
        Why the path ended.
    step
        Size of the next step, in terms of the control.
    is_stuck
        True if the path ended because no step converges.
    """

    points: list[EquilibriumPoint] = field(default_factory=list)
    critical: list[PathCriticalPoint] = field(default_factory=list)
    status: Status = REACHED_END
    step: float = np.inf
    is_stuck: bool = False

    @property
    def end(self) -> EquilibriumPoint:
        """The last point of the path."""
        return self.points[-1]

    @property
    def branch_points(self) -> list[PathCriticalPoint]:
        """The points at which other paths cross."""
        return [one for one in self.critical if one.kind == BRANCH]

    def append(self, segment: PathSegment, critical: Sequence[SegmentCriticalPoint]) -> None:
        """Append the critical points of a segment and its end."""
        for one in critical:
            self.critical.append(PathCriticalPoint(one.kind, len(self.points), one.index))
            self.points.append(one.point)
        self.points.append(segment.end)


@dataclass(frozen=True)
class ContinuationSettings:
    """Settings of the continuation of one path.

    Attributes
    ----------
    target_control
        The quantity that the targets are values of.
    by_arc_length
        True if steps are controlled by arc length instead of `target_control`.
    max_step
        Largest step: of `target_control`, or by arc length of the largest motion in natural sizes.
    max_load_step
        Change of the load factor in the first step by arc length, and in every one where the
        targets are load factors.
    norm
        Norm of steps.
    max_points
        Maximum number of points.
    stop_at_branch_point
        Number of the branch point, counted from 1, at which to stop; 0: none.
    """

    target_control: Control
    by_arc_length: bool
    max_step: float
    max_load_step: float
    norm: StepNorm
    max_points: int
    stop_at_branch_point: int = 0


def follow_path(
    corrector: Corrector,
    path: StagePath,
    settings: ContinuationSettings,
    targets: Sequence[float],
    direction: PathDirection | None = None,
) -> None:
    """Follow a path from its end to each target in turn; `path` is extended in place.

    `direction` is the initial direction by arc length. Defaults to that of a growing load factor,
    or to that of the first target where the targets are load factors.
    """
    path.step, initial_count = np.inf, len(path.branch_points)
    for target in targets:
        is_target_reached = settings.target_control.value(path.end.x, path.end.mu) == target
        while not is_target_reached:
            if len(path.points) >= settings.max_points:
                path.status = Status("limited", f"ended after {len(path.points)} points")
                return
            before = len(path.branch_points)
            try:
                direction, is_target_reached = _take_step(
                    corrector, path, settings, target, direction
                )
            except CorrectorError as error:
                path.status, path.is_stuck = Status("failed", str(error)), True
                return
            count = len(path.branch_points)
            stop = settings.stop_at_branch_point
            if stop and count - initial_count >= stop:
                return
            if count > before and _revisits_branch_point(path, settings):
                path.status = Status("failed", _CLOSED_PATH)
                return


def _revisits_branch_point(path: StagePath, settings: ContinuationSettings) -> bool:
    *others, last = (path.points[one.row] for one in path.branch_points)
    distances = [settings.norm.max_norm(one.x - last.x, one.mu - last.mu) for one in others]
    return min(distances, default=np.inf) < _SAME_POINT_RATIO * settings.max_step


def _take_step(
    corrector: Corrector,
    path: StagePath,
    settings: ContinuationSettings,
    target: float,
    direction: PathDirection | None,
) -> tuple[PathDirection | None, bool]:
    """Append the points of one step; return the direction at its end and if it is at the target."""
    begin, norm, target_control = path.end, settings.norm, settings.target_control
    sign, control = 1.0, target_control
    if settings.by_arc_length:
        direction = _arc_direction(corrector, settings, begin, target, direction)
        control = norm.arc_length_control(begin.x, begin.mu, direction)
        reach = _max_arc_step(settings, direction, path.step)
        size = min(path.step, reach)
    else:
        direction = direction or corrector.path_tangent(begin, target_control)
        remaining = target - target_control.value(begin.x, begin.mu)
        sign, reach = float(np.sign(remaining)), abs(remaining)
        size = min(path.step, reach, settings.max_step)
    first_value = control.value(begin.x, begin.mu)
    if not settings.by_arc_length and size < reach < _SPLIT_RATIO * size:
        size = reach if reach < _ROUNDING_RATIO * size else 0.5 * reach
    min_size = min(_MIN_STEP_RATIO * settings.max_step, size)
    while True:
        is_last = size == reach and not settings.by_arc_length
        value = target if is_last else first_value + sign * size
        try:
            step = direction.scale(sign * size)
            end = _correct_prediction(corrector, control, value, begin, step, norm)
            after = corrector.try_path_tangent(end, control)
            cosine = norm.cosine(direction, after or direction) if settings.by_arc_length else 1.0
            if cosine < _MIN_COSINE and size > _CORNER_STEP_RATIO * settings.max_step:
                raise CorrectorError("the path turns away from its direction")
            segment = PathSegment(
                corrector, control, begin, end, (first_value, value), (direction, after)
            )
            truncated = None
            if settings.by_arc_length:
                truncated = segment.truncate(target_control, target)
            segment = truncated or segment
            critical = segment.locate_critical_points()
            break
        except CorrectorError as error:
            size *= _CUT_FACTOR
            if size < min_size:
                raise CorrectorError(str(error)) from None
    path.append(segment, critical)
    grows = end.iterations <= _MAX_ITERATIONS_TO_GROW and cosine > _MIN_COSINE_TO_GROW
    arrived = truncated is not None or (not settings.by_arc_length and value == target)
    # A step that is short because it arrives does not shorten the next one.
    path.step = max(size * (_GROWTH_FACTOR if grows else 1.0), path.step * arrived)
    return segment.directions[1], arrived


def _max_arc_step(settings: ContinuationSettings, direction: PathDirection, last: float) -> float:
    """Return the largest step by arc length; `last` is the previous one, infinite if there is none.

    The load factor limits every step if it is the target, otherwise only the first one: the load
    that a displacement requires is not known in advance.
    """
    tiny = np.finfo(float).tiny
    by_motion = settings.max_step / max(settings.norm.max_norm(direction.x), tiny)
    if isinstance(settings.target_control, LoadControl) or last == np.inf:
        return min(by_motion, settings.max_load_step / max(abs(direction.mu), tiny))
    return by_motion


def _correct_prediction(
    corrector: Corrector,
    control: Control,
    value: float,
    begin: EquilibriumPoint,
    step: PathDirection,
    norm: StepNorm,
) -> EquilibriumPoint:
    """Return the equilibrium near begin + step at which the control has this value."""
    x, mu = begin.x + step.x, begin.mu + step.mu
    point = corrector.correct(control, value, x, mu)
    correction, displacement = norm.max_norm(point.x - x), norm.max_norm(point.x - begin.x)
    if correction > _MAX_CORRECTION_RATIO * displacement + _CORRECTION_ROUNDING:
        raise CorrectorError("the path turns away from its direction")
    return point


def _arc_direction(
    corrector: Corrector,
    settings: ContinuationSettings,
    point: EquilibriumPoint,
    target: float,
    direction: PathDirection | None,
) -> PathDirection:
    """Return the direction by arc length, scaled to norm one; see `follow_path` for its default."""
    if direction is None:
        direction = corrector.path_tangent(point, LoadControl())
        by_load = isinstance(settings.target_control, LoadControl)
        remaining = target - point.mu if by_load else 1.0
        direction = direction.scale(float(np.sign(remaining)) or 1.0)
    return direction.scale(1.0 / settings.norm.max_norm(direction.x, direction.mu))


def switch_branch(
    corrector: Corrector, path: StagePath, settings: ContinuationSettings, side: float
) -> PathDirection:
    """Switch from the last branch point of a path onto the crossing path; return its direction.

    The path then ends with the first point of the crossing path. `side` is 1 or -1.

    Raises
    ------
    CorrectorError
        If no point of another path is found.
    """
    branch, norm = path.branch_points[-1], settings.norm
    del path.points[branch.row + 1 :]
    path.critical = [one for one in path.critical if one.row <= branch.row]
    point, before = path.end, path.points[branch.row - 1]
    path_direction = PathDirection(point.x - before.x, point.mu - before.mu)
    direction = _crossing_direction(corrector, norm, point, branch.index, path_direction)
    direction = direction.scale(side / norm.max_norm(direction.x, direction.mu))
    control = norm.arc_length_control(point.x, point.mu, direction)
    size = 0.5 * settings.max_step
    while True:
        try:
            x, mu = point.x + size * direction.x, point.mu + size * direction.mu
            first = corrector.correct(control, size, x, mu)
            break
        except CorrectorError as error:
            size *= _CUT_FACTOR
            if size < _MIN_STEP_RATIO * settings.max_step:
                raise CorrectorError(
                    f"no crossing path was found at the branch point, {error}"
                ) from None
    path.points.append(first)
    return PathDirection(first.x - point.x, first.mu - point.mu)


def _crossing_direction(
    corrector: Corrector,
    norm: StepNorm,
    point: EquilibriumPoint,
    index: int,
    path_direction: PathDirection,
) -> PathDirection:
    """Return the approximate direction of the path that crosses `path_direction`.

    Both directions lie in the plane of the critical mode and the load response without it. The
    direction in this plane orthogonal to `path_direction` is close enough for Newton's method.
    """
    if not len(point.stability.eigenvalues):
        raise CorrectorError("crossing paths cannot be separated where loads have no potential")
    x = np.zeros_like(point.x)
    x[: len(norm.scale)] = point.stability.mode(index)
    mode = PathDirection(x, 0.0)
    plane = (mode, corrector.load_response(point, norm.dual(mode)[0]))
    orthogonal = [norm.orthogonal_part(direction, path_direction) for direction in plane]
    shares = [
        norm.inner_product(part, part) / norm.inner_product(direction, direction)
        for part, direction in zip(orthogonal, plane, strict=True)
    ]
    return orthogonal[int(np.argmax(shares))]
