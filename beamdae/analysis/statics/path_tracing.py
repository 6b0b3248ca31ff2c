"""Equilibrium path through all load stages: settings, start, continuation and diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.statics.continuation import (
    ContinuationSettings,
    StagePath,
    follow_path,
    switch_branch,
)
from beamdae.analysis.statics.corrector import Corrector, CorrectorError, EquilibriumPoint
from beamdae.analysis.statics.critical_points import FLUTTER, LIMIT
from beamdae.analysis.statics.load_scaling import LoadedEquations, Loading
from beamdae.analysis.statics.neutral_motions import hold_neutral_motions
from beamdae.analysis.statics.newton_loop import MAX_CORRECTION_RATIO, MIN_STEP_RATIO
from beamdae.analysis.statics.path_controls import (
    Control,
    DisplacementControl,
    LoadControl,
    PathDirection,
    StepNorm,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.relaxation import relax_to_equilibrium
from beamdae.errors import (
    BeamdaeError,
    as_real,
    list_first,
    require_choice,
    require_count,
    require_finite,
    require_mapping,
    require_positive,
    require_sequence,
    short_repr,
)
from beamdae.interrupts import acknowledge
from beamdae.parts.joints.drivers import DrivenJoint
from beamdae.results.equilibrium import CriticalPoint
from beamdae.results.outcome import REACHED_END, Status

Array = np.ndarray

LOAD, DISPLACEMENT, ARC_LENGTH = "load", "displacement", "arc length"

# Default steps by load and by displacement, relative to the distance to the farthest target.
_LOAD_STEP_RATIO = 0.1
_DISPLACEMENT_STEP_RATIO = 0.05
# The same for a quantity that varies in place of a load factor, whose path is a curve to plot.
_PARAMETER_STEP_RATIO = 0.02
# Default step by arc length, in natural sizes. If a column is the target, the step is also limited
# to this fraction of the motion needed to reach it.
_ARC_STEP = 0.05
_MAX_SHARE_OF_NEEDED_MOTION = 0.25
# Lower bound, in natural sizes, of the motion that the arc-length norm attributes to a load step.
_MIN_LOAD_STEP_MOTION = 1e-3
# Lower bound of the distance to a target, in load factor or in the unit of the column.
_MIN_REACH = 1e-12
# Largest accepted motion, in natural sizes, to an equilibrium found by Newton's method; beyond it,
# relaxation is used.
_MAX_INITIAL_MOTION = 0.05
# The end of a failed path is probably near a limit point if the lowest positive eigenvalue of the
# stiffness has fallen below this fraction of its initial value.
_SOFT_RATIO = 0.2
# Paths with a larger bound on rounding errors have a note. It is up to 1e-4 at L/h = 1e5, and 2e-4
# to 2e-1 at 1e6, where errors of critical loads are up to 5e-5 and 1e-2 (measured).
_MAX_ROUNDING_RATIO = 2e-4
# Errors of critical loads may exceed the bound at the beginning of the path by this factor, because
# positions change along the path: up to 2.4 for arches at L/h = 1e6 (measured).
_ROUNDING_MARGIN = 4.0
# Rounding may be the cause if no step converges and the bound exceeds the first ratio, or also the
# second one at the end of a longer path. The path of a portal frame at L/h = 1e5 begins at 1.6e-4
# and ends at 4e-3 (measured).
_MIN_STUCK_ROUNDING_RATIO = 2e-5
_MIN_END_ROUNDING_RATIO = 1e-3
# Critical points in a smaller range of load factors, relative to them, are not uncertain.
_SAME_LOAD_RATIO = 1e-6
# Under forces without a potential, smaller damping ratios have a note: rounding changes flutter
# loads by up to 3e-4 at 1e-11, and 7e-4 at 1e-10 if the beam is thin (measured).
_MIN_DAMPING_RATIO = 1e-9
# A load step is checked if it moves the structure, per load, this many times as far as the next
# one; the last step, as the one before.
_JUMP_RATE_RATIO = 2.0
# A single load step is divided and checked if it moves the structure this many times as far as its
# tangent at the end predicts: up to 1.5 without a jump (measured), from 1.8 with one.
_SINGLE_STEP_RATE_RATIO = 1.4
# Targets farther away than this multiple of the size of the mechanism are named if steps fail.
_FAR_TARGET_RATIO = 3.0
_MAX_CHECK_POINTS = 100
# A single load step and ten that lead to the same point differ by less than this fraction of the
# motion.
_SAME_END_RATIO = 1e-4
# Relative difference up to which two coordinates of a mode have equal amplitudes.
_EQUAL_MOTION_TOLERANCE = 1e-6
_MAX_DRIVERS = 3  # in a message


@dataclass(frozen=True)
class PathSettings:
    """Settings of an equilibrium path: validated arguments of `equilibrium`.

    Attributes
    ----------
    column
        Name of the observed column to which `targets` refer; "" if they are load factors.
    varies
        Quantity that varies in place of a load factor, as the user named it; "" if there is none.
    targets, control, step, switch, max_points
        See `to`, `control`, `step`, `switch` and `max_points` of `equilibrium`.
    """

    column: str
    targets: tuple[float, ...]
    control: str
    step: float | None
    switch: tuple[int, ...]
    max_points: int
    varies: str = ""

    @classmethod
    def from_arguments(
        cls, to: Any, control: Any, step: Any, switch: Any, max_points: Any, over: Any = None
    ) -> PathSettings:
        """Validate arguments of `equilibrium` and return them as settings.

        Raises
        ------
        BeamdaeError
            If an argument is invalid; the message names it.
        """
        name, column, values = "equilibrium", "", 1.0 if to is None and over is None else to
        if over is not None and (to is None or isinstance(to, Mapping)):
            raise BeamdaeError(
                f"equilibrium: to must be the last value of {short_repr(over)}, or a list of "
                f"values, got {short_repr(to)}; pass a number."
            )
        if over is not None and not isinstance(over, str):
            raise BeamdaeError(
                "equilibrium: over must be 't' or the name of a driver, an input or a parameter, "
                f"got {short_repr(over)}; pass a name."
            )
        if isinstance(to, Mapping):
            what = (
                "a load factor, a list of load factors, or one observed position with a value "
                "such as {'tip.y': -0.1}"
            )
            positions = require_mapping(name, "to", to, what)
            if len(positions) != 1:
                raise BeamdaeError(f"equilibrium: to must be {what}, got {short_repr(to)}.")
            ((column, values),) = positions.items()
        is_number = as_real(values) is not None
        items = [values] if is_number else require_sequence(name, "to", values, "numbers")
        targets = tuple(require_finite(name, "to", value) for value in items)
        if not targets:
            raise BeamdaeError("equilibrium: to must contain at least one number.")
        switch = _parse_switches(switch)
        if control is None:
            control = ARC_LENGTH if switch else DISPLACEMENT if column else LOAD
        require_choice(name, "control", control, (LOAD, DISPLACEMENT, ARC_LENGTH))
        if over is not None and control == DISPLACEMENT:
            raise BeamdaeError(
                f"equilibrium: control={control!r} is not supported with over=; omit it to "
                f"prescribe {over!r}, or use control={ARC_LENGTH!r}."
            )
        is_possible = {
            LOAD: not column and not switch,
            DISPLACEMENT: bool(column) and not switch,
            ARC_LENGTH: True,
        }
        if not is_possible[control]:
            alternative = ARC_LENGTH if switch else DISPLACEMENT if column else LOAD
            raise BeamdaeError(
                f"equilibrium: control={control!r} is not supported with the given to= "
                f"and switch=; use control={alternative!r}."
            )
        size = None if step is None else require_positive(name, "step", step)
        max_points = require_count(name, "max_points", max_points, 2)
        return cls(column, targets, control, size, switch, max_points, over or "")

    @property
    def description(self) -> dict[str, Any]:
        """Settings as plain values for `Equilibrium.settings`."""
        to = list(self.targets)
        return {
            **({"over": self.varies} if self.varies else {}),
            "to": {self.column: to} if self.column else to,
            "control": self.control,
            "step": self.step,
            "switch": list(self.switch),
        }

    def for_earlier_stage(self) -> PathSettings:
        """Return the settings for stages before the last: load control up to the full load."""
        return PathSettings("", (1.0,), LOAD, None, (), self.max_points)


def _parse_switches(switch: Any) -> tuple[int, ...]:
    """Return the signed numbers of the branch points at which to switch; empty for 0."""
    expected = "a whole number or a list of whole numbers"
    is_number = as_real(switch) is not None
    items = [switch] if is_number else require_sequence("equilibrium", "switch", switch, expected)
    numbers = [require_finite("equilibrium", "switch", number) for number in items]
    if numbers == [0.0]:
        return ()
    counts = [require_count("equilibrium", "switch", abs(number), 1) for number in numbers]
    return tuple(k if number > 0.0 else -k for k, number in zip(counts, numbers, strict=True))


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
        Number of Newton iterations, including those of failed steps but not of relaxation.
    notes
        Remarks on stages in which rounding errors of critical loads are not negligible.
    approach
        Positions (n,) through which drivers are led from the drawing to the first point.
    """

    points: list[EquilibriumPoint]
    factors: Array
    critical: tuple[CriticalPoint, ...]
    status: Status
    iterations: int
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
    varies = loading.parameter is not None
    if not loading.stages and settings.column:
        cause = f"equilibrium: {settings.column} cannot be prescribed because no load is scaled"
        drivers = _list_drivers(loading.full_equations)
        if drivers:
            raise BeamdaeError(
                f"{cause}, and {list_first(drivers, _MAX_DRIVERS)} moves the mechanism; set t= to "
                "the time of the wanted position and omit to=, or replace the driver by a load."
            )
        raise BeamdaeError(f"{cause}; add a load to the mechanism and to loads=.")
    points: list[EquilibriumPoint] = []
    factors: list[Array] = []
    critical: list[CriticalPoint] = []
    notes: list[str] = []
    approach: list[Array] = []
    last_control: Control = LoadControl()
    if settings.column:
        time = loading.systems[0].loaded.time
        last_control = DisplacementControl.from_name(loading.full_equations, settings.column, time)
    status, iterations = Status("ok", "reached the end"), 0
    for k, system in enumerate(loading.systems):
        is_last = k == len(loading.systems) - 1
        corrector = Corrector(system)
        begin = (
            find_unloaded_equilibrium(corrector, q, approach)
            if k == 0
            else EquilibriumPoint(system, points[-1].x, system.ends[0])
        )
        if begin.free_count and system.has_scaled_loads:
            system = hold_neutral_motions(system, begin.x)
            corrector = Corrector(system)
            begin = replace(begin, system=system, load_direction=None)
        path, jump_notes = StagePath([begin]), []
        control = settings.control if is_last else LOAD
        try:
            if system.has_scaled_loads and is_last:
                _follow_stage(corrector, path, settings, last_control)
            elif system.has_scaled_loads:
                _follow_stage(corrector, path, settings.for_earlier_stage(), LoadControl())
            if system.has_scaled_loads and control == LOAD and not (is_last and settings.column):
                jump_notes = _jump_notes(corrector, path, loading.quantity)
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
            factors[-1][k : k + 1] = point.mu
        for one in path.critical:
            coordinate = dominant_coordinate(system.equations, one.mode)
            factor = path.points[one.row].mu
            critical.append(CriticalPoint(one.kind, first + one.row, factor, coordinate))
        if system.has_scaled_loads:
            notes += _zero_load_notes(path, loading) + _unknown_notes(path) + _rounding_notes(path)
            notes += _damping_notes(path)
            notes += _range_notes(path, loading.quantity) + jump_notes
        iterations += corrector.iterations
        status = _end_status(path, system, control, loading.quantity)
        if not status.success and path.is_stuck and isinstance(last_control, DisplacementControl):
            far = _describe_far_target(last_control, path.points[0], settings)
            status = replace(status, sentence=status.sentence + far)
        if not status.success:
            break
    all_factors = np.array(factors).reshape(len(points), len(loading.stages) + varies)
    return EquilibriumPath(
        points, all_factors, tuple(critical), status, iterations, tuple(notes), approach
    )


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
    # The end first: its forces are known, and its modes will be computed with its factors.
    if path.points[-1] is path.points[0] or not all(map(_is_unloaded, (path.end, path.points[0]))):
        return []
    t = path.end.system.loaded.time[0]
    return [
        f"equilibrium: all scaled loads are zero at t = {t:g} s, so all points of the path are "
        "equal; pass another time t=, other loads=, or other values of inputs."
    ]


def _is_unloaded(point: EquilibriumPoint) -> bool:
    return not np.any(point.system.residual(point.x, point.mu)[1])


def _unknown_notes(path: StagePath) -> list[str]:
    """Return a remark if the stability of an equilibrium is unknown."""
    count = sum(point.negative_count < 0 for point in path.points)
    if not count:
        return []
    return [
        f"equilibrium: the stability of {count} of {len(path.points)} equilibria cannot be "
        "computed, so that critical points may be missing; use thicker beams or fewer elements if "
        "rounding errors are the cause, and fewer elements or less damping if strong damping slows "
        "many modes down."
    ]


def _rounding_notes(path: StagePath) -> list[str]:
    """Return a remark if rounding errors are not negligible next to the smallest stiffness."""
    ratio = _initial_rounding_ratio(path)
    if ratio <= _MAX_ROUNDING_RATIO:
        return []
    flutter = ""
    if any(one.kind == FLUTTER for one in path.critical):
        flutter = ", and flutter loads of lightly damped modes by more"
    bound = min(_ROUNDING_MARGIN * ratio, 1.0)
    digit = 10.0 ** np.floor(np.log10(bound))
    return [
        "equilibrium: critical loads and stability are uncertain by up to "
        f"{np.ceil(bound / digit) * digit:.1g} "
        f"of the load{flutter}, because rounding errors reach this fraction of the smallest "
        "stiffness: the beams are too thin for double precision. Use thicker beams, and scale the "
        "loads by the bending stiffness."
    ]


def _initial_rounding_ratio(path: StagePath) -> float:
    """Return the bound on rounding errors, relative to the smallest stiffness.

    The stiffness at the beginning is decisive, because it vanishes at critical points; if all of it
    is zero, as that of a pendulum without weight, that at the end.
    """
    ratios = (path.points[0].rounding_ratio, path.end.rounding_ratio)
    return next((x for x in ratios if np.isfinite(x)), 0.0)


def _damping_notes(path: StagePath) -> list[str]:
    """Return a remark if modes are damped, but so lightly that rounding decides their growth."""
    ratio = 0.0 if path.end.has_potential else path.end.stability.damping_ratio
    if not 0.0 < ratio < _MIN_DAMPING_RATIO:
        return []
    return [
        "equilibrium: flutter loads and stability are uncertain, because rounding errors are not "
        f"negligible compared with the damping ratio {ratio:.1g} of a mode; use no damping, or "
        f"damping ratios above {_MIN_DAMPING_RATIO:.0e}."
    ]


def _range_notes(path: StagePath, quantity: str) -> list[str]:
    """Return a remark per range of load factors in which growing modes appear and vanish."""
    ranges = dict.fromkeys(one.loads for one in path.critical if one.loads)
    return [
        f"equilibrium: critical points between the {quantity} {low:.6g} and {high:.6g} are not "
        "distinguished: the number of unstable directions rises and falls there by rounding "
        "errors, because the mesh separates modes with equal critical loads, or because one mode "
        "becomes unstable where another becomes stable. Use more elements or thicker beams, or "
        "analyze independent parts separately."
        for low, high in ranges
        if high - low > _SAME_LOAD_RATIO * abs(high)
    ]


def _jump_notes(corrector: Corrector, path: StagePath, quantity: str) -> list[str]:
    """Return a remark per step of load control that passes over a limit point.

    A step that is larger than the limit load may end on the path beyond it, such as that of an arch
    that has snapped through; both ends are stable. Steps that `_suspicious_steps` returns are
    followed again by arc length.
    """
    notes = []
    for begin, end in _suspicious_steps(corrector, path):
        again = StagePath([begin])
        settings = PathSettings("", (end.mu,), ARC_LENGTH, None, (), _MAX_CHECK_POINTS)
        _follow_stage(Corrector(corrector.system), again, settings, LoadControl())
        limits = [again.points[x.row].mu for x in again.critical if x.kind == LIMIT]
        if limits:
            notes.append(
                f"equilibrium: the step of the {quantity} from {begin.mu:.6g} to {end.mu:.6g} "
                f"passes over the limit point at {limits[0]:.6g} and jumps to other equilibria; "
                "use control='arc length', or a smaller step."
            )
    return notes


def _suspicious_steps(
    corrector: Corrector, path: StagePath
) -> list[tuple[EquilibriumPoint, EquilibriumPoint]]:
    """Return the ends of load steps next to which the structure is much stiffer.

    A path of a single step is compared with its tangent at the end. If this is stiffer, the path is
    divided into the default steps; the single step is suspicious if one of these is, or if
    they do not lead to the same point.
    """
    measure, n = corrector.displacement_measure, corrector.system.equations.n
    steps = [(a, b) for a, b in pairwise(path.points) if a.mu != b.mu]
    if not steps:
        return []
    motions = measure.farthest_of_rows(np.array([(b.x - a.x)[:n] for a, b in steps]))
    rates = [motion / abs(b.mu - a.mu) for motion, (a, b) in zip(motions, steps, strict=True)]
    if len(steps) != 1:
        neighbors = rates[1:] + rates[-2:-1]
        pairs = zip(steps, rates, neighbors, strict=False)
        return [step for step, rate, next_ in pairs if rate > _JUMP_RATE_RATIO * next_ > 0.0]
    ((begin, end),) = steps
    tangent = corrector.try_path_tangent(end, LoadControl())
    if tangent is None or rates[0] <= _SINGLE_STEP_RATE_RATIO * measure.farthest(tangent.x[:n]):
        return []
    divided = StagePath([begin])
    settings = PathSettings("", (end.mu,), LOAD, None, (), _MAX_CHECK_POINTS)
    _follow_stage(Corrector(corrector.system), divided, settings, LoadControl())
    difference = measure.farthest((divided.end.x - end.x)[:n])
    is_same = divided.status.success and difference <= _SAME_END_RATIO * motions[0]
    is_undivided = len(divided.points) == len(path.points)
    is_same &= is_undivided or not _suspicious_steps(corrector, divided)
    return [] if is_same else steps


def follow_to_critical_point(
    corrector: Corrector, begin: EquilibriumPoint, targets: tuple[float, ...]
) -> StagePath:
    """Return the path by arc length from `begin` to its first critical point.

    It has a point at each of the load factors `targets` before, ends at the last one if there is no
    critical point, and earlier with a status that is no success if it cannot be followed.
    """
    path, control = StagePath([begin]), LoadControl()
    settings = PathSettings("", targets, ARC_LENGTH, None, (), _MAX_CHECK_POINTS)
    steps = replace(_choose_steps(corrector, begin, settings, control), stop_at_critical_point=True)
    follow_path(corrector, path, steps, settings.targets)
    return path


def find_unloaded_equilibrium(
    corrector: Corrector, q: Array, approach: list[Array] | None = None
) -> EquilibriumPoint:
    """Return the equilibrium at which the path begins, under all loads if none is scaled.

    Relaxation is used if Newton's method fails or moves the mechanism too far; it appends positions
    to `approach`.
    """
    system = corrector.system
    first, last = system.ends
    x = np.append(q, np.zeros(system.equations.m))
    try:
        drawn = EquilibriumPoint(system, x, first)
        point, correction = corrector.follow(LoadControl(), first, drawn, None)
        if correction.motion <= _MAX_INITIAL_MOTION:
            return replace(point, load_direction=correction.direction)
    except CorrectorError:
        pass
    return _relax(corrector, q, first if system.has_scaled_loads else last, approach)


def _relax(
    corrector: Corrector, q: Array, mu: float, passed: list[Array] | None = None
) -> EquilibriumPoint:
    x = np.concatenate(relax_to_equilibrium(corrector.system.at_factor(mu), q, passed))
    return EquilibriumPoint(corrector.system, x, mu)


def _follow_stage(
    corrector: Corrector, path: StagePath, settings: PathSettings, control: Control
) -> None:
    """Extend the path of one stage to the targets; switch branches as the settings request."""
    begin, targets = path.end, list(settings.targets)
    steps = _choose_steps(corrector, begin, settings, control)
    if settings.column and _is_unloaded(begin):
        t = corrector.system.loaded.time[0]
        path.status = Status(
            "failed",
            f"all scaled loads are zero at t = {t:g} s; pass another time t= or other loads=",
        )
        return
    direction = None
    if begin.free_count:
        direction = _loaded_direction(corrector, begin, steps)
        if direction is None:
            _follow_from_mechanism(corrector, path, steps, targets)
            return
        if steps.by_arc_length or settings.column:
            direction = None
    try:
        for switch in settings.switch:
            before = len(path.branch_points)
            to_branch_point = replace(steps, stop_at_branch_point=abs(switch))
            follow_path(corrector, path, to_branch_point, targets, direction)
            count = len(path.branch_points) - before
            if path.status.success and count < abs(switch):
                sentence = (
                    f"switch={switch} requests branch point {abs(switch)}, but the number of "
                    f"branch points found is {count}; use a smaller number or a farther target"
                )
                path.status = Status("failed", sentence)
            if not path.status.success:
                return
            direction = switch_branch(corrector, path, steps, np.sign(switch))
    except CorrectorError as error:
        path.status = Status("failed", str(error))
        return
    follow_path(corrector, path, steps, targets, direction)
    if path.is_stuck and settings.control == LOAD and path.end is begin:
        # A slack cable or a bar without bending stiffness moves far under the smallest load, until
        # it is stretched.
        most = steps.max_load_step
        first = begin.mu + float(np.clip(targets[0] - begin.mu, -most, most))
        by_arc = replace(settings, control=ARC_LENGTH, step=None, targets=(first,))
        arc_steps = _choose_steps(corrector, begin, by_arc, control)
        stretched = StagePath([begin])
        follow_path(corrector, stretched, replace(arc_steps, stop_at_critical_point=True), [first])
        if stretched.end.mu == first:
            path.points, path.critical = stretched.points, stretched.critical
            path.status, path.is_stuck = REACHED_END, False
            follow_path(corrector, path, steps, targets)
        elif stretched.end is begin:
            path.status, path.is_stuck = REACHED_END, False
            _follow_from_mechanism(corrector, path, steps, targets)


def _choose_steps(
    corrector: Corrector, begin: EquilibriumPoint, settings: PathSettings, control: Control
) -> ContinuationSettings:
    """Return the continuation settings, with default step sizes where none are set."""
    scale = corrector.system.equations.group_scales
    initial_value = control.value(begin.x, begin.mu)
    reach = max(abs(target - initial_value) for target in settings.targets)
    reach = max(reach, _MIN_REACH)
    by_load = isinstance(control, LoadControl)
    ratio = _PARAMETER_STEP_RATIO if settings.varies else _LOAD_STEP_RATIO
    load_step = ratio * (reach if by_load else 1.0)
    if settings.control != ARC_LENGTH:
        step = settings.step or (load_step if by_load else _DISPLACEMENT_STEP_RATIO * reach)
        load_step = step if by_load else load_step
        norm = StepNorm(scale, np.inf)
        return ContinuationSettings(control, False, step, load_step, norm, settings.max_points)
    step = _ARC_STEP
    if not by_load:
        # Largest change of the column if all coordinates move by their natural sizes.
        sensitivity = np.abs(control.gradient(begin.x, begin.mu)[0][: len(scale)]) @ scale
        step = min(step, _MAX_SHARE_OF_NEEDED_MOTION * reach / max(sensitivity, _MIN_REACH))
    direction = corrector.try_path_tangent(begin, LoadControl())
    motion = 0.0 if direction is None else StepNorm(scale, np.inf).max_norm(direction.x)
    # A load is weighted no more than the motion that it causes, so that crossing paths differ in
    # direction.
    norm = StepNorm(scale, 1.0 / max(motion, _MIN_LOAD_STEP_MOTION / load_step))
    return ContinuationSettings(
        control, True, settings.step or step, load_step, norm, settings.max_points
    )


def _loaded_direction(
    corrector: Corrector, begin: EquilibriumPoint, steps: ContinuationSettings
) -> PathDirection | None:
    """Return the change of the equilibrium with the load factor under a small load.

    The result is None unless this load moves the mechanism little, to an equilibrium near `begin`.
    The bending stiffness of a thin beam may be as small as rounding errors of its axial stiffness,
    so that the eigenvalues at `begin` do not distinguish a thin beam from a mechanism. If they are
    zero, as those of a rigid upright pendulum, the tangent at `begin` is undefined.
    """
    direction = corrector.try_path_tangent(begin, LoadControl())
    if direction is None:
        return None
    motion = steps.norm.max_norm(direction.x)
    load = min(steps.max_load_step, _MAX_INITIAL_MOTION / max(motion, _MIN_REACH))
    if load < MIN_STEP_RATIO * steps.max_load_step:
        return None
    x = corrector.displace(begin.x, load * direction.x)
    try:
        point = corrector.correct(LoadControl(), load, x, load)
    except CorrectorError:
        return None
    if not steps.norm.max_norm(point.x - x) <= MAX_CORRECTION_RATIO * motion * load:
        return None
    return corrector.try_path_tangent(point, LoadControl())


def _follow_from_mechanism(
    corrector: Corrector, path: StagePath, steps: ContinuationSettings, targets: Sequence[float]
) -> None:
    """Follow a path from an unloaded mechanism that can move freely, by relaxation under load."""
    e, by_load = corrector.system.equations, isinstance(steps.target_control, LoadControl)
    try:
        for k, target in enumerate(targets if by_load else [1.0]):
            begin, most = path.end.mu, steps.max_load_step
            first = begin + float(np.clip(target - begin, -most, most))
            point = _relax(corrector, path.end.x[: e.n], first)
            if not point.free_count:
                # The unloaded position is arbitrary, so the path begins at this loaded point
                # instead.
                path.points[-1] = point
                follow_path(corrector, path, steps, targets[k:])
                return
            if not by_load:
                free = free_coordinate(e, point)
                raise BeamdaeError(
                    f"{free} is free to move under the loads, which do not change it; choose its "
                    f"value with start={{{free!r}: ...}}, and set to= to a load factor"
                )
            path.points.append(_relax(corrector, path.end.x[: e.n], target))
    except BeamdaeError as error:
        path.status = Status("failed", str(error).rstrip("."))


def free_coordinate(e: EquationsOfMotion, point: EquilibriumPoint) -> str:
    """Return the name of the coordinate that moves most in a motion without stiffness.

    The name is "" if there is no such motion.
    """
    if point.system.held_coordinates:
        return e.q_names[point.system.held_coordinates[0]]
    if not point.free_count:
        return ""
    stability = point.stability
    softest = int(np.argmin(np.abs(stability.eigenvalues)))
    return dominant_coordinate(e, stability.modes[:, softest])


def dominant_coordinate(e: EquationsOfMotion, mode: Array) -> str:
    """Return the name of the coordinate that moves most in a mode, relative to its natural size."""
    size = np.abs(mode / e.position_scales)
    largest = np.flatnonzero(size >= (1.0 - _EQUAL_MOTION_TOLERANCE) * np.max(size)).tolist()
    # If amplitudes are equal, an angle describes the mode better than the points it moves.
    return e.q_names[min(largest, key=lambda k: (e.coordinates[k].unit != "rad", k))]


def _end_status(path: StagePath, system: LoadedEquations, control: str, quantity: str) -> Status:
    """Return the status of a path; if it ended early, with the last load factor.

    A remedy is added if no step converges.
    """
    if path.status.success:
        return path.status
    sentence = f"{path.status.sentence} (last converged {quantity}: {path.end.mu:.6g})"
    if path.is_stuck and (jump := _find_jump(path, system)) is not None:
        sentence += f"; the loads jump at t = {jump:g} s, so begin another path there with from_="
    elif path.is_stuck:
        sentence += _remedy(path, system.equations, control)
    return Status(path.status.kind, sentence)


def _find_jump(path: StagePath, system: LoadedEquations) -> float | None:
    """Return the breakpoint [s] at which a path over the time ends, or None."""
    first, last = system.ends
    if system.varied is None or system.time_at(first)[0] == system.time_at(last)[0]:
        return None
    distance = MIN_STEP_RATIO * abs(last - first)
    near = (x for x in system.equations.breakpoints if abs(x - path.end.mu) <= distance)
    return next(near, None)


def _describe_far_target(
    control: DisplacementControl, begin: EquilibriumPoint, settings: PathSettings
) -> str:
    """Return a remark on a target much farther away than the size of the mechanism, or ""."""
    unit, length = control.observable.columns[control.column].unit, begin.system.equations.length
    value = control.value(begin.x, begin.mu)
    farthest = max(settings.targets, key=lambda target: abs(target - value))
    ratio = abs(farthest - value) / length
    if unit != "m" or ratio < _FAR_TARGET_RATIO:
        return ""
    return (
        f"; the target {settings.column} = {farthest:g} m is {ratio:.2g} times the size of the "
        f"mechanism ({length:.3g} m) away, so check its unit"
    )


def _may_end_by_rounding(path: StagePath) -> bool:
    """Return True if rounding errors of thin beams may prevent further steps."""
    ratio, end = _initial_rounding_ratio(path), path.end
    if ratio <= _MIN_STUCK_ROUNDING_RATIO or ratio > _MAX_ROUNDING_RATIO:
        return ratio > _MAX_ROUNDING_RATIO
    is_soft = end.free_count > 0 or end.rounding_ratio > _MIN_END_ROUNDING_RATIO
    return is_soft or len(path.points) == 1


def _remedy(path: StagePath, e: EquationsOfMotion, control: str) -> str:
    """Return the end of a message: why steps probably fail, and a remedy; "" if unknown."""
    rounding = ""
    if _may_end_by_rounding(path):
        rounding = (
            "; rounding errors may prevent further steps, because the beams are too thin for "
            "double precision, so use thicker beams or fewer elements"
        )
    if control == DISPLACEMENT and len(path.points) == 1:
        return "; check that the loads move the prescribed column" + rounding
    if control == DISPLACEMENT:
        return "; use control='arc length' to continue where a displacement reverses" + rounding
    if control != LOAD:
        return rounding
    if len(path.points) == 1:
        size = "; even a millionth of the largest step fails, so check the size of the loads"
        return size + rounding
    before, now = (_lowest_positive_eigenvalue(point) for point in (path.points[0], path.end))
    if not 0.0 < now < _SOFT_RATIO * before:
        return "; use control='arc length' to continue past the maximum of a load" + rounding
    stability = path.end.stability
    coordinate = dominant_coordinate(e, stability.mode(stability.negative_count))
    lost = (
        f", where {coordinate} has lost {100.0 * (1.0 - now / before):.0f} % of the initial "
        "stiffness"
    )
    if rounding:
        return f"{lost}{rounding}, or control='arc length' if this is a limit point"
    return (
        f"{lost}, which suggests a limit point; use control='arc length' to continue past "
        "this point"
    )


def _lowest_positive_eigenvalue(point: EquilibriumPoint) -> float:
    eigenvalues = point.stability.eigenvalues
    positive = eigenvalues[eigenvalues > 0.0]
    return float(positive[0]) if len(positive) else 0.0
