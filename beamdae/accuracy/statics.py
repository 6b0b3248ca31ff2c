"""Errors of equilibria, critical points and buckling loads, measured by refined equations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from beamdae.accuracy.errors import (
    CAUSES_AT_REST,
    FACTOR,
    Errors,
    MissingStateError,
    Refined,
    measure_errors,
)
from beamdae.accuracy.refinement import Refinement, refine
from beamdae.analysis.continuation.engine import (
    ArcLength,
    Control,
    CurveError,
    Point,
    prescribe_parameter,
)
from beamdae.analysis.statics.linear_buckling import Buckling, repeat_buckling
from beamdae.analysis.statics.load_scaling import (
    Loading,
    active_stage,
    build_loading,
    vary_parameter,
)
from beamdae.analysis.statics.neutral_motions import hold_neutral_motions
from beamdae.analysis.statics.path_parameters import quantity_units, resolve_parameter
from beamdae.analysis.statics.path_settings import PathSettings, PrescribedColumn
from beamdae.analysis.statics.paths import (
    EquilibriumPath,
    tabulate_points,
    trace_path,
)
from beamdae.analysis.statics.static_problem import StaticProblem
from beamdae.beams.beam import Beam, beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion, format_headers
from beamdae.errors import BeamdaeError, hold_messages
from beamdae.interrupts import Interrupted
from beamdae.linear.blas_threads import single_threaded
from beamdae.parts.signals import Sensor
from beamdae.results.columns import Header, is_position, largest_by
from beamdae.results.equilibrium import FACTOR as LOAD_FACTOR
from beamdae.results.equilibrium import UNSTABLE, Equilibrium
from beamdae.results.noise import (
    mark_resting_columns,
    mark_vanishing_columns,
    rounding_limits,
)
from beamdae.results.outcome import REACHED_END
from beamdae.results.section_forces.section_forces import SectionForces
from beamdae.symbolic.statements import Quantity

Array = np.ndarray
Values = dict[str, float]

# The companion takes steps of similar size: more points are a path to another place.
_MAX_POINTS_RATIO, _MORE_POINTS = 3, 20
# Ends of one path by different searches are closer than this share of the changes of coordinates.
_SAME_END = 1e-3
# Extremes of columns between both ends of a path exceed the ends by this share of their scale.
_MIN_EXCESS = 1e-3
_SECTIONS = 9  # of a beam, for its largest section forces


class _Repetition(NamedTuple):
    """Refined values (columns,) or (columns, places), and the path that they belong to.

    Values that are not a number do not exist or, if the path was not traced, are not known.
    """

    values: Array
    path: Equilibrium | None = None
    is_traced: bool = True


def measure_equilibrium(path: Equilibrium) -> Errors:
    """Return the errors of a path of equilibria.

    They are those of the observed columns at its end and at their extremes, of its number of
    unstable directions, and of the load factors of its critical points and, if a position is
    prescribed or the path failed, of its end. Errors of columns are relative to their range along
    the path or, for section forces, to their largest value along the beam if it is larger, that of
    the end to the largest load factor of the refined path. A critical point that the refined path
    does not have is an error of more than 100 %.
    """
    values = _list_values(path)
    headers, sizes = tuple(values), np.array(list(values.values()))
    reason = _find_obstacle(path)
    if reason or not values:
        return Errors.unchecked(headers, sizes, reason or "the path ended early")
    if not beams_of(path.equations.mechanism):
        return Errors.of_values(headers, sizes, sizes, Refined())
    scales = _find_scales(path)
    extremes = [x for x in _find_extremes(path, scales) if x[0] in values]

    def repeat(refinement: Refinement) -> _Repetition:
        refined_path = _RefinedPath(path, refinement)
        companion, is_traced = refined_path.repeat()
        scales.setdefault(path.header, float(np.max(np.abs(companion.factors), initial=0.0)))
        at_extremes = refined_path.repeat_extremes(extremes)
        places = _place(headers, _list_values(companion), at_extremes)
        return _Repetition(places, companion, is_traced)

    at_rows = [(x, place, path.columns[x][row]) for x, place, row in extremes]
    errors = _measure(path.equations, headers, _place(headers, values, at_rows), repeat, scales)
    of_columns = [x for x in headers if x in path.columns]
    half = np.nan_to_num(0.5 * np.array([scales[x] for x in of_columns]), posinf=0.0)
    changes = 2.0 * half * errors.select(of_columns).total / FACTOR
    vanishes = mark_vanishing_columns(of_columns, half, changes, path.equations.length)
    is_noise = np.isin(headers, np.array(of_columns)[vanishes])
    return replace(errors, total=np.where(is_noise, 0.0, errors.total))


def _place(
    headers: tuple[str, ...], ends: Values, extremes: Iterable[tuple[str, int, float]]
) -> Array:
    """Return the values at the end of a path and at extremes of columns, (columns, 3)."""
    places = np.full((len(headers), 3), np.nan)
    places[:, 0] = [ends.get(x, np.nan) for x in headers]
    for header, place, value in extremes:
        places[headers.index(header), place] = value
    return places


def measure_buckling(result: Buckling) -> Errors:
    """Return the errors of the load factors of linear buckling."""
    headers = tuple(f"load factor of mode {k + 1} [-]" for k in range(len(result)))

    def repeat(refinement: Refinement) -> _Repetition:
        q, found = refinement.prolong(result.q), np.full(len(headers), np.nan)
        factors = repeat_buckling(result, refinement.equations, q)[: len(found)]
        found[: len(factors)] = factors
        return _Repetition(found)

    return _measure(result.equations, headers, result.factors, repeat, {})


def check_equilibrium(path: Equilibrium) -> Iterator[str]:
    """Yield the sentences of the errors of a path, and one if its stability is not decided."""
    errors = path.errors
    yield from errors.select(set(errors.headers) - {UNSTABLE}).sentences()
    counts = dict(zip(errors.headers, np.stack([errors.values, errors.companions], 1), strict=True))
    count, refined = counts.get(UNSTABLE, (0, 0))
    if np.isfinite(refined) and count != refined:
        yield (
            f"equilibrium: the stability at {path.quantity} {path.factor:.6g} is not decided, "
            f"because the number of unstable directions is {count:g}, but {refined:g} in "
            f"{errors.refined}; use more elements."
        )


def _measure(
    equations: EquationsOfMotion,
    headers: tuple[str, ...],
    values: Array,
    repeat: Callable[[Refinement], _Repetition],
    scales: Values,
) -> Errors:
    """Return the errors of values that `repeat` computes for refined equations.

    Values without a scale are compared with themselves.
    """
    headlines = np.atleast_2d(values.T)[0]
    sizes, result = np.abs(headlines), _Repetition(values)

    def repeat_values(causes: Collection[str]) -> tuple[_Repetition, Refined]:
        nonlocal sizes
        with hold_messages(), single_threaded:
            refinement = refine(equations, causes=CAUSES_AT_REST.intersection(causes))
            if not refinement.refined.causes:
                raise BeamdaeError("no beam can be refined.")
            others = repeat(refinement)
        if "theory" in causes:
            refined_values = np.atleast_2d(others.values.T)[0]
            sizes = np.abs(np.where(np.isnan(refined_values), headlines, refined_values))
            sizes = np.array([scales.get(x, y) for x, y in zip(headers, sizes, strict=True)])
        return others, refinement.refined

    def compare(first: _Repetition, second: _Repetition, refined: Refined) -> Errors:
        errors = Errors.of_values(
            headers, first.values, second.values, refined, sizes, "its largest value"
        )
        one = np.isnan(errors.values) & first.is_traced
        other = np.isnan(errors.companions) & second.is_traced
        return replace(errors, total=np.where(one | other, FACTOR * (one != other), errors.total))

    unchecked = Errors.unchecked(headers, headlines, "the refined result is not found")
    return measure_errors(unchecked, result, repeat_values, compare, (BeamdaeError, CurveError))


def _find_obstacle(path: Equilibrium) -> str:
    if path.equations.mechanism is None:
        return "equations have no elements"
    if not path.status.success and _varies_model(path):
        return "a path over a parameter of the model ended early"
    return "the path was interrupted" if path.status.kind == "interrupted" else ""


def _varies_model(path: Equilibrium) -> bool:
    """Return True for paths over a parameter of a model, which refined equations do not have."""
    over = path.settings.get("over")
    return bool(over) and over not in quantity_units(None, path.equations.mechanism)


def _list_values(path: Equilibrium) -> Values:
    """Return the values at the end of a path, and those of its critical points, by header."""
    values: Values = {}
    if path.status.success:
        values = {x: float(y[-1]) for x, y in path.columns.items() if np.isfinite(y[-1])}
    is_sought = path.status.success and isinstance(path.settings["to"], dict)
    if is_sought or path.status.kind == "failed":
        values[path.header] = path.factor
    if path.status.success and path.unstable[-1] >= 0 and not _ends_critically(path):
        values[UNSTABLE] = float(path.unstable[-1])
    unit, counts = Header.of(path.over or LOAD_FACTOR).unit, Counter[str]()
    for one in path.critical:
        counts[one.kind] += 1
        values[f"{one.kind} {counts[one.kind]} [{unit}]"] = one.factor
    return values


def _ends_critically(path: Equilibrium) -> bool:
    return any(x.row == len(path.q) - 1 for x in path.critical)


def _find_scales(path: Equilibrium) -> Values:
    """Return the sizes to which errors of columns are relative; inf for rounding errors."""
    e = path.equations
    first = replace(
        path, q=np.vstack([e.q0, path.q[:1]]), lam=path.lam[[0, 0]], times=None, numbers=None
    )
    headers = list(path.columns)
    rows = np.array([np.append(first.columns[x][0], path.columns[x]) for x in headers]).T
    if not len(rows):
        return {}
    sizes = np.where(
        [is_position(x) for x in headers], np.ptp(rows, axis=0), np.max(np.abs(rows[1:]), axis=0)
    )
    reactions = 0.5 * np.max(np.abs(path.lam), axis=0)
    forces = largest_by([x.unit for x in e.multipliers], reactions.tolist())
    is_noise = mark_resting_columns(headers, rows, 0.5 * sizes, e.length, others=forces)
    is_noise |= 0.5 * sizes <= rounding_limits(e, headers)
    scales = dict(zip(headers, np.where(is_noise, np.inf, sizes).tolist(), strict=True))
    for header, size in _measure_sections(path):
        scales[header] = max(scales[header], size)
    return scales


def _find_extremes(path: Equilibrium, scales: Values) -> Iterator[tuple[str, int, int]]:
    """Yield columns with an extreme between both ends, its place among the values, and its row."""
    for header, x in path.columns.items():
        size = scales[header]
        for place, row in ((1, int(np.argmin(x))), (2, int(np.argmax(x)))):
            excess = min(abs(x[row] - x[0]), abs(x[row] - x[-1]))
            if excess > _MIN_EXCESS * size:
                yield header, place, row


def _measure_sections(path: Equilibrium) -> Iterator[tuple[str, float]]:
    """Yield headers of section forces, strains and stresses, and largest values on the beam."""
    mechanism = path.equations.mechanism
    assert mechanism is not None

    @cache
    def forces_along(beam: Beam) -> SectionForces:
        return path.section_forces(beam, np.linspace(0.0, beam.length, _SECTIONS))

    for name, observed in mechanism.observables.items():
        quantity, names = _measured_quantity(observed)
        beam = Beam._of_strains(quantity)
        if beam is None:
            continue
        forces = forces_along(beam)
        rows = np.concatenate([forces.N, forces.Q, forces.M])
        values = Beam._values_of_section_forces(quantity, rows, forces.s.tolist())
        largest = np.abs(values).max(axis=-1)
        of_column = dict(zip((x.name for x in quantity.columns), largest.tolist(), strict=True))
        for header, column in zip(format_headers(name, observed.columns), names, strict=True):
            yield header, of_column[column]


def _measured_quantity(observed: Quantity) -> tuple[Quantity, tuple[str, ...]]:
    """Return a quantity and the names of its observed columns; sensors measure one of them."""
    recipe = observed.recipe
    sensor = recipe.arguments[0] if recipe is not None and recipe.arguments else None
    if isinstance(sensor, Sensor):
        return sensor.of, (sensor.of.columns[sensor.column].name,)
    return observed, tuple(column.name for column in observed.columns)


def refine_end(path: Equilibrium, refinement: Refinement) -> Equilibrium:
    """Return the refined equilibrium near the end of a path.

    Raises
    ------
    MissingStateError
        If it is not found.
    """
    refined_path = _RefinedPath(path, refinement)
    end = refined_path._correct_row(-1)
    if end is None:
        raise MissingStateError("there is no such equilibrium with refined beams.")
    return refined_path._as_equilibrium([end])


@dataclass(frozen=True, eq=False)
class _RefinedPath:
    """Path of equilibria, and the refined equations in which it is repeated."""

    path: Equilibrium
    refinement: Refinement

    @cached_property
    def loading(self) -> Loading:
        """Refined equations with the loads of the path."""
        path, equations = self.path, self.refinement.equations
        over, mechanism = path.settings.get("over"), equations.mechanism
        # A parameter of a model is constant at the end of its path, under all loads.
        if not over or _varies_model(path):
            return build_loading(mechanism, equations, [list(x) for x in path.loads], path.t)
        begin, target = float(path.factors[0, 0]), path.settings["to"][-1]
        parameter = resolve_parameter(mechanism, equations, over, begin, target, path.t)
        return vary_parameter(parameter.equations_at(begin), parameter)

    @cached_property
    def settings(self) -> PathSettings:
        """Settings of the path."""
        arguments = {x: y for x, y in self.path.settings.items() if x != "iterations"}
        count = _MAX_POINTS_RATIO * len(self.path.q) + _MORE_POINTS
        return PathSettings.from_arguments(**arguments, max_points=count)

    @property
    def is_whole(self) -> bool:
        """False for paths over a parameter of a model, and rows of longer paths."""
        path, settings = self.path, self.settings
        if _varies_model(path):
            return False
        if settings.column or not path.status.success or not path.factors.shape[1]:
            return True
        target = settings.targets[-1]
        return abs(path.factor - target) <= 1e-9 * abs(target)

    def repeat(self) -> tuple[Equilibrium, bool]:
        """Return the refined path, and True if all of its critical points are known.

        Its end is sought near that of the path. The whole path is traced if it has critical points
        or ended early, or if its end is not found or has other unstable directions.

        Raises
        ------
        BeamdaeError
            If the refined path does not begin; a `MissingStateError` if it leads to another end.
        """
        path, settings, status = self.path, self.settings, REACHED_END
        end = self._correct_row(-1) if path.status.success else None
        is_near = end is not None and (
            _ends_critically(path) or end.monitor.unstable == path.unstable[-1]
        )
        if self.is_whole and (path.critical or not is_near):
            start = self.refinement.prolong(path.q[0])
            # The refined path may switch to the mirrored branch.
            for sign in (1, -1) if settings.switch else (1,):
                switch = tuple(sign * x for x in settings.switch)
                traced = trace_path(self.loading, start, replace(settings, switch=switch))
                status = traced.status
                if status.kind == "interrupted":
                    raise Interrupted(status.sentence)
                is_same = end is None or self._are_same(end, traced.points[-1])
                if (is_same or not settings.switch) and (status.success or not path.status.success):
                    return self._as_equilibrium(traced.points, traced), True
        if end is None or not is_near:
            reason = "leads elsewhere" if status.success else f"ends early ({status.sentence})"
            raise MissingStateError(f"with refined beams, the path {reason}.")
        return self._as_equilibrium([end]), self.is_whole

    def repeat_extremes(
        self, extremes: list[tuple[str, int, int]]
    ) -> Iterator[tuple[str, int, float]]:
        """Yield columns, their places, and the refined values at extremes of the path."""
        if _varies_model(self.path):
            return

        @cache
        def columns_of(row: int) -> Mapping[str, Array]:
            point = self._correct_row(row)
            return {} if point is None else self._as_equilibrium([point], row=row).columns

        for header, place, row in extremes:
            if header in columns_of(row):
                yield header, place, float(columns_of(row)[header][0])

    def _correct_row(self, row: int) -> Point | None:
        """Return the refined equilibrium near a row of the path, or None if it is not found.

        That near the end, the row -1, has the same load factor or prescribed position, others are
        beside the path.
        """
        path, settings, refinement = self.path, self.settings, self.refinement
        stage, mu = active_stage(path.factors[row]), path.factor
        if path.factors.shape[1]:
            mu = float(path.factors[row, stage])
        system = self.loading.systems[stage]
        lam = dict(zip(path.equations.lam_names, path.lam[row].tolist(), strict=True))
        x = np.append(
            refinement.prolong(path.q[row]),
            [lam.get(name, 0.0) for name in system.equations.lam_names],
        )
        problem = StaticProblem(system)
        x = problem.start(x)
        if path.free and system.has_scaled_loads:
            problem = hold_neutral_motions(problem.point(x, mu)).problem
        control: Control = prescribe_parameter
        target = mu
        if row != -1:
            motion = refinement.prolongation @ (path.q[row + 1] - path.q[row - 1])
            tangent, weights = (np.append(y, 0.0) for y in (problem.start(motion), problem.weights))
            control, target = ArcLength(problem.point(x, mu), tangent, weights), 0.0
        elif settings.column:
            control, coarse = (
                PrescribedColumn.from_name(e, settings.column, system.loaded.time)
                for e in (refinement.equations, path.equations)
            )
            target = coarse(path.q[-1], mu).value
        try:
            return problem.correct(control, target, x, mu)
        except CurveError:
            return None

    def _as_equilibrium(
        self, points: list[Point], traced: EquilibriumPath | None = None, row: int = -1
    ) -> Equilibrium:
        """Return refined points as a result with the loads of the path at a row.

        Critical points are those up to the first one of another kind.
        """
        path = self.path
        factors = path.factors[[row]]
        factors[:, active_stage(path.factors[row]) :][:, :1] = points[-1].p
        refined = () if traced is None else traced.critical
        pairs = zip(path.critical, refined, strict=False)
        return replace(
            path,
            equations=self.loading.full_equations,
            factors=factors if traced is None else traced.factors,
            unstable=np.full(len(points), points[-1].monitor.unstable),
            critical=tuple(y for _, y in takewhile(lambda x: x[0].kind == x[1].kind, pairs)),
            **tabulate_points(self.loading, points),
        )

    def _are_same(self, end: Point, traced: Point) -> bool:
        """Return False if a traced path leads to another end, as that of a mirrored branch."""
        path, n = self.path, self.refinement.equations.n
        scale = self.refinement.equations.position_scales
        motion = (self.refinement.prolongation @ (path.q[-1] - path.q[0])) / scale
        difference = np.abs(end.x[:n] - traced.x[:n]) / scale
        return bool(np.max(difference) <= _SAME_END * np.max(np.abs(motion), initial=1e-9))
