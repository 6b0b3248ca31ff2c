"""Critical loads as a function of a parameter of the model: `bd.boundary`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae import deferred
from beamdae.analysis.continuation.critical import BRANCH, FLUTTER, LIMIT, explain_counts
from beamdae.analysis.continuation.engine import (
    CurveError,
    Point,
    Segment,
    Steps,
    follow,
    prescribe_parameter,
)
from beamdae.analysis.parameter_range import ParameterRange
from beamdae.analysis.statics.critical_curves import (
    CHANGE_SIZE,
    CriticalCurve,
    Family,
    create_family,
)
from beamdae.analysis.statics.load_scaling import (
    LoadedEquations,
    build_loading,
    require_one_stage,
)
from beamdae.analysis.statics.static_equilibrium import trace_critical_points
from beamdae.analysis.statics.static_problem import StaticProblem
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.errors import (
    BeamdaeError,
    as_text,
    record_warnings,
    require_choice,
    require_count,
    require_pair,
    require_positive,
    short_repr,
    warn_of_incomplete_result,
    warn_user,
)
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.results.displays import HasPage, HasTable, Plot
from beamdae.results.equilibrium import UNSTABLE
from beamdae.results.outcome import REACHED_END, Status

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_NAME = "boundary"
LOAD = "load"
CUSP, TURNING, HILLTOP, DOUBLE = "cusp", "turning point", "hilltop", "double branch point"

# Default step along a curve, see `boundary`.
_STEP = 0.05
# Accuracy of hilltops at which the extended system is regular, relative to the step.
_RESOLUTION = 1e-7
# Flutter loads: initial half width of the search, relative to the load factor; factor by which it
# grows; largest value.
_WINDOW, _WINDOW_GROWTH, _MAX_WINDOW = 1e-3, 10.0, 1.0


class BoundaryPoint(NamedTuple):
    """Special point of a boundary.

    Attributes
    ----------
    kind
        - "cusp": two limit points merge and vanish,
        - "turning point": two branch points merge and vanish,
        - "hilltop": a limit point and a branch point coincide,
        - "double branch point": two branch points coincide.
    value
        Value of the parameter.
    factor
        Load factor [-].
    """

    kind: str
    value: float
    factor: float


@dataclass(frozen=True, repr=False)
class Boundary(HasTable, HasPage):
    """Critical load factors as a function of a parameter; see `boundary`.

    Attributes
    ----------
    kind
        Kind of the critical points, see `CriticalPoint`.
    parameter
        Name of the parameter.
    values
        Values of the parameter (k,), in the order of the curve. They reverse at a cusp.
    factors
        Load factors (k,) [-].
    special
        Special points, in the order of the curve.
    unstable
        Number of unstable directions (k,) besides the critical one, or -1 if it is not known, as
        for limit and branch points under forces without a potential. If it is 0, the path is
        stable before or after the critical point; otherwise, the structure has left this path at
        another critical point.
    q
        Coordinates (k, n) [m or rad].
    status
        "ok" if the curve ends at a limit of the parameter, otherwise "limited" or "failed".
    loads
        Names of the scaled loads.
    warnings
        Warnings that the call issued.
    """

    kind: str
    parameter: str
    values: Array
    factors: Array
    special: tuple[BoundaryPoint, ...]
    unstable: Array
    q: Array = field(repr=False)
    status: Status
    loads: tuple[str, ...]
    warnings: tuple[str, ...] = field(default=(), repr=False)

    def __repr__(self) -> str:
        special = "".join(
            f"; {one.kind} at {self.parameter} = {one.value:.6g}, factor {one.factor:.6g}"
            for one in self.special
        )
        count = int(np.sum(self.unstable > 0))
        unstable = f", {count} of them on unstable paths" if count else ""
        return (
            f"<Boundary of the {self.kind}: {self.status.kind}, {self.status.sentence}; "
            f"{len(self.values)} points{unstable}, {self.parameter} = {self.values[0]:g} to "
            f"{self.values[-1]:g}{special}>"
        )

    def plot(self) -> Plot:
        """Plot the critical load factor over the parameter, with the special points."""
        return deferred.module("report.result_displays").draw_result(self)

    def table(self) -> pd.DataFrame:
        """Return a table with the values of the parameter, the load factors and `unstable`."""
        import pandas as pd

        return pd.DataFrame(
            {
                self.parameter: self.values,
                "load factor [-]": self.factors,
                UNSTABLE: self.unstable,
            }
        )


@interruptible
@record_warnings
def boundary(
    model: Any,
    kind: str,
    by: Any,
    values: Any,
    number: int = 1,
    step: float = _STEP,
    max_points: int = 200,
    parameters: Mapping[str, Any] | None = None,
    **settings: Any,
) -> Boundary:
    """Follow a critical point of an equilibrium path while a parameter of the model changes.

    The first point lies on the path of the model with the first value of the parameter. Limit and
    branch points are followed by arc length as solutions of an extended system, see
    `critical_curves`, so that a curve can reverse at a cusp. Branch points are those of symmetric
    structures. Flutter points are located for values of the parameter in equal steps, by bisection
    with the stability of the linearized motion, see `equilibrium`.

    Parameters
    ----------
    model
        A model function with a number as the parameter.
    kind
        "limit point", "branch point" or "flutter point".
    by
        (name of the parameter, "load").
    values
        First and last value of the parameter. The curve ends where it leaves this range, at the
        last value or, after a cusp, at the first.
    number
        Number of the critical point of this kind on the path, counted from 1.
    step
        Largest step: the change of the parameter relative to its range, or a fifth of the changes
        of motion and load factor relative to those at the first point.
    max_points
        Largest number of points.
    parameters
        Values of other parameters of the model that differ from the defaults.
    settings
        Arguments of `equilibrium` for the path of the first value: `loads` in one stage, `to`,
        `control`, `switch`, `t`, `start`. Choose `to` such that the path passes the critical point.

    Returns
    -------
    Boundary
        Load factors, and cusps, hilltops and double branch points. `status` gives the reason if the
        curve ended early.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the loads have several stages, or the first path has no such
        point.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        If the curve ends early, if points lie on paths that are unstable without the critical
        mode, and as in `equilibrium` for the first path, except about its end.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=1.0)
    ... def truss(rise=0.2):
    ...     mech = bd.Mechanism()
    ...     crown = mech.add(bd.PointMass("crown", 1.0, at=(0.0, rise)))
    ...     for name, x in (("left", -1.0), ("right", 1.0)):
    ...         mech.add(bd.Spring(name, mech.ground.at(x, 0.0), crown.point, 1000.0))
    ...     mech.add(bd.Force("press", crown.point, (0.0, -1.0)))
    ...     mech.observe("crown", crown.point)
    ...     return mech
    >>> curve = bd.boundary(
    ...     truss, "limit point", ("rise", "load"), (0.2, 0.4), to={"crown.y": 0.0}
    ... )
    >>> round(float(curve.factors[-1]), 3)
    22.844
    """
    require_choice(_NAME, "kind", kind, (LIMIT, BRANCH, FLUTTER))
    expected = f"(name of a parameter, {LOAD!r})"
    name, load = require_pair(_NAME, "by", by, expected)
    if as_text(load) != LOAD:
        raise BeamdaeError(f"{_NAME}: by must be {expected}, got {short_repr(by)}.")
    span = ParameterRange.of(_NAME, model, ("by", name), ("values", values), parameters)
    number = require_count(_NAME, "number", number, 1)
    step = require_positive(_NAME, "step", step)
    max_points = require_count(_NAME, "max_points", max_points, 2)
    path, messages = trace_critical_points(span.build(0.0), settings)
    for message in messages:
        warn_user(message)
    loads = require_one_stage(_NAME, path.loads)
    rows = [point.row for point in path.critical if point.kind == kind]
    if len(rows) < number:
        remedy = "; choose a farther target to=, or another kind"
        end = remedy if path.status.success else f": {path.status.sentence}"
        raise BeamdaeError(
            f"{_NAME}: the path for {name} = {span.first:g} has {len(rows)} of {number} points of "
            f"the kind {kind!r}{end}."
        )

    def load_model(share: float) -> LoadedEquations:
        mechanism = span.build(share)
        equations = equations_of_motion(mechanism, AS_DRAWN)
        return build_loading(mechanism, equations, list(loads), path.t).systems[0]

    points, special, status = list[_CurvePoint](), list[BoundaryPoint](), REACHED_END
    with single_threaded:
        family = create_family(load_model)
        row = rows[number - 1]
        first = family(0.0)[0].point_at(path.q[row], float(path.factors[row, -1]))
        follow_points = _follow_flutter if kind == FLUTTER else _follow_curve
        try:
            for point, passed in follow_points(family, kind, first, step):
                if len(points) == max_points:
                    status = Status(
                        "limited",
                        f"stopped at the maximum of {max_points} points; increase max_points",
                    )
                    break
                points.append(point)
                special += [
                    BoundaryPoint(x, span.value(one.share), one.factor) for x, one in passed
                ]
        except CurveError as error:
            status = Status("failed", str(error))
            points = points or [_CurvePoint(0.0, first.p, first.x, -1)]
    if not status.success:
        warn_of_incomplete_result(f"{_NAME}: {status.sentence}.")
    unstable = [point for point in points if point.unstable > 0]
    if unstable:
        warn_user(
            f"{_NAME}: {len(unstable)} of {len(points)} {kind}s lie on unstable paths (unstable "
            f"directions above 0), the first one at {span.describe(unstable[0].share)} with the "
            f"load factor {unstable[0].factor:.6g}; the structure leaves such a path at another "
            "critical point, so also follow other kinds and numbers."
        )
    return Boundary(
        kind,
        name,
        np.array([span.value(one.share) for one in points]),
        np.array([one.factor for one in points]),
        tuple(special),
        np.array([one.unstable for one in points]),
        np.array([one.x for one in points])[:, : path.equations.n],
        status,
        loads,
    )


class _CurvePoint(NamedTuple):
    """Share of the range of the parameter, load factor, static unknowns, unstable directions."""

    share: float
    factor: float
    x: Array
    unstable: int


# Points of a curve, and kinds and places of the special points before them.
_Points = Iterator[tuple[_CurvePoint, list[tuple[str, _CurvePoint]]]]


def _follow_curve(family: Family, kind: str, first: Point, step: float) -> _Points:
    """Yield limit or branch points along their curve, which ends at an end of the range."""
    curve = CriticalCurve(family, kind, first)

    def at(point: Point) -> _CurvePoint:
        x, factor = curve.state(point.x, point.p)
        return _CurvePoint(point.p, factor, x, point.monitor.divergent)

    def explain(segment: Segment) -> list[tuple[str, _CurvePoint]]:
        if not 0.0 <= segment.end.p <= 1.0:
            raise CurveError("the curve leaves the range of the parameter")
        found = []
        for one in explain_counts(segment, _RESOLUTION):
            special = CUSP if kind == LIMIT else TURNING
            if one.kind == BRANCH:
                is_hilltop = kind == LIMIT or curve.has_limit(one.point)
                special = HILLTOP if is_hilltop else DOUBLE
            found.append((special, at(one.point)))
        return found

    end = curve.correct(prescribe_parameter, 0.0, curve.first, 0.0)
    yield at(end), []
    tangent = end.tangent(prescribe_parameter)
    steps = Steps(CHANGE_SIZE * step, True, CHANGE_SIZE, step)
    target, previous = np.nan, tangent
    while end.p != target:
        target = 1.0 if tangent[-1] > 0.0 else 0.0
        for segment, found in follow(end, prescribe_parameter, target, steps, explain, tangent):
            end, previous, tangent = segment.end, tangent, segment.direction
            yield at(end), found
            if previous[-1] * tangent[-1] < 0.0:
                break


def _follow_flutter(family: Family, kind: str, first: Point, step: float) -> _Points:
    """Yield flutter points for values of the parameter in equal steps."""
    near, (_, last) = first, family(0.0)
    for share in np.linspace(0.0, 1.0, int(np.ceil(1.0 / step)) + 1).tolist():
        problem, reference = family(share)
        near, count = _locate_flutter(problem, reference + near.x - last, near.p)
        yield _CurvePoint(share, near.p, near.x, count), []
        last = reference


def _locate_flutter(problem: StaticProblem, x: Array, mu: float) -> tuple[Point, int]:
    """Return the flutter point nearest to a load factor, for the same parameter.

    The number of unstable directions on its stabler side follows.

    Raises
    ------
    CurveError
        If the number of growing oscillations does not change near this load factor, or an
        equilibrium is not found.
    """
    middle, width = problem.correct(prescribe_parameter, mu, x, mu), _WINDOW
    while width <= _MAX_WINDOW:
        low, high = mu * (1.0 - width), mu * (1.0 + width)
        begin = problem.correct(prescribe_parameter, low, middle.x, low)
        segments = list(
            follow(begin, prescribe_parameter, high, Steps(abs(high - low)), explain_counts)
        )
        flutter = [one.point for _, found in segments for one in found if one.kind == FLUTTER]
        if flutter:
            ends = begin.monitor.unstable, segments[-1][0].end.monitor.unstable
            return min(flutter, key=lambda point: abs(point.p - mu)), min(ends)
        width *= _WINDOW_GROWTH
    raise CurveError(f"no flutter point was found near the load factor {mu:.6g}; reduce step")
