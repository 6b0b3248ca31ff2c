"""The path of a loading, stage by stage: where it begins, how it is followed, why it ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.statics.continuation import ContinuationSettings, follow_path, switch_branch
from beamdae.analysis.statics.corrector import Corrector, CorrectorError, EquilibriumPoint
from beamdae.analysis.statics.critical_points import Path
from beamdae.analysis.statics.load_scaling import LoadedEquations, Loading
from beamdae.analysis.statics.path_controls import (
    ColumnControl,
    Control,
    LoadControl,
    PathDirection,
    StepNorm,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.relaxation import relax_to_equilibrium
from beamdae.errors import (
    BeamdaeError,
    as_real,
    require_choice,
    require_count,
    require_finite,
    require_positive,
    require_sequence,
    short_repr,
)
from beamdae.results.equilibrium import CriticalPoint
from beamdae.results.outcome import Status

LOAD, DISPLACEMENT, ARC = "load", "displacement", "arc length"


@dataclass(frozen=True)
class PathSettings:
    """What was asked for, checked.

    Attributes
    ----------
    column
        The observed column that `targets` are values of; "": the load factor.
    targets, control, step, switch, most
        See `equilibrium`.
    """

    column: str
    targets: tuple[float, ...]
    control: str
    step: float | None
    switch: tuple[int, ...]
    most: int

    @classmethod
    def of(cls, to: Any, control: Any, step: Any, switch: Any, most: Any) -> PathSettings:
        """Checked settings.

        Raises
        ------
        BeamdaeError
            Naming the setting that is wrong.
        """
        name, column, values = "equilibrium", "", to
        if isinstance(to, Mapping):
            if len(to) != 1 or not isinstance(next(iter(to)), str):
                raise BeamdaeError(
                    "equilibrium: to must be a load factor, several, or one observed position with "
                    f"its value such as {{'tip.y': -0.1}}, got {short_repr(to)}."
                )
            ((column, values),) = to.items()
        listed = (
            [values]
            if as_real(values) is not None
            else require_sequence(name, "to", values, "numbers")
        )
        targets = tuple(require_finite(name, "to", value) for value in listed)
        if not targets:
            raise BeamdaeError("equilibrium: to must hold at least one number.")
        switch = _parse_switches(switch)
        if control is None:
            control = ARC if switch else DISPLACEMENT if column else LOAD
        require_choice(name, "control", control, (LOAD, DISPLACEMENT, ARC))
        fits = {LOAD: not column and not switch, DISPLACEMENT: bool(column) and not switch}
        if not fits.get(control, True):
            instead = "'arc length'" if switch else "'displacement'" if column else "'load'"
            raise BeamdaeError(
                f"equilibrium: control={control!r} does not go with these to and switch, take "
                f"control={instead}."
            )
        size = None if step is None else require_positive(name, "step", step)
        return cls(
            column, targets, control, size, switch, require_count(name, "most_points", most, 2)
        )

    @property
    def told(self) -> dict[str, Any]:
        """As plain values."""
        to = list(self.targets)
        told = {"to": {self.column: to} if self.column else to, "control": self.control}
        return {**told, "step": self.step, "switch": list(self.switch)}

    def of_stage(self) -> PathSettings:
        """What is asked for of a stage before the last: all of its load."""
        return PathSettings("", (1.0,), LOAD, None, (), self.most)


def _parse_switches(switch: Any) -> tuple[int, ...]:
    """Branch points to leave at, one after the other; none where that is 0."""
    what = "a whole number or several"
    listed = (
        [switch]
        if as_real(switch) is not None
        else require_sequence("equilibrium", "switch", switch, what)
    )
    sides = [require_finite("equilibrium", "switch", side) for side in listed]
    if sides == [0.0]:
        return ()
    found = [require_count("equilibrium", "switch", abs(side), 1) for side in sides]
    return tuple(k if side > 0.0 else -k for k, side in zip(found, sides, strict=True))


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


class EquilibriumPath(NamedTuple):
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

    points: list[EquilibriumPoint]
    factors: Array
    critical: tuple[CriticalPoint, ...]
    status: Status
    iterations: int


def trace_path(loading: Loading, q: Array, asked: PathSettings) -> EquilibriumPath:
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
    points: list[EquilibriumPoint] = []
    factors: list[Array] = []
    critical: list[CriticalPoint] = []
    aim = _target_control(loading, asked)
    status, iterations = Status("ok", "reached the end"), 0
    for k, system in enumerate(loading.systems):
        last = k == len(loading.systems) - 1
        corrector = Corrector(system)
        begin = (
            _find_unloaded_equilibrium(corrector, q)
            if k == 0
            else EquilibriumPoint(system, points[-1].x, 0.0)
        )
        path = Path([begin])
        if system.is_scaled:
            _follow_stage(
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
                _mode_coordinate(system.equations, path.points[one.place], one.index),
            )
            for one in path.critical
        ]
        iterations += corrector.iterations
        status = _end_status(path, system, asked if last else None)
        if not status.success:
            break
    told = np.array(factors).reshape(len(points), len(loading.stages))
    return EquilibriumPath(points, told, tuple(critical), status, iterations)


def _target_control(loading: Loading, asked: PathSettings) -> Control:
    if not asked.column:
        return LoadControl()
    return ColumnControl.of(loading.whole, asked.column, loading.systems[0].under.time)


def _find_unloaded_equilibrium(corrector: Corrector, q: Array) -> EquilibriumPoint:
    """Equilibrium without the load: near to where it is drawn, or else by relaxation."""
    system = corrector.system
    x = np.append(q, np.zeros(system.equations.m))
    try:
        found = corrector.corrected(LoadControl(), 0.0, x, 0.0)
        if corrector.travel.farthest((found.x - x)[: len(q)]) <= _NEAR:
            return found
    except CorrectorError:
        pass
    return _relax(corrector, q, 0.0 if system.is_scaled else 1.0)


def _relax(corrector: Corrector, q: Array, mu: float) -> EquilibriumPoint:
    found = np.concatenate(relax_to_equilibrium(corrector.system.at(mu), q))
    return EquilibriumPoint(corrector.system, found, mu)


def _follow_stage(corrector: Corrector, path: Path, asked: PathSettings, aim: Control) -> None:
    """Follow the path of one stage, and go over to another where that is asked for."""
    begin, targets = path.end, list(asked.targets)
    stepping = _choose_steps(corrector, begin, asked, aim)
    if asked.column and not np.any(corrector.system.residual(begin.x, begin.mu)[1]):
        t = corrector.system.under.time[0]
        path.status = Status("failed", f"the loads that are scaled are zero at t = {t:g} s")
        return
    if begin.stability.free:
        _follow_from_mechanism(corrector, path, stepping, targets)
        return
    way = None
    try:
        for switch in asked.switch:
            if not _follow_to_branch_point(
                corrector, path, replace(stepping, leave_at=abs(switch)), targets, way
            ):
                return
            way = switch_branch(corrector, path, stepping, np.sign(switch))
    except CorrectorError as problem:
        path.status = Status("failed", str(problem))
        return
    follow_path(corrector, path, stepping, targets, way)


def _follow_to_branch_point(
    corrector: Corrector,
    path: Path,
    stepping: ContinuationSettings,
    targets: Sequence[float],
    way: PathDirection | None,
) -> bool:
    """Follow a path up to the branch point at which it is left, if there is one."""
    before = len(path.branches)
    follow_path(corrector, path, stepping, targets, way)
    count = len(path.branches) - before
    if path.status.success and count < stepping.leave_at:
        told = f"there is no branch point {stepping.leave_at} on the way, of {count}"
        path.status = Status("failed", told)
    return path.status.success


def _choose_steps(
    corrector: Corrector, begin: EquilibriumPoint, asked: PathSettings, aim: Control
) -> ContinuationSettings:
    """How far steps go."""
    scale = corrector.system.equations.position_scales
    reach = max(abs(target - aim.value(begin.x, begin.mu)) for target in asked.targets)
    reach = max(reach, _LEAST_REACH)
    by_load = isinstance(aim, LoadControl)
    load = _OF_LOAD * (reach if by_load else 1.0)
    if asked.control != ARC:
        step = asked.step or (load if by_load else _OF_DISPLACEMENT * reach)
        load = step if by_load else load
        return ContinuationSettings(aim, False, step, load, StepNorm(scale, np.inf), asked.most)
    step = _OF_ARC
    if not by_load:
        # What has to move at least for the column to get there.
        row = np.abs(aim.row(begin.x, begin.mu)[0][: len(scale)]) @ scale
        step = min(step, _OF_LEAST * reach / max(row, _LEAST_REACH))
    way = corrector.direction(begin, LoadControl())
    moved = 0.0 if way is None else StepNorm(scale, np.inf).largest(way.x)
    # Where paths cross they do so at an angle if a load counts no more than what it moves.
    norm = StepNorm(scale, 1.0 / max(moved, _MOVED / load))
    return ContinuationSettings(aim, True, asked.step or step, load, norm, asked.most)


def _follow_from_mechanism(
    corrector: Corrector, path: Path, stepping: ContinuationSettings, targets: Sequence[float]
) -> None:
    """Follow the path of a mechanism that is free to move without the load: relax it under some."""
    e, begin = corrector.system.equations, path.end
    if not isinstance(stepping.aim, LoadControl):
        path.status = Status(
            "failed",
            f"{_freest_coordinate(e, begin)} is free to move without stiffness where nothing is loaded, no path "
            "leads away from there; name in loads= what moves it, or give to= a load factor",
        )
        return
    try:
        for k, target in enumerate(targets):
            first = path.end.mu + np.sign(target - path.end.mu) * min(
                stepping.load, abs(target - path.end.mu)
            )
            near = _relax(corrector, path.end.x[: e.n], float(first))
            if not near.stability.free:
                # It rests anywhere without the load: no path leads from there to here.
                path.points[-1] = near
                follow_path(corrector, path, stepping, targets[k:])
                return
            path.points.append(_relax(corrector, path.end.x[: e.n], target))
    except BeamdaeError as problem:
        path.status = Status("failed", str(problem).rstrip("."))


def _freest_coordinate(e: EquationsOfMotion, at: EquilibriumPoint) -> str:
    """The coordinate that moves most without stiffness."""
    values = at.stability.values
    return _dominant_coordinate(e, at.stability.modes[:, int(np.argmin(np.abs(values)))])


def _dominant_coordinate(e: EquationsOfMotion, mode: Array) -> str:
    moved = np.abs(mode / e.position_scales)
    alike = np.flatnonzero(moved >= (1.0 - _ALIKE) * np.max(moved)).tolist()
    # Of those that move alike but for rounding an angle tells more than what it carries along.
    return e.q_names[min(alike, key=lambda k: (e.coordinates[k].unit != "rad", k))]


def _mode_coordinate(e: EquationsOfMotion, at: EquilibriumPoint, index: int) -> str:
    return _dominant_coordinate(e, at.stability.mode(index)) if len(at.stability.values) else ""


def free_coordinate(e: EquationsOfMotion, at: EquilibriumPoint) -> str:
    """The coordinate that moves most in a motion that nothing resists, or nothing."""
    return _freest_coordinate(e, at) if at.stability.free else ""


def _end_status(path: Path, system: LoadedEquations, asked: PathSettings | None) -> Status:
    """Why the path ended, with the last factor that converged."""
    if path.status.success:
        return path.status
    end, told = path.end, path.status.sentence
    sentence = f"{told}; the last load factor that converged is {end.mu:.6g}"
    if path.stuck:
        control = LOAD if asked is None else asked.control
        sentence += _remedy(path, system.equations, control)
    return Status(path.status.kind, sentence)


def _remedy(path: Path, e: EquationsOfMotion, control: str) -> str:
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
    before, now = (_lowest_positive_stiffness(point) for point in (path.points[0], end))
    if not 0.0 < now < _SOFT * before:
        return ", control='arc length' goes on where a load can rise no more"
    coordinate = _dominant_coordinate(e, end.stability.mode(end.stability.negative))
    return (
        f", where {coordinate} has lost {1.0 - now / before:.0%} of the stiffness against it, as "
        "before a limit load: control='arc length' goes on"
    )


def _lowest_positive_stiffness(at: EquilibriumPoint) -> float:
    """The least eigenvalue that is positive."""
    positive = at.stability.values[at.stability.values > 0.0]
    return float(positive[0]) if len(positive) else 0.0
