"""Critical loads as a function of a parameter of the model: `bd.boundary`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.analysis.sensitivities.sensitivity_result import configure_model
from beamdae.analysis.statics.corrector import Corrector, CorrectorError, EquilibriumPoint
from beamdae.analysis.statics.critical_curves import CriticalCurve, CurvePoint, Family
from beamdae.analysis.statics.critical_points import BRANCH, FLUTTER, LIMIT
from beamdae.analysis.statics.load_scaling import LoadedEquations, build_loading
from beamdae.analysis.statics.path_controls import LoadControl
from beamdae.analysis.statics.stability import Stability
from beamdae.analysis.statics.static_equilibrium import trace_critical_points
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.errors import (
    BeamdaeError,
    as_real,
    as_text,
    record_warnings,
    require_choice,
    require_count,
    require_finite,
    require_pair,
    require_positive,
    short_repr,
    suggest,
    warn_of_incomplete_result,
    warn_user,
)
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_functions import Model, require_model_function
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.results.displays import HasPage, HasTable, Plot, load_views
from beamdae.results.equilibrium import UNSTABLE, Equilibrium
from beamdae.results.outcome import REACHED_END, Status

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_NAME = "boundary"
LOAD = "load"
CUSP, TURNING, HILLTOP, DOUBLE = "cusp", "turning point", "hilltop", "double branch point"

# Default step along a curve, see `boundary`.
_STEP = 0.05
_CUT_FACTOR = 0.5
_GROWTH_FACTOR = 2.0
# Angle between successive directions at which the step remains the same [rad].
_GROWTH_ANGLE = 0.3
_MIN_STEP_RATIO = 1e-4
# One step covers a remaining distance of up to this multiple of the step.
_LAST_STEP_RATIO = 1.2
# Smallest cosine of the angle between successive directions.
_MIN_COSINE = 0.8
# Accuracy of special points, relative to the step in which they lie.
_POSITION_TOLERANCE = 1e-6
# Largest distance between the points between which a hilltop is interpolated, relative to the step,
# and distances of enclosing points from an estimate, relative to the present enclosure.
_HILLTOP_WIDTH = 1e-2
_ENCLOSURE = (-0.03, 0.03)
# Work of the load in a mode, relative to the sum of its magnitudes, above which a mode has a limit.
_MIN_WORK = 1e-6
# Flutter loads: initial half width of the search, relative to the load factor; factor by which it
# grows; largest value; accuracy.
_WINDOW, _WINDOW_GROWTH, _MAX_WINDOW = 1e-3, 10.0, 1.0
_FLUTTER_TOLERANCE = 1e-8


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
        return load_views().plot_critical_loads(self)

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
        Largest step: the change of the parameter relative to its range, the motion relative to the
        motion from the drawing to the first point, or a fifth of the relative change of the load.
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
    require_model_function(_NAME, model)
    require_choice(_NAME, "kind", kind, (LIMIT, BRANCH, FLUTTER))
    name = _parse_parameter(model, by)
    model = configure_model(_NAME, model, parameters, name)
    limits = _parse_limits(values)
    number = require_count(_NAME, "number", number, 1)
    step = require_positive(_NAME, "step", step)
    max_points = require_count(_NAME, "max_points", max_points, 2)
    path, messages = trace_critical_points(model(**{name: limits[0]}), settings)
    for message in messages:
        warn_user(message)
    if len(path.loads) != 1:
        raise BeamdaeError(
            f"{_NAME}: loads must be one list of names, got {len(path.loads)} stages; name the "
            "loads to scale, and add a load if there is none."
        )
    rows = [point.row for point in path.critical if point.kind == kind]
    if len(rows) < number:
        remedy = "; choose a farther target to=, or another kind"
        end = remedy if path.status.success else f": {path.status.sentence}"
        raise BeamdaeError(
            f"{_NAME}: the path for {name} = {limits[0]:g} has {len(rows)} of {number} points of "
            f"the kind {kind!r}{end}."
        )

    def build(value: float) -> LoadedEquations:
        mechanism = model(**{name: value})
        equations = equations_of_motion(mechanism, AS_DRAWN)
        return build_loading(mechanism, equations, list(path.loads[0]), path.t).systems[0]

    family = Family(build)
    with single_threaded:
        follow = _follow_flutter if kind == FLUTTER else partial(_follow_curve, kind)
        first = _first_point(family, path, rows[number - 1], limits[0])
        points, special, status, counts = follow(family, first, limits, step, max_points)
        coordinates = [family.at(one.p).reference + one.u for one in points]
    if not status.success:
        warn_of_incomplete_result(f"{_NAME}: {status.sentence}.")
    unstable = np.array(counts)
    if np.any(unstable > 0):
        k = int(np.argmax(unstable > 0))
        warn_user(
            f"{_NAME}: {np.sum(unstable > 0)} of {len(points)} {kind}s lie on unstable paths "
            f"(unstable directions above 0), the first one at {name} = {points[k].p:.6g} with the "
            f"load factor {points[k].mu:.6g}; the structure leaves such a path at another critical "
            "point, so also follow other kinds and numbers."
        )
    return Boundary(
        kind,
        name,
        np.array([one.p for one in points]),
        np.array([one.mu for one in points]),
        tuple(special),
        unstable,
        np.array(coordinates)[:, : path.equations.n],
        status,
        path.loads[0],
    )


def _parse_parameter(model: Model, by: Any) -> str:
    """Return the name of the parameter."""
    expected = f"(name of a parameter, {LOAD!r})"
    name, load = (as_text(entry) for entry in require_pair(_NAME, "by", by, expected))
    if name is None or load != LOAD:
        raise BeamdaeError(f"{_NAME}: by must be {expected}, got {short_repr(by)}.")
    if as_real(model.parameters.get(name)) is None:
        numbers = [key for key, value in model.parameters.items() if as_real(value) is not None]
        raise BeamdaeError(
            f"{_NAME}: by names {short_repr(name)}, which is not a numeric parameter of "
            f"{model.name}{suggest(name, numbers)}; use one of its parameters "
            f"({', '.join(numbers) or 'none'})."
        )
    return name


def _parse_limits(values: Any) -> tuple[float, float]:
    expected = "(first, last) value of the parameter"
    pair = require_pair(_NAME, "values", values, expected)
    first, last = (require_finite(_NAME, "values", number) for number in pair)
    if first == last:
        raise BeamdaeError(f"{_NAME}: values must be {expected}, got {short_repr(values)}.")
    return first, last


def _first_point(family: Family, path: Equilibrium, row: int, value: float) -> CurvePoint:
    """Return the critical point of a path at `row`."""
    system, reference = family.at(value)
    lam = dict(zip(path.equations.lam_names, path.lam[row].tolist(), strict=True))
    x = np.append(path.q[row], [lam[name] for name in system.equations.lam_names])
    return CurvePoint(x - reference, float(path.factors[row, -1]), value)


_Curve = tuple[list[CurvePoint], list[BoundaryPoint], Status, list[int]]


def _follow_curve(
    kind: str,
    family: Family,
    first: CurvePoint,
    limits: tuple[float, float],
    step: float,
    max_points: int,
) -> _Curve:
    """Follow a limit or branch point along its curve."""
    curve = CriticalCurve(family, kind, limits, first)
    points, special = [first], list[BoundaryPoint]()
    counts = [_count_other_unstable(curve.equilibrium(first).stability)]
    sign = np.sign(limits[1] - limits[0])
    try:
        points = [curve.correct(first, curve.parameter_plane)]
        direction = curve.tangent(points[0], sign * curve.parameter_plane)
    except CorrectorError as error:
        return points, special, Status("failed", str(error)), counts
    low, high = sorted(limits)
    size = step
    while len(points) < max_points:
        begin = points[-1]
        rate = direction[-1] * (high - low)
        bound = high if rate > 0.0 else low
        # The last step ends at the limit of the parameter.
        is_last = abs(bound - begin.p) <= _LAST_STEP_RATIO * size * abs(rate)
        if is_last:
            size = abs(bound - begin.p) / abs(rate)
        plane = curve.parameter_plane if is_last else curve.plane(begin, direction)
        try:
            guess = curve.predict(begin, direction, size)
            if is_last:
                guess = guess._replace(p=bound)
            end = curve.correct(guess, plane)
            after = curve.tangent(end, curve.plane(begin, direction))
            cosine = curve.cosine(begin, after, direction)
            if cosine < _MIN_COSINE:
                raise CorrectorError("the curve turns too sharply for the step")
            segment = _Segment(curve, begin, end, direction, after, size)
            passed = list(segment.special_points())
        except CorrectorError as error:
            size *= _CUT_FACTOR
            if size < _MIN_STEP_RATIO * step:
                return points, special, Status("failed", str(error)), counts
            continue
        points.append(end)
        counts.append(_count_other_unstable(curve.equilibrium(end).stability))
        special += passed
        direction = after
        if is_last:
            return points, special, REACHED_END, counts
        growth = _GROWTH_ANGLE / max(
            float(np.arccos(min(cosine, 1.0))), _GROWTH_ANGLE / _GROWTH_FACTOR
        )
        size = min(growth * size, step)
    return points, special, _limited(points), counts


def _count_other_unstable(stability: Stability) -> int:
    """Return the number of unstable directions besides the critical one; -1 if it is unknown."""
    eigenvalues, count = stability.eigenvalues, stability.unstable_count
    if not len(eigenvalues) or count < 0:
        return -1
    critical = eigenvalues[np.argmin(np.abs(eigenvalues))]
    return count - int(critical < -stability.zero_tolerance)


def _limited(points: list[CurvePoint]) -> Status:
    return Status("limited", f"stopped at the maximum of {len(points)} points; increase max_points")


@dataclass(frozen=True)
class _Segment:
    """Step along a curve of critical points, with the directions and stabilities at its ends."""

    curve: CriticalCurve
    begin: CurvePoint
    end: CurvePoint
    before: Array
    after: Array
    size: float

    def point_at(self, size: float) -> CurvePoint:
        """Return the point at a distance from the beginning."""
        guess = self.curve.predict(self.begin, self.before, size)
        # The distance from the tangent grows with the square of the distance along it.
        last = self.curve.predict(self.begin, self.before, self.size)
        end, share = self.end, (size / self.size) ** 2
        guess = CurvePoint(
            guess.u + share * (end.u - last.u),
            guess.mu + share * (end.mu - last.mu),
            guess.p + share * (end.p - last.p),
        )
        return self.curve.correct(guess, self.curve.plane(self.begin, self.before))

    def special_points(self) -> Iterator[BoundaryPoint]:
        """Yield the special points inside the segment."""
        if self.before[-1] * self.after[-1] < 0.0:
            point = self._locate_extremum()
            kind = CUSP if self.curve.kind == LIMIT else TURNING
            yield BoundaryPoint(kind, point.p, point.mu)
        counts = [self._second_eigenvalue(point)[1] for point in (self.begin, self.end)]
        if counts[0] != counts[1]:
            yield self._locate_second_zero(counts[0])

    def _locate_extremum(self) -> CurvePoint:
        """Return the point at which the parameter has an extremum."""
        known = {0.0: self.before[-1], self.size: self.after[-1]}
        plane = self.curve.plane(self.begin, self.before)

        def rate(size: float) -> float:
            if size in known:
                return float(known[size])
            return float(self.curve.tangent(self.point_at(size), plane)[-1])

        # Imported here because it takes longer than most equilibria, which import this module, too.
        from scipy.optimize import brentq

        tolerance = _POSITION_TOLERANCE * self.size
        return self.point_at(float(brentq(rate, 0.0, self.size, xtol=tolerance)))

    def _second_eigenvalue(self, point: CurvePoint) -> tuple[float, int]:
        """Return the second smallest eigenvalue by magnitude, and the number of negative ones.

        The smallest one, which is critical, is not counted. Without a potential, both are 0.
        """
        stability = self.curve.equilibrium(point).stability
        order = np.argsort(np.abs(stability.eigenvalues))
        if len(order) < 2:
            return 0.0, 0
        critical, second = stability.eigenvalues[order[:2]]
        return float(second), stability.negative_count - int(critical < 0.0)

    def _locate_second_zero(self, count: int) -> BoundaryPoint:
        """Return the point where a second eigenvalue is zero; `count` are negative before it."""

        def signed(point: CurvePoint) -> float:
            second, negative = self._second_eigenvalue(point)
            return abs(second) if negative == count else -abs(second)

        # The extended system is singular at the point, which is therefore enclosed from both sides
        # by samples that are not too close to it.
        sizes, points = [0.0, self.size], [self.begin, self.end]
        values = [signed(point) for point in points]
        while sizes[-1] - sizes[0] > _HILLTOP_WIDTH * self.size:
            width, share = sizes[-1] - sizes[0], values[0] / (values[0] - values[-1])
            inner = [sizes[0] + width * float(np.clip(share + d, 0.0, 1.0)) for d in _ENCLOSURE]
            inner_points = [self.point_at(size) for size in inner]
            sizes[1:1], points[1:1] = inner, inner_points
            values[1:1] = [signed(point) for point in inner_points]
            k = next(k for k in range(len(sizes) - 1) if values[k + 1] < 0.0)
            enclosure = slice(k, k + 2)
            sizes, points, values = sizes[enclosure], points[enclosure], values[enclosure]
        (one, other), share = points, values[0] / (values[0] - values[1])
        kind = HILLTOP
        if self.curve.kind == BRANCH and not self._has_limit(one):
            kind = DOUBLE
        p, mu = ((1.0 - share) * a + share * b for a, b in ((one.p, other.p), (one.mu, other.mu)))
        return BoundaryPoint(kind, float(p), float(mu))

    def _has_limit(self, point: CurvePoint) -> bool:
        """Return True if the load does work in one of the two softest modes."""
        equilibrium = self.curve.equilibrium(point)
        stability, n = equilibrium.stability, equilibrium.system.equations.n
        load = equilibrium.system.residual(equilibrium.x, equilibrium.mu)[1][:n]
        order = np.argsort(np.abs(stability.eigenvalues))[:2]
        work = load @ stability.modes[:, order]
        # Relative to the largest motion, because an axial load moves with bending modes of a
        # straight column by rounding alone.
        scales = equilibrium.system.equations.position_scales
        motion = np.max(np.abs(stability.modes[:, order]) / scales[:, None], axis=0)
        size = (np.abs(load) @ scales) * motion
        return bool(np.any(np.abs(work) > _MIN_WORK * size))


def _follow_flutter(
    family: Family,
    first: CurvePoint,
    limits: tuple[float, float],
    step: float,
    max_points: int,
) -> _Curve:
    """Locate flutter points for values of the parameter in equal steps."""
    count = int(np.ceil(1.0 / step)) + 1
    points: list[CurvePoint] = []
    counts: list[int] = []
    for p in np.linspace(*limits, count).tolist():
        if len(points) >= max_points:
            return points, [], _limited(points), counts
        # Linear extrapolation of displacements and load factor.
        guess = first
        if len(points) > 1:
            a, b = points[-2:]
            guess = CurvePoint(2.0 * b.u - a.u, 2.0 * b.mu - a.mu, p)
        elif points:
            guess = points[-1]
        try:
            point, count_before = _locate_flutter(family, guess._replace(p=p))
        except CorrectorError as error:
            status = Status("failed", f"at the value {p:g} of the parameter, {error}")
            return points, [], status, counts
        points.append(point)
        counts.append(count_before)
    return points, [], REACHED_END, counts


def _locate_flutter(family: Family, guess: CurvePoint) -> tuple[CurvePoint, int]:
    """Return the flutter point nearest to the load factor of `guess`, for the same parameter.

    The number of unstable directions on its stabler side follows.

    Raises
    ------
    CorrectorError
        If the number of growing oscillations does not change near this load factor, or an
        equilibrium is not found.
    """
    system, reference = family.at(guess.p)
    corrector = Corrector(system)
    near = EquilibriumPoint(system, reference + guess.u, guess.mu)
    stabilities: dict[float, Stability] = {}

    def count(mu: float) -> int:
        nonlocal near
        if mu not in stabilities:
            near = corrector.correct(LoadControl(), mu, near.x, mu)
            stabilities[mu] = near.stability
        return stabilities[mu].oscillation_count

    width = _WINDOW
    low, high = guess.mu, guess.mu
    while count(low) == count(high):
        if width > _MAX_WINDOW:
            raise CorrectorError(
                f"no flutter point was found near the load factor {guess.mu:.6g}; reduce step"
            )
        low, high = guess.mu * (1.0 - width), guess.mu * (1.0 + width)
        width *= _WINDOW_GROWTH
    while abs(high - low) > _FLUTTER_TOLERANCE * abs(guess.mu):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if count(middle) == count(low) else (low, middle)
    end = corrector.correct(LoadControl(), high, near.x, high)
    unstable = min(stabilities[low].unstable_count, stabilities[high].unstable_count)
    return CurvePoint(end.x - reference, 0.5 * (low + high), guess.p), unstable
