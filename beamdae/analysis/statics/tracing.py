"""The path of a loading, stage by stage: where it begins, how it is followed, why it ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from beamdae.analysis.statics.continuation import Stepping, follow, switched
from beamdae.analysis.statics.corrector import Corrector, Point, StepError
from beamdae.analysis.statics.load_scaling import LoadedEquations, Loading
from beamdae.analysis.statics.path_controls import ColumnControl, Control, LoadControl, Norm, Way
from beamdae.analysis.statics.path_points import Path
from beamdae.analysis.statics.targets import ARC, DISPLACEMENT, LOAD, Asked
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.relaxation import relaxed
from beamdae.errors import BeamdaeError
from beamdae.results.equilibrium import CriticalPoint
from beamdae.results.outcome import Status

Array = np.ndarray

# Steps to the farthest target; by arc length in natural sizes, and of what has to move at least.
_OF_LOAD, _OF_DISPLACEMENT, _OF_ARC, _OF_LEAST = 0.1, 0.05, 0.05, 0.25
# What a tenth of the load moves, if it moves less: by arc length it counts for that.
_MOVED = 1e-3
# A way to a target is as long at least, of the factor or the column.
_LEAST_REACH = 1e-12
# What Newton's method may move to close joints and to balance what is not scaled.
_NEAR = 0.05
# What is left of the softest motion before a limit load.
_SOFT = 0.2
# Coordinates whose motions differ by less move alike.
_ALIKE = 1e-6


class Traced(NamedTuple):
    """A path of all stages.

    Attributes
    ----------
    points, factors
        The points, and the load factors of all stages at each.
    critical
        With rows of the whole path.
    iterations
        Of Newton's method, with those that led nowhere.
    """

    points: list[Point]
    factors: Array
    critical: tuple[CriticalPoint, ...]
    status: Status
    iterations: int


def traced(loading: Loading, q: Array, asked: Asked) -> Traced:
    """The path from the unloaded mechanism, near to positions `q`, to what was asked for.

    Raises
    ------
    BeamdaeError
        If nothing comes to rest without the load.
    """
    if not loading.stages and asked.column:
        raise BeamdaeError(
            f"equilibrium: there is no load to bring {asked.column} to a value by; add one."
        )
    points: list[Point] = []
    factors: list[Array] = []
    critical: list[CriticalPoint] = []
    aim = _aim(loading, asked)
    status, iterations = Status("ok", "reached the end"), 0
    for k, system in enumerate(loading.systems):
        last = k == len(loading.systems) - 1
        corrector = Corrector(system)
        begin = _unloaded(corrector, q) if k == 0 else Point(system, points[-1].x, 0.0)
        path = Path([begin])
        if system.is_scaled:
            _follow(
                corrector, path, asked if last else asked.of_stage(), aim if last else LoadControl()
            )
        # A stage begins where the one before it ended.
        first = len(points) - (k > 0)
        del points[first:], factors[first:]
        points += path.points
        row = np.where(np.arange(len(loading.stages)) < k, 1.0, 0.0)
        for point in path.points:
            factors.append(row.copy())
            factors[-1][k : k + 1] = point.mu
        critical += [
            CriticalPoint(
                one.kind,
                first + one.place,
                path.points[one.place].mu,
                _moves(system.equations, path.points[one.place], one.index),
            )
            for one in path.critical
        ]
        iterations += corrector.iterations
        status = _told(path, system, asked if last else None)
        if not status.success:
            break
    told = np.array(factors).reshape(len(points), len(loading.stages))
    return Traced(points, told, tuple(critical), status, iterations)


def _aim(loading: Loading, asked: Asked) -> Control:
    if not asked.column:
        return LoadControl()
    return ColumnControl.of(loading.whole, asked.column, loading.systems[0].under.time)


def _unloaded(corrector: Corrector, q: Array) -> Point:
    """Equilibrium without the load: near to where it is drawn, or else by relaxation."""
    system = corrector.system
    x = np.append(q, np.zeros(system.equations.m))
    try:
        found = corrector.corrected(LoadControl(), 0.0, x, 0.0)
        if corrector.travel.farthest((found.x - x)[: len(q)]) <= _NEAR:
            return found
    except StepError:
        pass
    return _relaxed(corrector, q, 0.0 if system.is_scaled else 1.0)


def _relaxed(corrector: Corrector, q: Array, mu: float) -> Point:
    found = np.concatenate(relaxed(corrector.system.at(mu), q))
    return Point(corrector.system, found, mu)


def _follow(corrector: Corrector, path: Path, asked: Asked, aim: Control) -> None:
    """Follow the path of one stage, and go over to another where that is asked for."""
    begin, targets = path.end, list(asked.targets)
    stepping = _stepping(corrector, begin, asked, aim)
    if asked.column and not np.any(corrector.system.residual(begin.x, begin.mu)[1]):
        t = corrector.system.under.time[0]
        path.status = Status("failed", f"the loads that are scaled are zero at t = {t:g} s")
        return
    if begin.stability.free:
        _released(corrector, path, stepping, targets)
        return
    way = None
    try:
        for switch in asked.switch:
            if not _left(corrector, path, replace(stepping, leave_at=abs(switch)), targets, way):
                return
            way = switched(corrector, path, stepping, np.sign(switch))
    except StepError as problem:
        path.status = Status("failed", str(problem))
        return
    follow(corrector, path, stepping, targets, way)


def _left(
    corrector: Corrector,
    path: Path,
    stepping: Stepping,
    targets: Sequence[float],
    way: Way | None,
) -> bool:
    """Follow a path up to the branch point at which it is left, if there is one."""
    before = len(path.branches)
    follow(corrector, path, stepping, targets, way)
    count = len(path.branches) - before
    if path.status.success and count < stepping.leave_at:
        told = f"there is no branch point {stepping.leave_at} on the way, of {count}"
        path.status = Status("failed", told)
    return path.status.success


def _stepping(corrector: Corrector, begin: Point, asked: Asked, aim: Control) -> Stepping:
    """How far steps go."""
    scale = corrector.system.equations.position_scales
    reach = max(abs(target - aim.value(begin.x, begin.mu)) for target in asked.targets)
    reach = max(reach, _LEAST_REACH)
    by_load = isinstance(aim, LoadControl)
    load = _OF_LOAD * (reach if by_load else 1.0)
    if asked.control != ARC:
        step = asked.step or (load if by_load else _OF_DISPLACEMENT * reach)
        load = step if by_load else load
        return Stepping(aim, False, step, load, Norm(scale, np.inf), asked.most)
    step = _OF_ARC
    if not by_load:
        # What has to move at least for the column to get there.
        row = np.abs(aim.row(begin.x, begin.mu)[0][: len(scale)]) @ scale
        step = min(step, _OF_LEAST * reach / max(row, _LEAST_REACH))
    way = corrector.direction(begin, LoadControl())
    moved = 0.0 if way is None else Norm(scale, np.inf).largest(way.x)
    # Where paths cross they do so at an angle if a load counts no more than what it moves.
    norm = Norm(scale, 1.0 / max(moved, _MOVED / load))
    return Stepping(aim, True, asked.step or step, load, norm, asked.most)


def _released(
    corrector: Corrector, path: Path, stepping: Stepping, targets: Sequence[float]
) -> None:
    """Follow the path of a mechanism that is free to move without the load: relax it under some."""
    e, begin = corrector.system.equations, path.end
    if not isinstance(stepping.aim, LoadControl):
        path.status = Status(
            "failed",
            f"{_free(e, begin)} is free to move without stiffness where nothing is loaded, no path "
            "leads away from there; name in loads= what moves it, or give to= a load factor",
        )
        return
    try:
        for k, target in enumerate(targets):
            first = path.end.mu + np.sign(target - path.end.mu) * min(
                stepping.load, abs(target - path.end.mu)
            )
            near = _relaxed(corrector, path.end.x[: e.n], float(first))
            if not near.stability.free:
                # It rests anywhere without the load: no path leads from there to here.
                path.points[-1] = near
                follow(corrector, path, stepping, targets[k:])
                return
            path.points.append(_relaxed(corrector, path.end.x[: e.n], target))
    except BeamdaeError as problem:
        path.status = Status("failed", str(problem).rstrip("."))


def _free(e: EquationsOfMotion, at: Point) -> str:
    """The coordinate that moves most without stiffness."""
    values = at.stability.values
    return _most(e, at.stability.modes[:, int(np.argmin(np.abs(values)))])


def _most(e: EquationsOfMotion, mode: Array) -> str:
    moved = np.abs(mode / e.position_scales)
    alike = np.flatnonzero(moved >= (1.0 - _ALIKE) * np.max(moved)).tolist()
    # Of those that move alike but for rounding an angle tells more than what it carries along.
    return e.q_names[min(alike, key=lambda k: (e.coordinates[k].unit != "rad", k))]


def _moves(e: EquationsOfMotion, at: Point, index: int) -> str:
    return _most(e, at.stability.mode(index)) if len(at.stability.values) else ""


def free_motion(e: EquationsOfMotion, at: Point) -> str:
    """The coordinate that moves most in a motion that nothing resists, or nothing."""
    return _free(e, at) if at.stability.free else ""


def _told(path: Path, system: LoadedEquations, asked: Asked | None) -> Status:
    """Why the path ended, with the last factor that converged."""
    if path.status.success:
        return path.status
    end, told = path.end, path.status.sentence
    sentence = f"{told}; the last load factor that converged is {end.mu:.6g}"
    if path.stuck:
        control = LOAD if asked is None else asked.control
        sentence += _hint(path, system.equations, control)
    return Status(path.status.kind, sentence)


def _hint(path: Path, e: EquationsOfMotion, control: str) -> str:
    """What may help, the end of a sentence."""
    if control == DISPLACEMENT and len(path.points) == 1:
        return ", as where the loads do not move what they should"
    if control == DISPLACEMENT:
        return ", control='arc length' goes on where a displacement turns back"
    if control != LOAD:
        return ""
    if len(path.points) == 1:
        return ", a millionth of a step is too much: the loads may be larger than meant"
    end = path.end
    before, now = (_softest(point) for point in (path.points[0], end))
    if not 0.0 < now < _SOFT * before:
        return ", control='arc length' goes on where a load can rise no more"
    coordinate = _most(e, end.stability.mode(end.stability.negative))
    return (
        f", where {coordinate} has lost {1.0 - now / before:.0%} of the stiffness against it, as "
        "before a limit load: control='arc length' goes on"
    )


def _softest(at: Point) -> float:
    """The least eigenvalue that is positive."""
    positive = at.stability.values[at.stability.values > 0.0]
    return float(positive[0]) if len(positive) else 0.0
