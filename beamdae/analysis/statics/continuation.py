"""Predictor-corrector continuation of equilibrium paths, with branch switching.

Steps are controlled by load, displacement or pseudo-arc length (Keller 1977). Failed steps are
shortened and repeated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from beamdae.analysis.statics.bordered_system import Correction, LoadSteps
from beamdae.analysis.statics.corrector import Corrector, CorrectorError, EquilibriumPoint
from beamdae.analysis.statics.critical_points import BRANCH, PathSegment, SegmentCriticalPoint
from beamdae.analysis.statics.newton_loop import (
    CUT_FACTOR,
    MIN_STEP_RATIO,
    choose_step,
    leaves_path,
    propose_step,
)
from beamdae.analysis.statics.path_controls import (
    Control,
    DisplacementControl,
    LoadControl,
    PathDirection,
    StepNorm,
)
from beamdae.results.outcome import REACHED_END, Status

Array = np.ndarray

# Smallest permitted cosine of the angle between successive directions: for a step by arc length (a
# crossing path leaves at a larger angle), and for the step to grow.
_MIN_COSINE = 0.7
_MIN_COSINE_TO_GROW = 0.95
# A trial step of this fraction measures the curvature of the path at its beginning. It limits the
# first step, because one of twice the rise of a shallow truss leads over both limit points to a
# point with the same tangent.
_TRIAL_STEP_RATIO = 1e-2
# Steps below this fraction of the largest step may turn by any angle, because the path has a
# corner, such as the one where a contact closes. Where the load reverses, no point lies at the
# prescribed distance along the last direction, and the displacements alone control the step.
_CORNER_STEP_RATIO = 1e-3
# A step that happens to end at a critical point, up to rounding, is multiplied by this factor: next
# to the point, rounding determines the motion along the critical mode. Its smallest eigenvalue is
# then below the fraction of that at the other end.
_AVOIDANCE_FACTOR = 0.75
_CRITICAL_END_RATIO = 0.05
_CRITICAL_TANGENT_RATIO = 3.0
# Distance, relative to the largest step, within which two branch points are considered equal.
_SAME_POINT_RATIO = 1e-2
_CLOSED_PATH = (
    "the path is closed and returns to a branch point passed before; switch at one "
    "more branch point, for example with switch=[1, 1]"
)


@dataclass(frozen=True)
class PathCriticalPoint:
    """Critical point of an equilibrium path.

    Attributes
    ----------
    kind
        `LIMIT`, `BRANCH` or `FLUTTER`.
    row
        Index of the point in the path.
    mode
        Shape (n,) of the critical mode.
    loads
        See `SegmentCriticalPoint.loads`.
    """

    kind: str
    row: int
    mode: Array
    loads: tuple[float, float] | None = None


@dataclass
class StagePath:
    """Equilibrium path of one load stage, extended by continuation.

    Attributes
    ----------
    points
        Equilibria in order along the path, including critical points.
    critical
        Critical points of the path.
    status
        Status at the end of the path, with the reason why the path ended.
    step
        Proposed size of the next step, in units of the control; infinity before the first step.
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
        """Last point of the path."""
        return self.points[-1]

    @property
    def branch_points(self) -> list[PathCriticalPoint]:
        """Points at which other paths cross."""
        return [one for one in self.critical if one.kind == BRANCH]

    def append(self, segment: PathSegment, critical: Sequence[SegmentCriticalPoint]) -> None:
        """Append the critical points and the end of a segment."""
        for one in critical:
            row = len(self.points)
            self.critical.append(PathCriticalPoint(one.kind, row, one.mode, one.loads))
            self.points.append(one.point)
        self.points.append(segment.end)


@dataclass(frozen=True)
class ContinuationSettings:
    """Settings for the continuation of one path.

    Attributes
    ----------
    target_control
        Quantity to which the target values refer.
    by_arc_length
        True to control steps by arc length instead of `target_control`.
    max_step
        Largest permitted change of `target_control` in a step or, by arc length, largest permitted
        motion of a coordinate in natural sizes.
    max_load_step
        Largest permitted change of the load factor in steps by arc length: in the first step, and
        in all steps if the targets are load factors.
    norm
        Norm of path increments.
    max_points
        No further step is taken once the path has this many points.
    stop_at_branch_point
        Number of the branch point at which `follow_path` stops, counted from 1 in each call; 0
        never stops.
    stop_at_critical_point
        True to stop after the step that contains the first critical point of any kind.
    """

    target_control: Control
    by_arc_length: bool
    max_step: float
    max_load_step: float
    norm: StepNorm
    max_points: int
    stop_at_branch_point: int = 0
    stop_at_critical_point: bool = False


def follow_path(
    corrector: Corrector,
    path: StagePath,
    settings: ContinuationSettings,
    targets: Sequence[float],
    direction: PathDirection | None = None,
) -> None:
    """Extend `path` in place from its end to each target in turn.

    If the targets cannot be reached, `path.status` gives the reason. A stop at the requested branch
    or critical point does not change the status. `direction` is the initial direction of the path
    for steps by arc length. By default, the load factor changes towards the first target if the
    targets are load factors, and increases otherwise.
    """
    path.step, initial_count = np.inf, len(path.branch_points)
    control = settings.target_control
    by_load = isinstance(control, LoadControl) and not settings.by_arc_length
    if isinstance(control, DisplacementControl) and control.is_linear:
        # Once, because evaluating a column takes as long as an iteration.
        control = control.linearize(path.end.x, path.end.mu)
        settings = replace(settings, target_control=control)
    for target in targets:
        is_target_reached = settings.target_control.value(path.end.x, path.end.mu) == target
        while not is_target_reached:
            if len(path.points) >= settings.max_points:
                path.status = Status(
                    "limited",
                    f"stopped at the maximum of {len(path.points)} points; increase max_points, or "
                    f"step (now {settings.max_step:.2g})",
                )
                return
            before = len(path.branch_points)
            try:
                if by_load:
                    direction, steps = _take_regular_steps(
                        corrector, path, settings, target, direction
                    )
                    if steps is not None and not steps.has_halted:
                        is_target_reached = steps.has_arrived
                        continue
                    # A path on which each call halts at once would take each step twice.
                    by_load = steps is not None and len(steps.mu) > 0
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
            if settings.stop_at_critical_point and path.critical:
                return
            # Paths by load or displacement cannot return: their control is monotonic.
            is_new = settings.by_arc_length and count > before
            if is_new and _revisits_branch_point(path, settings, before):
                path.status = Status("failed", _CLOSED_PATH)
                return


def _revisits_branch_point(path: StagePath, settings: ContinuationSettings, count: int) -> bool:
    """Return True if the last branch point is one of the first `count`."""
    last = path.points[path.branch_points[-1].row]
    others = [path.points[one.row] for one in path.branch_points[:count]]
    return any(
        settings.norm.max_norm(one.x - last.x) < _SAME_POINT_RATIO * settings.max_step
        # Branch points of a straight column differ in their load factors only.
        and abs(one.mu - last.mu) < _SAME_POINT_RATIO * settings.max_load_step
        for one in others
    )


def _take_regular_steps(
    corrector: Corrector,
    path: StagePath,
    settings: ContinuationSettings,
    target: float,
    direction: PathDirection | None,
) -> tuple[PathDirection, LoadSteps | None]:
    """Append points of load control, in one compiled call, up to a possible critical point.

    Return the final direction and details of the steps, see `Corrector.follow_load`.
    """
    begin = path.end
    direction = direction or corrector.path_tangent(begin, settings.target_control)
    room, steps = settings.max_points - len(path.points), (path.step, settings.max_step)
    result = corrector.follow_load(begin, direction, target, steps, room)
    if result is None:
        return direction, None
    points, details = result
    path.points += points
    path.step = details.step
    return details.direction, details


def _take_step(
    corrector: Corrector,
    path: StagePath,
    settings: ContinuationSettings,
    target: float,
    direction: PathDirection | None,
) -> tuple[PathDirection | None, bool]:
    """Append the points of a step; return its final direction, and True if it reaches `target`."""
    begin, norm, target_control = path.end, settings.norm, settings.target_control
    sign, control = 1.0, target_control
    if settings.by_arc_length:
        direction = _arc_direction(corrector, settings, begin, target, direction)
        control = norm.arc_length_control(begin.x, begin.mu, direction)
        reach = _max_arc_step(settings, direction, path.step)
        size = min(path.step, reach)
        if path.step == np.inf:
            size = _limit_turn(corrector, control, begin, direction.scale(size), norm) * size
    else:
        direction = direction or corrector.path_tangent(begin, target_control)
        remaining = target - target_control.value(begin.x, begin.mu)
        sign, reach = float(np.sign(remaining)), abs(remaining)
        size = choose_step(path.step, reach, settings.max_step)
    usual_control, first_value = control, control.value(begin.x, begin.mu)
    min_size = min(MIN_STEP_RATIO * settings.max_step, size)
    may_avoid = True
    while True:
        is_last = size == reach and not settings.by_arc_length
        value = target if is_last else first_value + sign * size
        try:
            step = direction.scale(sign * size)
            end, result = _correct_prediction(corrector, control, value, begin, step)
            after = result.direction or corrector.try_path_tangent(end, control)
            cosine = norm.cosine(direction, after or direction) if settings.by_arc_length else 1.0
            if cosine < _MIN_COSINE and size > _CORNER_STEP_RATIO * settings.max_step:
                raise CorrectorError("the path turns too sharply for the step")
            segment = PathSegment(
                corrector, control, begin, end, (first_value, value), (direction, after)
            )
            if (
                settings.by_arc_length
                and after
                and norm.displacements_turn(direction, after, _MIN_COSINE_TO_GROW)
            ):
                segment.require_return()
            truncated = None
            if settings.by_arc_length:
                truncated = segment.truncate(target_control, target)
            if may_avoid and not is_last and truncated is None and _ends_at_critical_point(segment):
                may_avoid = False
                size *= _AVOIDANCE_FACTOR
                continue
            segment = truncated or segment
            critical = segment.locate_critical_points()
            break
        except CorrectorError as error:
            may_be_corner = settings.by_arc_length and control is usual_control
            may_be_corner &= size <= _CORNER_STEP_RATIO * settings.max_step
            if may_be_corner and norm.max_norm(direction.x) > 0.0:
                by_motion = replace(norm, factor=np.inf)
                control = by_motion.arc_length_control(begin.x, begin.mu, direction)
                continue
            control = usual_control
            size *= CUT_FACTOR
            if size < min_size:
                raise CorrectorError(str(error)) from None
    path.append(segment, critical)
    proposed = propose_step(size, end.iterations, result.correction, result.motion)
    if cosine <= _MIN_COSINE_TO_GROW:
        proposed = size
    arrived = truncated is not None or (not settings.by_arc_length and value == target)
    # A step that is shortened to meet a target does not shorten the next step.
    path.step = max(proposed, path.step if arrived else 0.0)
    return segment.directions[1], arrived


def _ends_at_critical_point(segment: PathSegment) -> bool:
    """Return True if an eigenvalue is zero up to rounding at the end only.

    If forces have no potential, the tangent of the path at the end decides: next to a critical
    point, rounding makes it several times as large as at the beginning.
    """
    if segment.end.is_count_certain:
        return False
    if not segment.end.has_potential:
        size = segment.corrector.displacement_measure.farthest
        n = segment.end.system.equations.n
        first, last = segment.directions
        return last is None or size(last.x[:n]) > _CRITICAL_TANGENT_RATIO * size(first.x[:n])
    smallest, before = (
        float(np.min(np.abs(point.stability.eigenvalues), initial=np.inf))
        for point in (segment.end, segment.begin)
    )
    is_free = before <= segment.begin.stability.zero_tolerance
    return not is_free and smallest < _CRITICAL_END_RATIO * before


def _max_arc_step(settings: ContinuationSettings, direction: PathDirection, last: float) -> float:
    """Return the largest permitted step by arc length.

    `last` is the step that the previous step proposes, or infinity for the first step. The change
    of the load factor is limited in every step if the load factor is the target, otherwise only in
    the first step, because the load that a displacement requires is not known in advance.
    """
    tiny = np.finfo(float).tiny
    by_motion = settings.max_step / max(settings.norm.max_norm(direction.x), tiny)
    if isinstance(settings.target_control, LoadControl) or last == np.inf:
        return min(by_motion, settings.max_load_step / max(abs(direction.mu), tiny))
    return by_motion


def _limit_turn(
    corrector: Corrector,
    control: Control,
    begin: EquilibriumPoint,
    step: PathDirection,
    norm: StepNorm,
) -> float:
    """Return the fraction of `step`, at most 1, in which the tangent does not turn too far."""
    trial = step.scale(_TRIAL_STEP_RATIO)
    value = control.value(begin.x + trial.x, begin.mu + trial.mu)
    try:
        end, result = _correct_prediction(corrector, control, value, begin, trial)
        after = result.direction or corrector.path_tangent(end, control)
    except CorrectorError:
        return 1.0
    angle = np.arccos(np.clip(norm.cosine(step, after), -1.0, 1.0))
    return min(
        1.0, _TRIAL_STEP_RATIO * np.arccos(_MIN_COSINE_TO_GROW) / max(angle, np.finfo(float).tiny)
    )


def _correct_prediction(
    corrector: Corrector,
    control: Control,
    value: float,
    begin: EquilibriumPoint,
    step: PathDirection,
) -> tuple[EquilibriumPoint, Correction]:
    """Return the equilibrium near begin + step at which the control equals `value`, and details.

    Raises
    ------
    CorrectorError
        If Newton's method fails, or leads to another path.
    """
    point, result = corrector.follow(control, value, begin, step)
    if leaves_path(result.correction, result.motion):
        raise CorrectorError("the path turns too sharply for the step")
    return point, result


def _arc_direction(
    corrector: Corrector,
    settings: ContinuationSettings,
    point: EquilibriumPoint,
    target: float,
    direction: PathDirection | None,
) -> PathDirection:
    """Return `direction`, or the default of `follow_path`, scaled to unit norm."""
    if direction is None:
        direction = corrector.path_tangent(point, LoadControl())
        by_load = isinstance(settings.target_control, LoadControl)
        remaining = target - point.mu if by_load else 1.0
        direction = direction.scale(float(np.sign(remaining)) or 1.0)
    return direction.scale(1.0 / settings.norm.max_norm(direction.x, direction.mu))


def switch_branch(
    corrector: Corrector, path: StagePath, settings: ContinuationSettings, side: float
) -> PathDirection:
    """Switch to the crossing path at the last branch point; return the new direction.

    Afterwards, `path` ends at the first point of the crossing path. `side`, 1 or -1, selects the
    direction.

    Raises
    ------
    CorrectorError
        If no point of the crossing path is found.
    """
    branch, norm = path.branch_points[-1], settings.norm
    del path.points[branch.row + 1 :]
    path.critical = [one for one in path.critical if one.row <= branch.row]
    point, before = path.end, path.points[branch.row - 1]
    path_direction = PathDirection(point.x - before.x, point.mu - before.mu)
    direction = _crossing_direction(corrector, norm, point, branch.mode, path_direction)
    direction = direction.scale(side / norm.max_norm(direction.x, direction.mu))
    control = norm.arc_length_control(point.x, point.mu, direction)
    size = 0.5 * settings.max_step
    while True:
        try:
            x = corrector.displace(point.x, size * direction.x)
            mu = point.mu + size * direction.mu
            first = corrector.correct(control, size, x, mu)
            break
        except CorrectorError as error:
            size *= CUT_FACTOR
            if size < MIN_STEP_RATIO * settings.max_step:
                raise CorrectorError(
                    f"no crossing path was found at the branch point: {error}"
                ) from None
    path.points.append(first)
    return PathDirection(first.x - point.x, first.mu - point.mu)


def _crossing_direction(
    corrector: Corrector,
    norm: StepNorm,
    point: EquilibriumPoint,
    shape: Array,
    path_direction: PathDirection,
) -> PathDirection:
    """Return the approximate direction of the crossing path.

    Both paths are tangent to the plane spanned by the critical mode and the load response without
    this mode. The direction in this plane orthogonal to `path_direction` is close enough for
    Newton's method.
    """
    x = np.zeros_like(point.x)
    x[: len(norm.scale)] = shape
    mode = PathDirection(x, 0.0)
    plane = (mode, corrector.load_response(point, norm.dual(mode)[0]))
    orthogonal = [norm.orthogonal_part(direction, path_direction) for direction in plane]
    shares = [
        norm.inner_product(part, part) / norm.inner_product(direction, direction)
        for part, direction in zip(orthogonal, plane, strict=True)
    ]
    return orthogonal[int(np.argmax(shares))]
