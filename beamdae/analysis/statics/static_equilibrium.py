"""Static equilibrium of a mechanism under proportional loading: `bd.equilibrium`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from beamdae import deferred
from beamdae.analysis.continuation.engine import Point
from beamdae.analysis.eigenproblems.turning import find_turning
from beamdae.analysis.statics.load_scaling import (
    build_loading,
    vary_parameter,
)
from beamdae.analysis.statics.path_parameters import resolve_parameter
from beamdae.analysis.statics.path_settings import PathSettings
from beamdae.analysis.statics.paths import (
    free_coordinate,
    tabulate_points,
    trace_path,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    hold_messages,
    require_choice,
    require_finite,
    short_repr,
    warn_of_incomplete_result,
    warn_of_result,
    warnings_are_ignored,
)
from beamdae.interrupts import (
    PARTIAL_RESULTS,
    Interrupted,
    PartialResult,
    acknowledge,
    interruptible,
)
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_checks.contacts import deep_rest_warnings
from beamdae.model_checks.validity_ranges import (
    IGNORED,
    describe_meaningless_strain,
    friction_warnings,
)
from beamdae.model_functions import Model
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM, Mechanism, require_start
from beamdae.parts.rotation import Rotation
from beamdae.results.equilibrium import UNSTABLE, Equilibrium
from beamdae.results.outcome import Status
from beamdae.results.start_changes import drawing_warnings
from beamdae.simulation import as_equations

Array = np.ndarray

_NAME = "equilibrium"


@interruptible
def equilibrium(
    model: Any,
    loads: Any = None,
    to: Any = None,
    control: str | None = None,
    step: float | None = None,
    switch: Any = 0,
    max_points: int = 500,
    t: float = 0.0,
    start: Any = None,
    *,
    over: str | None = None,
    from_: float | None = None,
    partial: PartialResult = "raise",
    accuracy: float | None = None,
    accuracy_columns: Sequence[str] | str | None = None,
) -> Equilibrium:
    """Compute static equilibria of a mechanism along a path of increasing loads.

    With `over`, the time, the value of a driver or an input, or a parameter of the model increases
    instead, under all loads: quasi-static force over displacement.

    Solves F(t, q, 0, 0; mu) + G^T lam = 0, g(t, q) = 0 along a path that begins at the load factor
    mu = 0, by Newton's method with the exact tangent. Failed steps are shortened and repeated.
    Laws, drivers and moving loads are evaluated at the time `t`. Dampers, friction and centrifugal
    forces vanish at rest.

    Stability is assessed for constant loads, by the number of negative eigenvalues of the tangent
    stiffness in the motions that the joints allow. For loads without a potential (follower loads),
    it is assessed by the growing modes of the linearized equations of motion, see `modes`, which
    involve mass and damping. A warning names values and stability at the end, and critical points,
    that differ by more than 4 % with halved elements and exact strains; see `Equilibrium.errors`.

    Parameters
    ----------
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
        Constrained systems and equations have no named loads and are solved under all loads.
    loads
        Name or names of the loads that mu scales: parts that only apply forces, and "gravity".
        Defaults to every active `Force`, `Moment`, `DistributedForce` and `MovingForce`, and
        gravity. A list of lists defines stages, whose load factors are raised from 0 to 1 in turn;
        `to`, `control`, `step` and `switch` refer to the last stage, and earlier stages are
        computed with load control. Loads that are not named act in full from the beginning.
    to
        Target load factor, or a list of targets to reach in turn; defaults to 1. With `over`, its
        last value, or a list of values. {"tip.y": value} sets one or
        several target values of an observed position instead. Each target becomes a row of the
        path.
    control
        Quantity prescribed in each step. "load": the load factor (default if `to` contains load
        factors). "displacement": the column of `to` (default if `to` names a column); passes limit
        points. "arc length": pseudo-arc length (Keller 1977; always the default with `switch`);
        passes limit points and turning points of the displacement.
    step
        Largest permitted step. "load": change of mu; defaults to 0.1 of the distance to the
        farthest target. "displacement": change of the column; defaults to 0.05 of this distance.
        "arc length": motion of a coordinate relative to the size of the mechanism, or in rad;
        defaults to 0.05, or less if the target is near. With `over`, change of its value; defaults
        to 0.02 of the distance.
    switch
        Number of the branch point, counted from 1, at which to switch to the crossing path, with
        control="arc length". Negative numbers select the opposite side. A list switches repeatedly;
        numbers are counted on the current path. 0 never switches.
    max_points
        No further step is taken once a stage has this many points; at least 2.
    t
        Time [s] at which laws are evaluated.
    over
        Quantity that varies in place of a load factor: "t", or the name of a driver (`Driver`,
        `TranslationalDriver` or `Distance`), an input, or a parameter of the model function. A
        parameter may change numbers of the model, but neither elements nor joints.
    from_
        Value at which a path with `over` begins. Defaults to 0 for the time, the value in the
        drawing for a driver, and the value of the model for an input or a parameter.
    start
        Positions near which the path begins, by name as in `simulate`, or an `Equilibrium`, whose
        end is used. Defaults to the start of the model.
    partial
        "return" to return the path so far if the call is interrupted, with the status
        "interrupted", instead of raising `Interrupted`.
    accuracy
        Largest error of the required columns [-], from 1e-6 to 0.1, see `Errors`.
    accuracy_columns
        Columns of `errors` that must be accurate. Defaults to all load factors and, of the
        observed columns, positions, angles and deflections [m, rad] or, if there are none, all.

    Returns
    -------
    Equilibrium
        The equilibrium path. If it ended early, `status` gives the reason.

    Raises
    ------
    BeamdaeError
        If the model or an argument is invalid, `start` is a steady rotation, or no equilibrium is
        found at which the path begins.
    Interrupted
        If Ctrl-C ends the call; `Interrupted.partial` is the path so far, or None before
        its first point.

    Warns
    -----
    BeamdaeWarning
        If the path ended early (with the last converged load factor and the reason), and for each
        of `Equilibrium.warnings`, which name an unstable end that critical points do not show.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> crown = mech.add(bd.PointMass("crown", 1.0, at=(0.0, 0.2)))
    >>> left = mech.add(bd.Spring("left", mech.ground.at(-1.0, 0.0), crown.point, 1000.0))
    >>> right = mech.add(bd.Spring("right", mech.ground.at(1.0, 0.0), crown.point, 1000.0))
    >>> press = mech.add(bd.Force("press", crown.point, (0.0, -1.0)))
    >>> mech.observe("crown", crown.point)
    >>> path = bd.equilibrium(mech, to={"crown.y": 0.0})
    >>> [(point.kind, round(point.factor, 6)) for point in path.critical]
    [('limit point', 3.019147)]
    """
    require_choice(_NAME, "partial", partial, PARTIAL_RESULTS)
    t = require_finite(_NAME, "t", t)
    settings = PathSettings.from_arguments(to, control, step, switch, max_points, over)

    def trace(model: Any, _: Any = None) -> Equilibrium:
        return _trace(model, settings, loads, t, start, over, from_)

    if accuracy is not None and isinstance(start, Equilibrium):
        raise BeamdaeError(
            f"{_NAME}: accuracy cannot be combined with a start at the end of a path, whose mesh "
            "is another one; start at positions by name."
        )
    until = deferred.module("accuracy.until")
    analysis = until.Analysis(
        _NAME,
        trace,
        start=start,
        observed=lambda path: {*path.columns, UNSTABLE},
    )
    result = until.reach_accuracy(analysis, model, accuracy, accuracy_columns)
    if result.status.kind == "interrupted" and partial == "raise":
        raise Interrupted(result.status.sentence, result, _NAME)
    if not result.status.success:
        warn_of_incomplete_result(_describe_early_end(result))
    if not warnings_are_ignored():
        try:
            sentences = result.warnings
        except KeyboardInterrupt:
            acknowledge()
            if partial == "raise":
                reason = "interrupted while its errors were measured"
                raise Interrupted(reason, result, _NAME) from None
            sentences = ()
        warn_of_result(sentences, result.equations.build_warnings)
    return result


def _trace(
    model: Any,
    settings: PathSettings,
    loads: Any,
    t: float,
    start: Any,
    over: str | None,
    from_: float | None,
) -> Equilibrium:
    """Return the path of `equilibrium` without issuing warnings."""
    source = model
    information: dict[str, Any] = {}
    if isinstance(model, Model):
        information = {"name": model.name, "parameters": model.parameters}
        model = model()
    equations, q = initial_positions(_NAME, model, start)
    if over is None:
        if from_ is not None:
            raise BeamdaeError(
                "equilibrium: a path of load factors begins at 0, got the begin "
                f"{short_repr(from_)}; name the quantity that varies with over=."
            )
        loading = build_loading(model, equations, loads, t)
    else:
        if loads is not None:
            raise BeamdaeError(
                "equilibrium: loads= and over= cannot be combined, because all loads act in full "
                "where another quantity varies; omit loads=."
            )
        resolved = resolve_parameter(source, equations, over, from_, settings.targets[-1], t)
        varied = resolved.equations_at(resolved.begin)
        equations = replace(varied, q0=q, start=equations.start)
        loading = vary_parameter(equations, resolved)
    with single_threaded:
        path = trace_path(loading, q, settings)
        points, rows = path.points, tabulate_points(loading, path.points)
        start_warnings: tuple[str, ...] = ()
        if equations.start is None and from_ is None and not isinstance(start, Equilibrium):
            first = loading.systems[0]
            begin = first.loaded if first.is_linear else first.unloaded
            start_warnings = drawing_warnings(begin.equations, begin.time)
        parameter = loading.parameter
        if parameter is not None and rows["numbers"] is not None:
            last = parameter.equations_at(points[-1].p)
            equations = replace(last, start=equations.start)
        # Contacts on the way; the equations have the numbers of the end.
        begin_row = -1 if rows["numbers"] is not None else 0
        at_end, times = loading.systems[-1].at_factor(points[-1].p).equations, rows["times"]
        times = np.array([times[begin_row]] * len(path.approach) + [*times[begin_row:]])
        q = np.array([*path.approach, *rows["q"][begin_row:]])
        configurations, critical = equations.configurations, {one.row for one in path.critical}
        names = [""]
        for row, point in enumerate(points):
            # At a critical point, the critical mode has no stiffness either.
            names.append(names[-1] if row in critical else free_coordinate(point))
        inactive = () if configurations is None else configurations.initially_inactive
        return Equilibrium(
            equations=equations,
            t=float(rows["times"][-1, 0]),
            status=_add_meaningless_strain(equations, rows["q"][-1:], path.status),
            loads=loading.stages,
            factors=path.factors,
            unstable=np.array([point.monitor.unstable for point in points]),
            critical=path.critical,
            settings={**settings.description, "iterations": sum(x.iterations for x in points)},
            model=information,
            notes=(
                *start_warnings,
                *friction_warnings(equations, IGNORED, inactive),
                *_turning_notes(points[-1]),
                *deep_rest_warnings(at_end, times, q),
                *path.notes,
            ),
            free_coordinates=tuple(names[1:]),
            over="" if parameter is None else parameter.header,
            **rows,
        )


def _add_meaningless_strain(equations: EquationsOfMotion, q: Array, status: Status) -> Status:
    """Return the status of a path; if it failed at large strains at q (1, n), it names them."""
    strain = describe_meaningless_strain(equations, q, 1.0) if status.kind == "failed" else ""
    if not strain:
        return status
    return Status(status.kind, f"{status.sentence}; {strain}: check loads, section and units")


def _describe_early_end(path: Equilibrium) -> str:
    return f"{path.model.get('name', _NAME)}: {path.status.sentence}."


def trace_critical_points(model: Any, settings: Mapping[str, Any]) -> tuple[Equilibrium, list[str]]:
    """Return a path of which only the critical points are used, and the warnings it would issue.

    Warnings about the end of the path, which lies beyond its critical points, are omitted.
    """
    with hold_messages() as messages:
        path = equilibrium(model, **settings)
    about_end = (_describe_early_end(path), path.instability)
    return path, [message for message in messages if message not in about_end]


def _turning_notes(point: Point) -> tuple[str, ...]:
    """Return a note if the mechanism turns although an equilibrium is at rest, or nothing."""
    problem, e = point.problem, point.problem.system.equations
    return find_turning(
        e,
        problem.system.time_at(point.p),
        point.x[: e.n],
        lambda: problem.system.linearize_motion(point.x, point.p, problem.idle),
        "an equilibrium",
        _rotation_remedy,
    )


def _rotation_remedy(speed: float) -> str:
    return (
        f"the first row of a short run with start=bd.rotation({speed:.10g}) "
        f"(--start rotation={speed:.10g}) is the steady rotation"
    )


def initial_positions(name: str, model: Any, start: Any) -> tuple[EquationsOfMotion, Array]:
    """Return the equations of a model and the positions near which its path begins.

    `name` is the calling function, for messages.
    """
    if isinstance(start, Equilibrium):
        equations = as_equations(name, model, AS_DRAWN)
        return equations, start.to_checkpoint().start_equations(equations).q0
    if start is None and isinstance(model, Mechanism):
        start = model.start
    elif isinstance(start, Rotation):
        raise BeamdaeError(
            f"{name}: start must not be a steady rotation, because an equilibrium is at rest; "
            f"{_rotation_remedy(start.speed)}."
        )
    if start is not None:
        start = require_start(name, start, ", or another equilibrium")
    equations = as_equations(name, model, AS_DRAWN if start == EQUILIBRIUM else start)
    return equations, equations.q0
