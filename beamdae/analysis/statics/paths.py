"""Equilibrium paths through all load stages: start, continuation, and causes of early ends."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.continuation.critical import (
    BRANCH,
    FLUTTER,
    LIMIT,
    explain_counts,
)
from beamdae.analysis.continuation.critical import CriticalPoint as CurvePoint
from beamdae.analysis.continuation.engine import (
    ROUNDING,
    Control,
    CurveError,
    Point,
    Steps,
    follow,
    prescribe_parameter,
    switch,
)
from beamdae.analysis.eigenproblems.eigensolution import locate_largest
from beamdae.analysis.statics.load_scaling import Loading
from beamdae.analysis.statics.neutral_motions import (
    are_neutral,
    hold_neutral_motions,
    prefer_angles,
)
from beamdae.analysis.statics.path_parameters import PathParameter
from beamdae.analysis.statics.path_settings import (
    ARC_LENGTH,
    DISPLACEMENT,
    LOAD,
    PathSettings,
    PrescribedColumn,
)
from beamdae.analysis.statics.static_problem import StaticProblem
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.relaxation import relax_to_equilibrium
from beamdae.errors import BeamdaeError
from beamdae.interrupts import acknowledge
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
# Parts of a load step with which a path from a motion without stiffness may begin.
_FIRST_LOADS = 1.0, 1e-2, 1e-4, 1e-6
# Distance, relative to the largest step, within which two branch points are equal.
_SAME_POINT_RATIO = 1e-2
_MAX_CHECK_POINTS = 100
_CLOSED_PATH = (
    "the path is closed and returns to a branch point passed before; switch at one more branch "
    "point, in one of both directions, for example with switch=[1, 1] or [1, -1]"
)
_REMEDIES = {
    DISPLACEMENT: "check that the loads move the prescribed column, or use control='arc length' to "
    "continue where a displacement reverses",
    LOAD: "check the size of the loads and jumps of their laws, or use control='arc length' to "
    "continue past the maximum of a load",
}


@dataclass
class StagePath:
    """Equilibrium path of one load stage.

    Attributes
    ----------
    problem
        Equations without held motions.
    points
        Equilibria in order along the path, including critical points.
    settings, control
        Settings of the path, and the quantity whose values are its targets.
    critical
        Critical points of the path by their index in `points`.
    tangent
        Direction of the path at its end; None if it is not known.
    status
        Status at the end of the path, with the reason why the path ended.
    is_stuck
        True if the path ended because no step converges.
    """

    problem: StaticProblem
    points: list[Point]
    settings: PathSettings
    control: Control = prescribe_parameter
    critical: dict[int, CurvePoint] = field(default_factory=dict)
    tangent: Array | None = None
    status: Status = REACHED_END
    is_stuck: bool = False

    @property
    def end(self) -> Point:
        """Last point of the path."""
        return self.points[-1]

    @property
    def by_load(self) -> bool:
        """True if targets are load factors."""
        return self.control is prescribe_parameter

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
    notes
        Remarks on stages.
    approach
        Positions (n,) through which drivers are led from the drawing to the first point.
    """

    points: list[Point]
    factors: Array
    critical: tuple[CriticalPoint, ...]
    status: Status
    notes: tuple[str, ...]
    approach: list[Array]


def trace_path(loading: Loading, q: Array, settings: PathSettings) -> EquilibriumPath:
    """Trace the path from the equilibrium without scaled loads, near `q`, to the targets.

    Raises
    ------
    BeamdaeError
        If no equilibrium is found at which the path begins; or if the targets are values of a
        column that is not an observed position, or no load is scaled to reach them.
    """
    control: Control = prescribe_parameter
    if settings.column:
        if not loading.stages:
            raise BeamdaeError(
                f"equilibrium: {settings.column} cannot be prescribed because no load is scaled; "
                "add a load to the mechanism and to loads=, or, if a driver moves the mechanism, "
                "set t= to the time of the wanted position and omit to=."
            )
        time = loading.systems[0].loaded.time
        control = PrescribedColumn.from_name(loading.full_equations, settings.column, time)
    points, stages = list[Point](), list[int]()
    critical, notes, approach = list[CriticalPoint](), list[str](), list[Array]()
    for k, system in enumerate(loading.systems):
        problem = StaticProblem(system)
        if k == 0:
            begin = find_unloaded_equilibrium(problem, q, approach)
        else:
            begin = problem.point(points.pop().x, system.ends[0])
            stages.pop()
        path = StagePath(problem, [begin], PathSettings(max_points=settings.max_points))
        if k == len(loading.systems) - 1:
            path.settings, path.control = settings, control
        if system.has_scaled_loads:
            try:
                _follow_stage(path)
            except KeyboardInterrupt:
                acknowledge()
                path.status = Status("interrupted", "interrupted")
        for row, one in path.critical.items():
            moves = dominant_coordinate(system.equations, one.mode)
            count = sum(x.point is one.point for x in path.critical.values())
            place = len(points) + row, float(one.point.p)
            critical.append(CriticalPoint(one.kind, *place, moves, count))
        points += path.points
        stages += [k] * len(path.points)
        causes = (describe_zero_loads(point, loading.parameter) for point in reversed(path.points))
        if len(path.points) > 1 and all(cause := x for x in causes):
            notes.append(f"equilibrium: all points of the path are equal, because {cause}.")
        status = path.status
        if not status.success:
            sentence = f"{status.sentence} (last converged {loading.quantity}: {path.end.p:.6g})"
            remedy = _REMEDIES.get(path.settings.control) if path.is_stuck else None
            status = Status(status.kind, f"{sentence}; {remedy}" if remedy else sentence)
            break
    columns = np.arange(len(loading.stages) + (loading.parameter is not None))
    of_row, values = np.array(stages)[:, None], np.array([[point.p] for point in points])
    factors = np.where(columns == of_row, values, columns < of_row)
    return EquilibriumPath(points, factors, tuple(critical), status, tuple(notes), approach)


def tabulate_points(loading: Loading, points: Sequence[Point]) -> dict[str, Any]:
    """Return the fields of `Equilibrium` with a row for each point."""
    e, parameter = loading.systems[0].equations, loading.parameter
    states = np.array([point.x for point in points])
    q, lam, _ = np.split(states, [e.n, e.n + e.m], axis=1)
    times = np.array([point.problem.system.time_at(point.p) for point in points])
    numbers = None
    if parameter is not None and parameter.time is not None:
        numbers = np.array([parameter.equations_at(point.p).p for point in points])
    lam = loading.full_multipliers(q, lam, times)
    return {"q": q, "lam": lam, "times": times, "numbers": numbers}


def describe_zero_loads(point: Point, parameter: PathParameter | None = None) -> str:
    """Return a clause if nothing depends on the load factor, or on a parameter, or ""."""
    if np.any(point.linearization.by_parameter):
        return ""
    if parameter is not None:
        return f"nothing depends on {parameter.name}; choose another quantity with over="
    t = point.problem.system.loaded.time[0]
    return (
        f"all scaled loads are zero at t = {t:g} s; pass another time t=, other loads=, or other "
        "values of inputs"
    )


def find_unloaded_equilibrium(
    problem: StaticProblem, q: Array, approach: list[Array] | None = None
) -> Point:
    """Return the equilibrium at which the path begins, under all loads if none is scaled.

    Relaxation is used if Newton's method fails or moves the mechanism too far; it appends positions
    to `approach`.
    """
    first, last = problem.system.ends
    with suppress(CurveError):
        x = problem.start(q)
        point = problem.correct(prescribe_parameter, first, x, first)
        if problem.measure(point.x - x) <= _MAX_INITIAL_MOTION:
            # A new point: after one correction, `point` keeps a tangent without multipliers.
            return problem.point(point.x, point.p, point.iterations)
    return _relax(problem, q, first if problem.system.has_scaled_loads else last, approach)


def _relax(problem: StaticProblem, q: Array, mu: float, passed: list[Array] | None = None) -> Point:
    q, _ = relax_to_equilibrium(problem.system.at_factor(mu), q, passed)
    point = problem.point_at(q, mu)
    # Rounding would move the mechanism along motions without stiffness.
    held = hold_neutral_motions(point).problem
    try:
        corrected = held.correct(prescribe_parameter, mu, point.x, mu)
    except CurveError:
        return point
    return problem.point(corrected.x, mu, corrected.iterations)


def follow_to_critical_point(begin: Point, targets: tuple[float, ...]) -> StagePath:
    """Return the path by arc length from `begin` to its first critical point.

    It has a point at each of the load factors `targets` before, ends at the last one if there is no
    critical point, and earlier with a status that is no success if it cannot be followed.
    """
    settings = PathSettings(targets=targets, control=ARC_LENGTH, max_points=_MAX_CHECK_POINTS)
    path = StagePath(begin.problem, [begin], settings)
    _follow(path, targets, _choose_steps(path), 1, (LIMIT, BRANCH, FLUTTER))
    return path


def _follow_stage(path: StagePath) -> None:
    """Extend the path of one stage to the targets; switch branches as the settings request."""
    begin, settings, targets = path.end, path.settings, list(path.settings.targets)
    if settings.column and (cause := describe_zero_loads(begin)):
        path.fail(cause)
        return
    if begin.monitor.free and not _leave_free_position(path, targets):
        return
    steps = _choose_steps(path)
    for number in settings.switch:
        count = _follow(path, targets, steps, abs(number))
        if path.status.success and count < abs(number):
            path.fail(
                f"switch={number} requests branch point {abs(number)}, but the number of "
                f"branch points found is {count}; use a smaller number or a farther target"
            )
        if not path.status.success:
            return
        # The tangent is not unique at the branch point, which several motions may have in common.
        before = next(point for point in reversed(path.points) if point is not path.end)
        chord, mode = path.end.minus(before), path.critical[len(path.points) - 1].mode
        try:
            first, path.tangent = switch(path.end, mode, chord, np.sign(number), steps)
        except CurveError as error:
            path.fail(error)
            return
        path.points.append(first)
    _follow(path, targets, steps)
    # At the begin of a path, and where a held motion becomes stiff, the mechanism may move far
    # under a small load, until it is stretched or rests.
    while path.is_stuck and path.by_load and len(path.points) < settings.max_points:
        if len(path.points) > 1 and not path.end.problem.held:
            return
        stuck, path.status, path.is_stuck = path.status, REACHED_END, False
        if not _begin_under_load(path, targets):
            path.status, path.is_stuck = stuck, True
            return
        _follow(path, targets, _choose_steps(path))


def _follow(
    path: StagePath,
    targets: Sequence[float],
    steps: Steps,
    stop: int = 0,
    kinds: tuple[str, ...] = (BRANCH,),
) -> int:
    """Extend the path to each target in turn; return the number of critical points of `kinds`.

    The path ends at the one with the number `stop`.
    """
    count, control = 0, path.control
    for target in targets:
        try:
            tangent = path.tangent
            if tangent is None and steps.by_arc_length and not path.by_load:
                tangent = path.end.tangent(prescribe_parameter)
            passed, recent = [*path.critical.values()], list[CurvePoint]()
            for segment, found in follow(path.end, control, target, steps, explain_counts, tangent):
                for one in found:
                    path.critical[len(path.points)] = one
                    path.points.append(one.point)
                    count += one.kind in kinds
                    if stop and count == stop:
                        return count
                    if steps.by_arc_length and _is_among(passed, one, steps):
                        path.fail(_CLOSED_PATH)
                        return count
                # Branch points in adjacent segments are different ones, at any distance.
                passed, recent = passed + recent, found
                path.points.append(segment.end)
                path.tangent = segment.direction
                is_reached = control(path.end.x, path.end.p).value == target
                if len(path.points) >= path.settings.max_points and not is_reached:
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


def _is_among(passed: Sequence[CurvePoint], last: CurvePoint, steps: Steps) -> bool:
    """Return True for a branch point that a path has passed before."""
    size, at = _SAME_POINT_RATIO * steps.largest, last.point
    return any(
        one.kind == last.kind == BRANCH
        and at.problem.measure(one.point.x - at.x) < size
        # Branch points of a straight column differ in their load factors only.
        and abs(one.point.p - at.p) * steps.parameter_weight < size
        for one in passed
    )


def _choose_steps(path: StagePath) -> Steps:
    """Return the steps of a stage, with default sizes where none are set."""
    begin, settings = path.end, path.settings
    row = path.control(begin.x, begin.p)
    origin = path.problem.system.ends[0] if path.by_load else row.value
    reach = max(*(abs(target - origin) for target in settings.targets), _MIN_REACH)
    ratio = _PARAMETER_STEP_RATIO if settings.varies else _LOAD_STEP_RATIO
    load_step = ratio * (reach if path.by_load else 1.0)
    if settings.control != ARC_LENGTH:
        default = load_step if path.by_load else _DISPLACEMENT_STEP_RATIO * reach
        return Steps(settings.step or default)
    step = _ARC_STEP
    if not path.by_load:
        # Largest change of the column if all coordinates move by their natural sizes.
        is_coordinate = (weights := begin.problem.weights) > 0.0
        changes = np.abs(row.gradient[:-1][is_coordinate]) / weights[is_coordinate]
        step = min(step, _MAX_SHARE_OF_NEEDED_MOTION * reach / max(np.sum(changes), _MIN_REACH))
    motion = 0.0
    with suppress(CurveError):
        motion = begin.problem.measure(begin.tangent(prescribe_parameter)[:-1])
    # A load is weighted no less than the motion that it causes, so that crossing paths differ in
    # direction.
    weight = max(motion, _MIN_LOAD_STEP_MOTION / load_step)
    step = settings.step or float(step)
    if path.by_load:
        return Steps(step, True, weight, load_step)
    # The load that a displacement requires is not known in advance.
    return Steps(step, True, weight, first=min(1.0, weight * load_step / step))


def _leave_free_position(path: StagePath, targets: Sequence[float]) -> bool:
    """Begin a path where a motion has no stiffness; return True if it can be followed.

    If a small load makes the motion stiff, and the tangent there leads back, the path is followed
    from its first point. If loads do no work in the motion, it is held. Otherwise, the mechanism
    moves far under the load, and the path begins at the first load step.
    """
    begin, problem = path.end, path.problem
    reach = float(np.clip(targets[0] - begin.p, -1.0, 1.0)) if path.by_load else 1.0
    held_begin = hold_neutral_motions(begin)
    for start, share in ((begin, _FIRST_LOADS[-1]), *((held_begin, x) for x in _FIRST_LOADS)):
        mu = begin.p + share * _LOAD_STEP_RATIO * reach
        with suppress(CurveError):
            loaded = start.problem.correct(prescribe_parameter, mu, begin.x, mu)
            if problem.measure(loaded.x - begin.x) > _MAX_INITIAL_MOTION:
                continue
            if start is begin and not loaded.monitor.free:
                tangent = loaded.tangent(prescribe_parameter)
                missed = loaded.minus(begin) - (mu - begin.p) * tangent
                if problem.measure(missed[:-1]) > ROUNDING:
                    continue
                path.tangent = tangent * (float(np.sign(reach)) or 1.0)
                return True
            held = hold_neutral_motions(problem.point(loaded.x, mu)).problem
            first = held.point(begin.x, begin.p)
            if start is not begin and are_neutral(loaded) and not first.monitor.free:
                path.points[-1] = first
                return True
    return _begin_under_load(path, targets)


def _begin_under_load(path: StagePath, targets: Sequence[float]) -> bool:
    """Begin a path at the first load step, found by relaxation; return True if it can be followed.

    The position without load is arbitrary if it has a motion without stiffness; the path then
    begins under load.
    """
    begin, problem = path.end, path.problem
    is_arbitrary = bool(begin.monitor.free)
    reach = targets[0] - begin.p if path.by_load else 1.0
    # Steps of equal length reach the target.
    step = _LOAD_STEP_RATIO * (abs(targets[0] - problem.system.ends[0]) if path.by_load else 1.0)
    mu = begin.p + float(np.clip(reach, -step, step))
    try:
        point = hold_neutral_motions(_relax(problem, begin.x[: problem.n], mu))
    except BeamdaeError as error:
        path.fail(error)
        return False
    if is_arbitrary:
        path.points.pop()
    path.points.append(point)
    return True


def free_coordinate(point: Point) -> str:
    """Return the name of the coordinate that holds a motion without stiffness, or ""."""
    problem = point.problem
    held = problem.held or hold_neutral_motions(point).problem.held
    return problem.system.equations.q_names[min(held)] if held else ""


def dominant_coordinate(e: EquationsOfMotion, mode: Array) -> str:
    """Return the name of the coordinate that moves most in a mode, relative to its natural size."""
    return e.q_names[locate_largest(mode[: e.n] / e.position_scales * prefer_angles(e))]
