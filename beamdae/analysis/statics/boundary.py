"""Critical loads as a function of a parameter of the model: `bd.boundary`.

A critical point solves F(x, mu, p) = 0, g = 0, where F_x is singular if and only if g is zero. At a
branch point, F_mu is in the range of F_x, too: t is zero. Both follow from F_x bordered by its
softest mode c (Griewank & Reddien, SIAM J. Numer. Anal. 21 (1984) 176; Govaerts, Numerical Methods
for Bifurcations of Dynamical Equilibria, SIAM (2000)):

    [F_x c; c^T 0] [v z; g t] = [0 -F_mu; 1 0],   [F_x c; c^T 0]^T [w; g] = [0; 1],
    dg = -w^T dF_x v,   dt = -w^T (dF_x z + dF_mu).

The equations of branch points contain a multiple of c as a further force, which is zero for
symmetric structures (Moore, Numer. Funct. Anal. Optim. 2 (1980) 441).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae import deferred
from beamdae.analysis.continuation.critical import (
    BRANCH,
    FLUTTER,
    LIMIT,
    Count,
    critical_modes,
    explain_counts,
)
from beamdae.analysis.continuation.engine import (
    CurveError,
    Linearization,
    Point,
    Problem,
    Segment,
    Steps,
    factorize_bordered,
    follow,
    prescribe_parameter,
)
from beamdae.analysis.parameter_range import ParameterRange
from beamdae.analysis.statics.load_scaling import build_loading, require_one_stage
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

# Size of a change of the parameter by its range, or of motion and load factor by five times those
# at the first point: small, because rounding errors of solutions are measured in these sizes, too.
_CHANGE_SIZE = 0.05
_RELATIVE_CHANGE = 0.2 * _CHANGE_SIZE
# Smallest motion, in natural sizes, to which others are relative: rounding errors are not measured.
_MIN_MOTION = 1e-6
# Differences of the tangent along a motion, in natural sizes: near the cube root of rounding, since
# places where the curve turns have relative errors of its square.
_DIFFERENCE = 1e-5
# Grid of shares of the range on which the equations are differenced, for the convergence only.
_GRID = 2.0**-10
# Work of the load in a mode, relative to its largest value, above which a mode has a limit.
_MIN_WORK = 1e-6
# Multiple of c, in natural sizes, up to which it is a rounding error.
_MAX_FORCE = 1e-12
# Models kept for parameters that are evaluated again.
_MAX_MODELS = 8
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
    branch points are followed by arc length as solutions of an extended system, so that a curve
    can reverse at a cusp. Branch points are those of symmetric structures. Flutter points are
    located for values of the parameter in equal steps, by bisection with the stability of the
    linearized motion, see `equilibrium`.

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
        mode, if this is not known because the forces have no potential, and as in `equilibrium` for
        the first path, except about its end.

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

    points, special, status = list[_CurvePoint](), list[BoundaryPoint](), REACHED_END
    with single_threaded:
        family = _create_family(span, list(loads), path.t)
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
    # The only point of a curve that fails at its begin is not counted under any loads.
    if any(point.unstable < 0 for point in points[1:]):
        warn_user(
            f"{_NAME}: under loads without a potential, unstable directions are not counted, so "
            "that other critical points may come before these; compare with equilibrium at some "
            f"values of {name}."
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


def _follow_curve(family: _Family, kind: str, first: Point, step: float) -> _Points:
    """Yield limit or branch points along their curve, which ends at an end of the range."""
    curve = _CriticalCurve(family, kind, first)

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
    steps = Steps(_CHANGE_SIZE * step, True, _CHANGE_SIZE, step)
    target, previous = np.nan, tangent
    while end.p != target:
        target = 1.0 if tangent[-1] > 0.0 else 0.0
        for segment, found in follow(end, prescribe_parameter, target, steps, explain, tangent):
            end, previous, tangent = segment.end, tangent, segment.direction
            yield at(end), found
            if previous[-1] * tangent[-1] < 0.0:
                break


def _follow_flutter(family: _Family, kind: str, first: Point, step: float) -> _Points:
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


class _Equations(NamedTuple):
    """F, F_mu and F_x in natural sizes."""

    residual: Array
    by_factor: Array
    stiffness: sp.csc_array


# Static equations, and the unknowns (n + m,) of the drawing, for shares of a range.
_Family = Callable[[float], tuple[StaticProblem, Array]]


def _create_family(span: ParameterRange, loads: list[str], t: float) -> _Family:
    """Return static equations as a function of the share of the range of a parameter.

    It raises CurveError if a model cannot be built, or has another number of unknowns.
    """

    @lru_cache(_MAX_MODELS)
    def at(share: float) -> tuple[StaticProblem, Array]:
        try:
            mechanism = span.build(share)
            equations = equations_of_motion(mechanism, AS_DRAWN)
            problem = StaticProblem(build_loading(mechanism, equations, loads, t).systems[0])
        except BeamdaeError as error:
            raise CurveError(f"the model cannot be built ({error})") from None
        reference = problem.start(problem.system.equations.q0)
        if share and len(reference) != len(at(0.0)[1]):
            raise CurveError("the parameter changes the number of coordinates or joints")
        return problem, reference

    return at


class _CriticalCurve(Problem):
    """Equations of limit or branch points for the curve engine; the parameter is a share.

    The unknowns are the displacements from the drawing (n + m,) in natural sizes, the load factor
    and, for branch points, the multiple of c.

    Parameters
    ----------
    family
        Static equations as a function of the parameter.
    kind
        `LIMIT` or `BRANCH`.
    first
        Critical point of the first member.
    """

    def __init__(self, family: _Family, kind: str, first: Point) -> None:
        self.family, self.kind = family, kind
        problem, reference = family(0.0)
        self._scales, self._n, self._size = problem.scales, problem.n, len(reference)
        self._energy = abs(problem.matrix(first.x, first.p)).max()
        self._first_mode = (critical_modes(first)[:, 0] / self._scales)[: self._n]
        u, weights = (first.x - reference) / self._scales, problem.weights * self._scales
        self.first = np.append(u, [first.p, 0.0][: 1 + (kind == BRANCH)])
        self._weights = np.zeros_like(self.first)
        motion = max(np.max(np.abs(u * weights)), _MIN_MOTION)
        self._weights[: self._size] = _RELATIVE_CHANGE / motion * weights
        self._weights[self._size] = _RELATIVE_CHANGE / (abs(first.p) or 1.0)

    @property
    def weights(self) -> Array:
        """Inverse natural sizes of the unknowns, and 0 for multipliers."""
        return self._weights

    def state(self, x: Array, share: float) -> tuple[Array, float]:
        """Return the static unknowns (n + m,) and the load factor."""
        u = x[: self._size]
        return self.family(share)[1] + self._scales * u, float(x[self._size])

    def _evaluate(self, x: Array, share: float) -> _Equations:
        problem, _ = self.family(share)
        state, sizes = self.state(x, share), self._scales / self._energy
        residual, by_factor = problem.residual(*state)
        own = self._scales / problem.scales
        stiffness = sp.csc_array(problem.matrix(*state) * own * own[:, None] / self._energy)
        return _Equations(sizes * residual, sizes * by_factor, stiffness)

    def _border(self, stiffness: sp.csc_array) -> tuple[Array, Any]:
        """Return the softest mode (n + m,) and factors of the stiffness bordered by it.

        It contains no multipliers, which may far exceed the coordinates of the mode.
        """
        border, end = np.zeros(self._size), np.append(np.zeros(self._size), 1.0)
        border[: self._n] = self._first_mode
        mode = factorize_bordered(stiffness, border, border).solve(end)[: self._n]
        border[: self._n] = mode / np.linalg.norm(mode)
        return border, factorize_bordered(stiffness, border, border)

    def linearize(self, x: Array, p: float, last: Any = None) -> Linearization:
        """Return the equations, linearized about a point."""
        here, n, is_branch = self._evaluate(x, p), self._size, self.kind == BRANCH
        # Toward the middle, because no model may exist beyond the ends of the range.
        beside = _GRID * float(np.round(p / _GRID + np.copysign(0.75, 0.5 - p)))
        near, shift = self._evaluate(x, beside), beside - p
        unit = np.zeros_like(x)
        unit[n] = 1.0
        # The tangent is linear in the load factor.
        by_factor = self._evaluate(x + unit, p).stiffness - here.stiffness
        mode, factors = self._border(here.stiffness)
        end = np.append(np.zeros(n), 1.0)
        left = factors.solve(end, "T")[:n]
        residual, column = here.residual, here.by_factor[:, None]
        rights = [(end, 0.0)]
        if is_branch:
            residual, column = residual + x[n + 1] * mode, np.stack([here.by_factor, mode], axis=1)
            rights.append((np.append(-here.by_factor, 0.0), 1.0))
        tests, rows, rates = [], [], []
        for right, along_load in rights:
            solution = factors.solve(right)
            motion = solution[:n]
            step = along_load * unit
            step[:n] = motion
            size = _DIFFERENCE / np.max(np.abs(motion[: self._n]))
            ahead, behind = (self._evaluate(x + d * step, p).stiffness for d in (size, -size))
            by_x = -left @ (ahead - behind) / (2.0 * size)
            rows.append(np.append(by_x, [-left @ by_factor @ motion, 0.0][: 1 + is_branch]))
            change = (near.stiffness - here.stiffness) @ motion
            rates.append(-left @ (change + along_load * (near.by_factor - here.by_factor)) / shift)
            tests.append(solution[-1])
        jacobian = sp.vstack([sp.hstack([here.stiffness, column]), np.array(rows)])
        return Linearization(
            np.append(residual, tests),
            np.append((near.residual - here.residual) / shift, rates),
            sp.csc_array(jacobian),
        )

    def _second_mode(self, point: Point) -> tuple[int, float]:
        """Return the number of negative eigenvalues and the work of the load in the softest mode.

        The critical mode is excluded, and the work is relative to its largest value.
        """
        equations = self._evaluate(point.x, point.p)
        border = sp.csc_array(self._border(equations.stiffness)[0][:, None])
        bordered = sp.block_array([[equations.stiffness, border], [border.T, None]])
        values, vectors = np.linalg.eigh(bordered.toarray())
        mode = vectors[: self._n, np.argmin(np.abs(values))]
        load = equations.by_factor[: self._n]
        size = max(np.linalg.norm(load) * np.linalg.norm(mode), np.finfo(float).tiny)
        return int(np.sum(values < 0.0)) - self._size + self._n - 1, abs(load @ mode) / size

    def has_limit(self, point: Point) -> bool:
        """Return True if the load does work in the softest mode besides the critical one."""
        return self._second_mode(point)[1] > _MIN_WORK

    def monitor(self, point: Point) -> Count:
        """Return the number of unstable directions besides the critical one; -1 if unknown.

        Raises
        ------
        CurveError
            If a branch point requires a further force.
        """
        if self.kind == BRANCH and abs(point.x[-1]) > _MAX_FORCE:
            raise CurveError("the structure loses its symmetry, and the branch point vanishes")
        signs = self.family(point.p)[0].signs(*self.state(point.x, point.p))
        return Count(self._second_mode(point)[0] if signs.is_symmetric else -1, 0)
