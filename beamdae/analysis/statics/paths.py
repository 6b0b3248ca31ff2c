"""Equilibrium paths through all load stages: start, continuation, and causes of early ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from beamdae.analysis.continuation.counts import Count
from beamdae.analysis.continuation.critical import (
    BRANCH,
    FLUTTER,
    LIMIT,
    critical_mode,
    explain_counts,
)
from beamdae.analysis.continuation.engine import (
    Control,
    CurveError,
    Point,
    Segment,
    Steps,
    Tangent,
    follow,
    prescribe_parameter,
    switch,
)
from beamdae.analysis.statics.load_scaling import LoadedEquations, Loading
from beamdae.analysis.statics.neutral_motions import hold_neutral_motions
from beamdae.analysis.statics.path_settings import ARC_LENGTH, DISPLACEMENT, LOAD, PathSettings
from beamdae.analysis.statics.prescribed_column import PrescribedColumn
from beamdae.analysis.statics.static_problem import StaticProblem
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.relaxation import relax_to_equilibrium
from beamdae.errors import BeamdaeError, list_first
from beamdae.interrupts import acknowledge
from beamdae.parts.joints.drivers import DrivenJoint
from beamdae.results.equilibrium import CriticalPoint
from beamdae.results.outcome import REACHED_END, Status

Array = np.ndarray

# Default steps by load and by displacement, relative to the distance to the farthest target.
_LOAD_STEP_RATIO = 0.1
_DISPLACEMENT_STEP_RATIO = 0.05
# The same for a quantity that varies in place of a load factor, whose path is a curve to plot.
_PARAMETER_STEP_RATIO = 0.02
# Default step by arc length, in natural sizes. If a column is the target, the step is also limited
# to this fraction of the motion needed to reach it.
_ARC_STEP = 0.05
_MAX_SHARE_OF_NEEDED_MOTION = 0.25
# Lower bound, in natural sizes, of the motion that arc lengths attribute to a load step.
_MIN_LOAD_STEP_MOTION = 1e-3
# Lower bound of the distance to a target, in load factor or in the unit of the column.
_MIN_REACH = 1e-12
# Largest accepted motion, in natural sizes, to an equilibrium found by Newton's method; beyond it,
# relaxation is used.
_MAX_INITIAL_MOTION = 0.05
# Smallest part of a load step with which a path from a motion without stiffness begins.
_MIN_FIRST_LOAD = 1e-6
# Distance, relative to the largest step, within which two branch points are equal.
_SAME_POINT_RATIO = 1e-2
# Relative difference up to which two coordinates of a mode have equal amplitudes.
_EQUAL_MOTION_TOLERANCE = 1e-6
_MAX_CHECK_POINTS = 100
_MAX_DRIVERS = 3  # in a message
_CLOSED_PATH = (
    "the path is closed and returns to a branch point passed before; switch at one "
    "more branch point, for example with switch=[1, 1]"
)


class PathCriticalPoint(NamedTuple):
    """Critical point in a row of a path, and its mode (n,)."""

    kind: str
    row: int
    mode: Array


@dataclass
class StagePath:
    """Equilibrium path of one load stage.

    Attributes
    ----------
    problem
        Equations of the stage.
    points
        Equilibria in order along the path, including critical points.
    critical
        Critical points of the path.
    tangent
        Direction of the path at its end; None if it is not known.
    status
        Status at the end of the path, with the reason why the path ended.
    is_stuck
        True if the path ended because no step converges.
    """

    problem: StaticProblem
    points: list[Point]
    critical: list[PathCriticalPoint] = field(default_factory=list)
    tangent: Tangent | None = None
    status: Status = REACHED_END
    is_stuck: bool = False

    @property
    def end(self) -> Point:
        """Last point of the path."""
        return self.points[-1]

    @property
    def branch_points(self) -> list[PathCriticalPoint]:
        """Points at which other paths cross."""
        return [one for one in self.critical if one.kind == BRANCH]

    def fail(self, sentence: object) -> None:
        """End the path with a reason."""
        self.status = Status("failed", str(sentence).rstrip("."))


class EquilibriumPath(NamedTuple):
    """Equilibrium path through all load stages.

    Attributes
    ----------
    points
        Equilibria in order along the path.
    factors
        Load factors of all stages at each point, (points, stages).
    critical
        Critical points; `row` is an index into `points`.
    status
        Status at the end of the path.
    iterations
        Number of Newton iterations that led to the points.
    notes
        Remarks on stages.
    approach
        Positions (n,) through which drivers are led from the drawing to the first point.
    """

    points: list[Point]
    factors: Array
    critical: tuple[CriticalPoint, ...]
    status: Status
    iterations: int
    notes: tuple[str, ...]
    approach: list[Array]


def problem_of(point: Point) -> StaticProblem:
    """Return the static equations that a point solves."""
    assert isinstance(point.problem, StaticProblem)
    return point.problem


def stability_of(point: Point) -> Count:
    """Return the stability of an equilibrium."""
    count: Count = point.monitor
    return count


def trace_path(loading: Loading, q: Array, settings: PathSettings) -> EquilibriumPath:
    """Trace the path from the equilibrium without scaled loads, near `q`, to the targets.

    Raises
    ------
    BeamdaeError
        If no equilibrium is found at which the path begins; or if the targets are values of a
        column that is not an observed position, or no load is scaled to reach them.
    """
    varies = loading.parameter is not None
    _require_loads(loading, settings)
    points: list[Point] = []
    factors: list[Array] = []
    critical: list[CriticalPoint] = []
    notes: list[str] = []
    approach: list[Array] = []
    last_control: Control = prescribe_parameter
    if settings.column:
        time = loading.systems[0].loaded.time
        last_control = PrescribedColumn.from_name(loading.full_equations, settings.column, time)
    status = REACHED_END
    for k, system in enumerate(loading.systems):
        is_last = k == len(loading.systems) - 1
        begin = (
            find_unloaded_equilibrium(StaticProblem(system), q, approach)
            if k == 0
            else _find_again(system, points[-1])
        )
        path = _begin_stage(system, begin)
        stage = settings if is_last else settings.for_earlier_stage()
        control = last_control if is_last else prescribe_parameter
        try:
            if system.has_scaled_loads:
                _follow_stage(path, stage, control)
        except KeyboardInterrupt:
            acknowledge()
            path.status = Status("interrupted", "interrupted")
        # A stage begins at the last point of the previous stage, which its first point replaces.
        first = len(points) - (k > 0)
        del points[first:], factors[first:]
        points += path.points
        row = np.where(np.arange(len(loading.stages) + varies) < k, 1.0, 0.0)
        for point in path.points:
            factors.append(row.copy())
            factors[-1][k : k + 1] = point.p
        for one in path.critical:
            coordinate = dominant_coordinate(system.equations, one.mode)
            factor = float(path.points[one.row].p)
            critical.append(CriticalPoint(one.kind, first + one.row, factor, coordinate))
        if system.has_scaled_loads:
            notes += _zero_load_notes(path, loading)
        status = _end_status(path, stage.control, loading.quantity)
        if not status.success:
            break
    all_factors = np.array(factors).reshape(len(points), len(loading.stages) + varies)
    iterations = sum(point.iterations for point in points)
    return EquilibriumPath(
        points, all_factors, tuple(critical), status, iterations, tuple(notes), approach
    )


def _require_loads(loading: Loading, settings: PathSettings) -> None:
    """Raise BeamdaeError if a column is prescribed, but no load is scaled."""
    if loading.stages or not settings.column:
        return
    cause = f"equilibrium: {settings.column} cannot be prescribed because no load is scaled"
    drivers = _list_drivers(loading.full_equations)
    if drivers:
        raise BeamdaeError(
            f"{cause}, and {list_first(drivers, _MAX_DRIVERS)} moves the mechanism; set t= to "
            "the time of the wanted position and omit to=, or replace the driver by a load."
        )
    raise BeamdaeError(f"{cause}; add a load to the mechanism and to loads=.")


def _list_drivers(equations: EquationsOfMotion) -> list[str]:
    mechanism = equations.mechanism
    if mechanism is None:
        return []
    parts = mechanism.parts.values()
    return [
        x.name for x in parts if isinstance(x, DrivenJoint) and x.name not in mechanism.inactive
    ]


def _zero_load_notes(path: StagePath, loading: Loading) -> list[str]:
    """Return a remark if the loads of a stage are zero at both ends of its path."""
    if loading.parameter is not None:
        if not (path.status.success and all(map(_is_unloaded, path.points))):
            return []
        return [
            f"equilibrium: nothing depends on {loading.parameter.name}, so all points of the path "
            "are equal; choose another quantity with over=."
        ]
    if path.end is path.points[0] or not all(map(_is_unloaded, (path.end, path.points[0]))):
        return []
    t = path.problem.system.loaded.time[0]
    return [
        f"equilibrium: all scaled loads are zero at t = {t:g} s, so all points of the path are "
        "equal; pass another time t=, other loads=, or other values of inputs."
    ]


def _is_unloaded(point: Point) -> bool:
    return not np.any(point.linearization.by_parameter)


def find_unloaded_equilibrium(
    problem: StaticProblem, q: Array, approach: list[Array] | None = None
) -> Point:
    """Return the equilibrium at which the path begins, under all loads if none is scaled.

    Relaxation is used if Newton's method fails or moves the mechanism too far; it appends positions
    to `approach`.
    """
    first, last = problem.system.ends
    x = problem.start(q)
    try:
        point = problem.correct(prescribe_parameter, first, x, first)
        motion = np.abs(point.x - x) * problem.weights
        if np.max(motion, initial=0.0) <= _MAX_INITIAL_MOTION:
            return point
    except CurveError:
        pass
    return _relax(problem, q, first if problem.system.has_scaled_loads else last, approach)


def _relax(problem: StaticProblem, q: Array, mu: float, passed: list[Array] | None = None) -> Point:
    q, lam = relax_to_equilibrium(problem.system.at_factor(mu), q, passed)
    x = problem.start(q)
    x[len(q) : len(q) + len(lam)] = lam
    point = Point(problem, x, mu, problem.linearize(x, mu))
    # Rounding would move the mechanism along motions without stiffness.
    held = _hold_neutral_motions(point) if stability_of(point).free else point
    try:
        point = problem_of(held).correct(prescribe_parameter, mu, x, mu)
    except CurveError:
        return point
    return Point(problem, point.x, mu, problem.linearize(point.x, mu), point.iterations)


def follow_to_critical_point(begin: Point, targets: tuple[float, ...]) -> StagePath:
    """Return the path by arc length from `begin` to its first critical point.

    It has a point at each of the load factors `targets` before, ends at the last one if there is no
    critical point, and earlier with a status that is no success if it cannot be followed.
    """
    problem = problem_of(begin)
    path = StagePath(problem, [begin])
    settings = PathSettings("", targets, ARC_LENGTH, None, (), _MAX_CHECK_POINTS)
    steps = _choose_steps(begin, settings, prescribe_parameter)
    _follow(path, prescribe_parameter, targets, steps, settings, 1, (LIMIT, BRANCH, FLUTTER))
    return path


def _find_again(system: LoadedEquations, end: Point) -> Point:
    """Return the begin of a stage at the end of the previous one."""
    problem, mu = StaticProblem(system), system.ends[0]
    return Point(problem, end.x, mu, problem.linearize(end.x, mu))


def _begin_stage(system: LoadedEquations, begin: Point) -> StagePath:
    """Return the path that begins at a point, with neutral motions held."""
    if stability_of(begin).free and system.has_scaled_loads:
        begin = _hold_neutral_motions(begin)
    return StagePath(problem_of(begin), [begin])


def _hold_neutral_motions(point: Point) -> Point:
    system = problem_of(point).system
    size = system.equations.n + system.equations.m
    held = hold_neutral_motions(system, point.x[:size], point.p)
    if not held.held_coordinates:
        return point
    problem = StaticProblem(held)
    return Point(problem, point.x, point.p, problem.linearize(point.x, point.p))


def _follow_stage(path: StagePath, settings: PathSettings, control: Control) -> None:
    """Extend the path of one stage to the targets; switch branches as the settings request."""
    begin = path.end
    if settings.column and _is_unloaded(begin):
        t = path.problem.system.loaded.time[0]
        path.fail(f"all scaled loads are zero at t = {t:g} s; pass another time t= or other loads=")
        return
    steps = _choose_steps(begin, settings, control)
    targets = list(settings.targets)
    if stability_of(begin).free and not _leave_free_position(path, control, targets):
        return
    try:
        for number in settings.switch:
            count = _follow(path, control, targets, steps, settings, stop=abs(number))
            if path.status.success and count < abs(number):
                path.fail(
                    f"switch={number} requests branch point {abs(number)}, but the number of "
                    f"branch points found is {count}; use a smaller number or a farther target"
                )
            if not path.status.success:
                return
            _switch(path, steps, float(np.sign(number)))
    except CurveError as error:
        path.fail(error)
        return
    _follow(path, control, targets, steps, settings)
    if path.is_stuck and path.end is begin and control is prescribe_parameter:
        # The mechanism moves far under the smallest load, until it is stretched or rests.
        stuck, path.status, path.is_stuck = path.status, REACHED_END, False
        if _begin_under_load(path, control, targets):
            _follow(path, control, targets, _choose_steps(path.end, settings, control), settings)
        elif len(path.points) == 1:
            path.status, path.is_stuck = stuck, True


def _follow(
    path: StagePath,
    control: Control,
    targets: Sequence[float],
    steps: Steps,
    settings: PathSettings,
    stop: int = 0,
    stops_at: tuple[str, ...] = (BRANCH,),
) -> int:
    """Extend the path to each target in turn; return the number of critical points found.

    They are those of the kinds `stops_at`; the path ends at the one with the number `stop`.
    """
    count = 0
    for target in targets:
        tangent = path.tangent
        if tangent is None and steps.by_arc_length and control is not prescribe_parameter:
            tangent = path.end.tangent(prescribe_parameter(path.end.x, path.end.p))
        try:
            for segment, found in follow(path.end, control, target, steps, explain_counts, tangent):
                known = len(path.branch_points)
                for one in found:
                    row, n = len(path.points), path.problem.n
                    path.critical.append(PathCriticalPoint(one.kind, row, one.mode[:n]))
                    path.points.append(one.point)
                    count += one.kind in stops_at
                    if stop and count == stop:
                        return count
                    if one.kind == BRANCH and steps.by_arc_length and _revisits(path, steps, known):
                        path.fail(_CLOSED_PATH)
                        return count
                path.points.append(segment.end)
                path.tangent = _try_tangent(segment)
                is_reached = control(path.end.x, path.end.p).value == target
                if len(path.points) >= settings.max_points and not is_reached:
                    path.status = Status(
                        "limited",
                        f"stopped at the maximum of {len(path.points)} points; increase "
                        f"max_points, or step (now {steps.largest:.2g})",
                    )
                    return count
        except CurveError as error:
            path.fail(error)
            path.is_stuck = True
            break
    return count


def _try_tangent(segment: Segment) -> Tangent | None:
    """Return the tangent at the end of a segment; None if it is not unique."""
    try:
        return segment.direction
    except CurveError:
        return None


def _revisits(path: StagePath, steps: Steps, known: int) -> bool:
    """Return True if the last branch point of a path is one of the first `known` ones."""
    points = [path.points[one.row] for one in path.branch_points]
    others, last = points[:known], points[-1]
    weights, size = path.problem.weights, _SAME_POINT_RATIO * steps.largest
    return any(
        np.max(np.abs(one.x - last.x) * weights) < size
        # Branch points of a straight column differ in their load factors only.
        and abs(one.p - last.p) * steps.parameter_weight < size
        for one in others
    )


def _switch(path: StagePath, steps: Steps, side: float) -> None:
    """Let the path leave its last branch point along the crossing path."""
    branch, mode = path.end, np.zeros(len(path.end.x))
    mode[: path.problem.n] = path.branch_points[-1].mode
    before = path.points[-2]
    # The tangent is not unique at the branch point.
    chord = Tangent(branch.x - before.x, branch.p - before.p)
    first, path.tangent = switch(branch, mode, chord, side, steps)
    path.points.append(first)


def _choose_steps(begin: Point, settings: PathSettings, control: Control) -> Steps:
    """Return the steps of a stage, with default sizes where none are set."""
    weights = begin.problem.weights
    row = control(begin.x, begin.p)
    reach = max(*(abs(target - row.value) for target in settings.targets), _MIN_REACH)
    by_load = control is prescribe_parameter
    ratio = _PARAMETER_STEP_RATIO if settings.varies else _LOAD_STEP_RATIO
    load_step = ratio * (reach if by_load else 1.0)
    if settings.control != ARC_LENGTH:
        default = load_step if by_load else _DISPLACEMENT_STEP_RATIO * reach
        return Steps(settings.step or default)
    step = _ARC_STEP
    if not by_load:
        # Largest change of the column if all coordinates move by their natural sizes.
        is_coordinate = weights > 0.0
        sensitivity = float(np.sum(np.abs(row.x[is_coordinate]) / weights[is_coordinate]))
        step = min(step, _MAX_SHARE_OF_NEEDED_MOTION * reach / max(sensitivity, _MIN_REACH))
    try:
        motion = begin.problem.measure(begin.tangent(prescribe_parameter(begin.x, begin.p)).x)
    except CurveError:
        motion = 0.0
    # A load is weighted no less than the motion that it causes, so that crossing paths differ in
    # direction.
    weight = max(motion, _MIN_LOAD_STEP_MOTION / load_step)
    step = settings.step or step
    if by_load:
        return Steps(step, True, weight, load_step)
    # The load that a displacement requires is not known in advance.
    return Steps(step, True, weight, first=min(1.0, weight * load_step / step))


def _leave_free_position(path: StagePath, control: Control, targets: list[float]) -> bool:
    """Begin a path where a motion has no stiffness; return True if it can be followed.

    The motion may get stiffness by a small load, near the begin; otherwise the mechanism moves far
    under it.
    """
    problem, begin = path.problem, path.end
    by_load = control is prescribe_parameter
    reach = targets[0] - begin.p if by_load else 1.0
    first = float(np.clip(reach, -1.0, 1.0)) * _LOAD_STEP_RATIO
    small = _MIN_FIRST_LOAD * first
    try:
        point = problem.correct(prescribe_parameter, begin.p + small, begin.x, begin.p + small)
        motion = np.abs(point.x - begin.x) * problem.weights
        if np.max(motion, initial=0.0) <= _MAX_INITIAL_MOTION and not stability_of(point).free:
            tangent = point.tangent(prescribe_parameter(point.x, point.p))
            path.tangent = tangent.scale(float(np.sign(small)) or 1.0)
            return True
    except CurveError:
        pass
    return _begin_under_load(path, control, targets)


def _begin_under_load(path: StagePath, control: Control, targets: list[float]) -> bool:
    """Begin a path at the first load step, found by relaxation; return True if it can be followed.

    The position without load is arbitrary if it has a motion without stiffness; the path then
    begins under load. Targets that are passed are removed.
    """
    problem, begin, by_load = path.problem, path.end, control is prescribe_parameter
    is_arbitrary = bool(stability_of(begin).free)
    step = _LOAD_STEP_RATIO * (abs(targets[0] - begin.p) if by_load else 1.0)
    loads = list(targets) if by_load else [begin.p + step]
    try:
        for k, target in enumerate(loads):
            end = path.end
            mu = end.p + float(np.clip(target - end.p, -step, step)) if step else target
            # Loads give motions other than neutral ones a stiffness.
            point = _relax(problem, end.x[: problem.n], mu)
            point = _hold_neutral_motions(point) if stability_of(point).free else point
            if not stability_of(point).free:
                path.problem = problem_of(point)
                path.points[len(path.points) - is_arbitrary :] = [point]
                del targets[:k]
                return True
            if not by_load:
                path.fail(_describe_freedom(free_coordinate(point)))
                return False
            path.points.append(_relax(problem, end.x[: problem.n], target))
    except BeamdaeError as error:
        path.fail(error)
    return False


def free_coordinate(point: Point) -> str:
    """Return the name of the coordinate that moves most in a motion without stiffness.

    The name is "" if there is no such motion.
    """
    problem = problem_of(point)
    e = problem.system.equations
    if problem.system.held_coordinates:
        return e.q_names[problem.system.held_coordinates[0]]
    if not stability_of(point).free:
        return ""
    try:
        mode = critical_mode(point)[: problem.n]
    except CurveError:
        diagonal = problem.matrix(point.x, point.p).diagonal()[: problem.n]
        mode = np.where(diagonal == 0.0, e.position_scales, 0.0)
    return dominant_coordinate(e, mode)


def dominant_coordinate(e: EquationsOfMotion, mode: Array) -> str:
    """Return the name of the coordinate that moves most in a mode, relative to its natural size."""
    size = np.abs(mode / e.position_scales)
    largest = np.flatnonzero(size >= (1.0 - _EQUAL_MOTION_TOLERANCE) * np.max(size)).tolist()
    # If amplitudes are equal, an angle describes the mode better than the points it moves.
    return e.q_names[min(largest, key=lambda k: (e.coordinates[k].unit != "rad", k))]


def _end_status(path: StagePath, control: str, quantity: str) -> Status:
    """Return the status of a path; if it ended early, with the last load factor.

    A remedy is added if no step converges.
    """
    if path.status.success:
        return path.status
    sentence = f"{path.status.sentence} (last converged {quantity}: {path.end.p:.6g})"
    if path.is_stuck and (jump := _find_jump(path)) is not None:
        sentence += f"; the loads jump at t = {jump:g} s, so begin another path there with from_="
    elif path.is_stuck:
        sentence += f"; {remedy}" if (remedy := _remedy(path, control)) else ""
    return Status(path.status.kind, sentence)


def _find_jump(path: StagePath) -> float | None:
    """Return the breakpoint [s] at which a path over the time ends, or None."""
    system = path.problem.system
    first, last = system.ends
    if system.time_at(first)[0] == system.time_at(last)[0]:
        return None
    distance = _MIN_FIRST_LOAD * abs(last - first)
    near = (x for x in system.equations.breakpoints if abs(x - path.end.p) <= distance)
    return next(near, None)


def _describe_freedom(coordinate: str) -> str:
    return (
        f"{coordinate} is free to move under the loads, which do not change it; choose its value "
        f"with start={{{coordinate!r}: ...}}, and set to= to a load factor"
    )


def _remedy(path: StagePath, control: str) -> str:
    """Return the end of a message: why steps probably fail, and a remedy; "" if unknown."""
    is_first = len(path.points) == 1
    if control == DISPLACEMENT and is_first:
        free = free_coordinate(path.end)
        return (
            _describe_freedom(free) if free else "check that the loads move the prescribed column"
        )
    if control == DISPLACEMENT:
        return "use control='arc length' to continue where a displacement reverses"
    if control == LOAD and is_first:
        return "even 1e-8 of the largest step fails, so check the size of the loads"
    if control == LOAD:
        return "use control='arc length' to continue past the maximum of a load"
    return ""
