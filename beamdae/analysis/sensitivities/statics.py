"""`equilibrium_sensitivities`: derivatives of equilibrium paths and their critical loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.analysis.continuation.critical import BRANCH, LIMIT
from beamdae.analysis.continuation.engine import Control, CurveError, prescribe_parameter
from beamdae.analysis.sensitivities.implicit import (
    Direction,
    FlutterPoint,
    RegularPoint,
    SingularPoint,
    differentiate_equations,
)
from beamdae.analysis.sensitivities.neighbors import (
    Difference,
    NumericModel,
    difference_model,
    difference_models,
)
from beamdae.analysis.sensitivities.observable_derivatives import (
    differentiate_columns,
    observable_of,
)
from beamdae.analysis.sensitivities.sensitivity_result import (
    SensitivityResult,
    select_parameters,
)
from beamdae.analysis.statics.load_scaling import (
    Loading,
    active_stage,
    build_loading,
)
from beamdae.analysis.statics.path_settings import PrescribedColumn
from beamdae.analysis.statics.static_equilibrium import equilibrium
from beamdae.analysis.statics.static_problem import StaticProblem
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.static_equations import find_idle_forces
from beamdae.errors import (
    BeamdaeError,
    format_exception,
    record_warnings,
    require_choice,
    short_repr,
    warn_user,
)
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_functions import Model
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.read_only import read_only_data
from beamdae.results.column_derivatives import derivative_columns, derivative_header
from beamdae.results.equilibrium import FACTOR, KIND, Equilibrium
from beamdae.simulation import as_equations

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_NAME = "equilibrium_sensitivities"


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class EquilibriumSensitivities(SensitivityResult):
    """An equilibrium path and its derivatives; see `equilibrium_sensitivities`.

    Attributes
    ----------
    equilibrium
        The path.
    parameters
        Values by name of the parameters with respect to which the path is differentiated.
    factors, q, lam
        Derivatives of the load factors (k, number of stages), coordinates (k, n) and multipliers
        (k, m) of the path with respect to each parameter, by its name, per unit of the parameter;
        NaN where they do not exist: in rows in which the mechanism can move without stiffness, and
        at branch points that the parameter does not preserve or with several critical modes.
    warnings
        Warnings that the call issued.
    """

    equilibrium: Equilibrium
    parameters: Mapping[str, float]
    factors: Mapping[str, Array] = field(repr=False)
    q: Mapping[str, Array] = field(repr=False)
    lam: Mapping[str, Array] = field(repr=False)
    _differences: Mapping[str, Difference] = field(repr=False)
    warnings: tuple[str, ...] = field(default=(), repr=False)

    @property
    def _summary(self) -> str:
        return f"{len(self.equilibrium.q)} rows to load factor {self.equilibrium.factor:g}"

    @property
    def _index(self) -> tuple[str, Array]:
        return FACTOR, self.equilibrium.factors.sum(axis=1)

    def _further_columns(self, parameter: str) -> dict[str, Array]:
        """Return the derivatives of coordinates and multipliers."""
        rates = np.hstack([self.q[parameter], self.lam[parameter]]).T
        return dict(zip(self.equilibrium.coordinate_columns(), rates, strict=True))

    def table(self) -> pd.DataFrame:
        """Return the load factors and the derivatives of all observed columns, one row per point.

        Load factors are differentiated where they are not prescribed.
        """
        import pandas as pd

        columns = self.equilibrium.all_columns()
        factors = {x: y for x, y in columns.items() if x.startswith("load factor")}
        derivatives = derivative_columns(self._columns)
        return pd.DataFrame({**factors, **derivatives, KIND: columns[KIND]})

    def critical_table(self) -> pd.DataFrame:
        """Return the critical points of the path and the derivatives of their load factors.

        The columns are "point", "load factor [-]" and "d(load factor)/d(parameter) [- per unit of
        parameter]" of each parameter.
        """
        import pandas as pd

        points = self.equilibrium.critical
        rows = [point.row for point in points]
        columns: dict[str, Any] = {
            KIND: [point.kind for point in points],
            FACTOR: [point.factor for point in points],
        }
        for parameter, rates in self.factors.items():
            columns[derivative_header(FACTOR, parameter)] = rates[rows].sum(axis=1)
        return pd.DataFrame(columns)

    def derivative(self, function: Callable[[Equilibrium], Any], parameter: str) -> Any:
        """Return the derivative of a function of the equilibrium with respect to a parameter.

        The function is differenced along the exact derivative of the path, without further
        solutions: f(path + d path, p + dp) for small changes of both signs, with errors near 1e-10
        of f. It can compute section forces, stresses and energies. Arc lengths in the function
        should be relative to the length of a beam if the length depends on the parameter.

        Parameters
        ----------
        function
            Function of an `Equilibrium` that returns a number or an array, such as
            `lambda path: path.section_forces("beam").M`.
        parameter
            Name of the parameter.

        Raises
        ------
        BeamdaeError
            If the parameter is not one of `parameters`, or `function` is not a function or fails.
        """
        parameter = require_choice("derivative", "parameter", parameter, list(self.parameters))
        if not callable(function):
            raise BeamdaeError(
                "derivative: function must be a function of an Equilibrium, got "
                f"{short_repr(function)}."
            )
        path = self.equilibrium

        def evaluate(e: EquationsOfMotion, factors: Array, q: Array, lam: Array) -> Array:
            try:
                moved = replace(path, equations=e, factors=factors, q=q, lam=lam)
                return np.asarray(function(moved), dtype=float)
            except BeamdaeError:
                raise
            except Exception as problem:
                raise BeamdaeError(
                    f"derivative: the function failed: {format_exception(problem)}."
                ) from problem

        changes = [(getattr(path, x), getattr(self, x)[parameter]) for x in ("factors", "q", "lam")]
        return np.asarray(self._differences[parameter].along(evaluate, *changes))

    @cached_property
    def _columns(self) -> dict[str, dict[str, Array]]:
        """Derivatives of load factors and observed columns, by parameter and header."""
        path = self.equilibrium
        names = [x for x in path.all_columns() if x.startswith("load factor")]
        result = {
            name: dict(zip(names, rates.T, strict=False)) for name, rates in self.factors.items()
        }
        rest = np.zeros_like(path.q)
        at = State(path.q, rest, rest, path.lam)
        along = {name: State(self.q[name], rest, rest, self.lam[name]) for name in self.q}
        times, inactive = np.full((len(path.q), 2), path.t), frozenset(path._inactive)
        for number, observable in enumerate(path.equations.observables):
            rates = differentiate_columns(
                partial(observable_of, number), times, at, along, self._differences, inactive
            )
            for name, rows in rates.items():
                derivatives = zip(observable.headers, rows.T, strict=True)
                result[name] |= {x: y for x, y in derivatives if x in path.columns}
        return result


def _differentiate_rows(
    path: Equilibrium,
    loading: Loading,
    differences: Mapping[str, Difference],
    neighbors: Mapping[str, Sequence[Loading]],
    rows: Sequence[int],
) -> dict[str, tuple[Array, Array, Array]]:
    """Return the derivatives of load factors, coordinates and multipliers by parameter.

    `loading` contains the conditions that determine the points, `neighbors` those of the models of
    `differences`. Derivatives that do not exist, and those in other than the given rows, are NaN.
    """
    (count, n), m = path.q.shape, len(loading.multiplier_rows)
    multipliers = np.zeros((count, m))
    kinds = {point.row: point.kind for point in path.critical}
    shapes = path.factors.shape, path.q.shape, multipliers.shape
    rates = {name: [np.full(shape, np.nan) for shape in shapes] for name in differences}
    control_of = partial(_control, path, time=loading.systems[0].loaded.time)
    for stage, system in enumerate(loading.systems):
        idle = find_idle_forces(system.loaded)
        problem, control = StaticProblem(system, idle=idle), control_of(path.equations)
        directions = {}
        for name, difference in differences.items():
            problems = [StaticProblem(x.systems[stage], idle=idle) for x in neighbors[name]]
            models = list(zip(problems, map(control_of, difference.models), strict=True))
            parts = [
                differentiate_equations(
                    difference,
                    getattr(problem.mixed, part),
                    [getattr(x.mixed, part).equations for x in problems],
                )
                for part in ("first", "last")
            ]
            at = difference.stencil, difference.delta
            directions[name] = Direction(models, *at, np.zeros(1), parts)
        for row in rows:
            if path.free_coordinates[row] or active_stage(path.factors[row]) != stage:
                continue
            q, kind = path.q[row], kinds.get(row)
            mu = float(path.factors[row, stage]) if path.factors.shape[1] else 1.0
            # The path begins at the load factor zero.
            is_end = stage == path.factors.shape[1] - 1 and mu != 0.0 and kind is None
            try:
                point: RegularPoint | SingularPoint
                if kind in (LIMIT, BRANCH):
                    point = SingularPoint.find(problem, q, mu, kind == LIMIT)
                else:
                    controlled = control if is_end else prescribe_parameter
                    x = problem.point_at(q, mu).x
                    solution = problem.correct(controlled, controlled(x, mu).value, x, mu)
                    kind_of_point = RegularPoint if kind is None else FlutterPoint
                    point = kind_of_point(solution, controlled)
                for name, direction in directions.items():
                    change = point.derivative(direction)
                    if change is not None:
                        factors, positions, lam = rates[name]
                        factors[row], factors[row, stage : stage + 1] = 0.0, change[-1]
                        positions[row], lam[row] = change[:n], change[n : n + m]
            except CurveError:
                if kind in (LIMIT, BRANCH):
                    continue  # several modes are critical
                raise
            multipliers[row] = point.point.x[n : n + m]
    result = {}
    for name, (factors, q, lam) in rates.items():
        # The reactions of redundant constraints are differenced along the derivatives.
        restored, (known,) = np.full_like(path.lam, np.nan), np.nonzero(np.isfinite(q).all(axis=1))
        restored[known] = replace(differences[name], models=neighbors[name]).along(
            Loading.full_multipliers,
            (path.q[known], q[known]),
            (multipliers[known], lam[known]),
        )
        result[name] = factors + 0.0, q + 0.0, restored + 0.0  # no negative zeros in tables
    return result


def _control(path: Equilibrium, equations: EquationsOfMotion, time: Array) -> Control:
    """Return the quantity that the path prescribes at the end."""
    to = path.settings["to"]
    if not isinstance(to, Mapping):
        return prescribe_parameter
    return PrescribedColumn.from_name(equations, next(iter(to)), time)


@interruptible
@record_warnings
def equilibrium_sensitivities(
    model: Model,
    by: Sequence[str] | str,
    loads: Any = None,
    to: Any = 1.0,
    control: str | None = None,
    step: float | None = None,
    switch: Any = 0,
    max_points: int = 500,
    t: float = 0.0,
    start: Any = None,
    *,
    parameters: Mapping[str, Any] | None = None,
) -> EquilibriumSensitivities:
    """Compute an equilibrium path and differentiate it with respect to parameters of the model.

    With the static equations F(x, mu; p) = 0 in x = (q, lam), each point of the path and each
    parameter take one solution of

        F_x dx + F_mu dmu + F_p dp = 0

    with the exact tangent; F_p contains exact derivatives of F by the numbers of the model, which
    are differenced along the model function, see `sensitivities`. What `to` prescribes is constant:
    load factors, or an observed position; then, the load factors have derivatives. In the rows of
    critical points, the derivatives are those of these points, which move with the parameters.
    See Godoy, Theory of Elastic Stability: Analysis and Sensitivity, Taylor & Francis (1999), and
    Wriggers & Simo, Int. J. Numer. Meth. Eng. 30 (1990) 155,
    doi:10.1002/nme.1620300110.

    Parameters
    ----------
    model
        Model function.
    by
        Names of the parameters with respect to which the path is differentiated. They must be
        floats.
    loads, to, control, step, switch, max_points, t, start
        Path, see `equilibrium`.
    parameters
        Values of the parameters of the model that differ from the defaults.

    Returns
    -------
    EquilibriumSensitivities
        The path with its derivatives.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the path does not reach its end, the equilibrium at its end can
        move without stiffness, or a parameter changes the structure of the equations or is at a
        kink of the model function.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        For each of `Equilibrium.warnings`, and if a parameter, such as an imperfection, does not
        preserve a branch point. The derivatives of this point are then NaN.

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
    >>> result = bd.equilibrium_sensitivities(truss, "rise", to={"crown.y": 0.0})
    >>> [round(float(x), 2) for x in result.critical_table().iloc[0, 1:]]
    [3.02, 44.7]
    """
    names, model = select_parameters(_NAME, model, by, parameters)
    path = equilibrium(model(), loads, to, control, step, switch, max_points, t, start)
    if not path.status.success:
        raise BeamdaeError(
            f"{_NAME}: the path of {model.name} did not reach its end ({path.status.sentence}); "
            "change to= or control=."
        )
    path = replace(path, model={"name": model.name, "parameters": model.parameters})
    return differentiate_path(model, names, path)


def differentiate_path(
    model: NumericModel,
    names: Sequence[str],
    path: Equilibrium,
    rows: Sequence[int] | None = None,
    known: Mapping[str, Difference] | None = None,
) -> EquilibriumSensitivities:
    """Return the derivatives of a path of a model; see `equilibrium_sensitivities`.

    `rows` are the differentiated points, and `known` the models around the values of the
    parameters, as drawn; None for all points, and for models that are to be built.
    """
    if path.free:
        raise BeamdaeError(
            f"{_NAME}: {path.free} of {model.name} can move without stiffness, so the position of "
            "the equilibrium has no derivative; add a spring or a joint."
        )
    rows = list(range(len(path.q)) if rows is None else rows)
    stages = [list(stage) for stage in path.loads] or None
    has_all_loads = path.factors.shape[1] == 1 and bool(np.all(path.factors[rows] == 1.0))
    is_prescribed = has_all_loads and not isinstance(path.settings["to"], Mapping)
    if is_prescribed and path.equations.configurations is None:
        stages = None  # Equations without loads are not needed, and take long to assemble.

    assemble = partial(as_equations, _NAME, start=AS_DRAWN)

    def load(equations: EquationsOfMotion) -> Loading:
        mechanism = equations.mechanism
        source = equations if mechanism is None or stages is None else mechanism
        return build_loading(source, equations, stages, path.t)

    with single_threaded:
        loading = load(path.equations)
        ends = [x for system in loading.systems for x in (system.unloaded, system.loaded)]
        if not all(np.array_equal(x.equations.p, path.equations.p) for x in ends):
            known = {x: difference_model(model, x, path.equations, assemble) for x in names}
        differences = known or difference_models(model, names, path.equations, assemble)
        neighbors = {name: list(map(load, x.models)) for name, x in differences.items()}
        multipliers = [x.equations.lam_names for x in loading.systems]
        for name, others in neighbors.items():
            # Parameters may change which constraints are independent.
            if any([x.equations.lam_names for x in y.systems] != multipliers for y in others):
                raise BeamdaeError(
                    f"{_NAME}: {name} changes the structure of the equations; use differences of "
                    "results for this parameter."
                )
        try:
            derivatives = _differentiate_rows(path, loading, differences, neighbors, rows)
        except CurveError as error:
            raise BeamdaeError(
                f"{_NAME}: an equilibrium of the path of {model.name} has no derivative, because "
                f"{error}; add a spring or a joint, or end the path before this equilibrium."
            ) from None
    factors, q, lam = ({name: x[k] for name, x in derivatives.items()} for k in range(3))
    for name in names:
        for point in path.critical:
            if point.row in rows and np.any(np.isnan(factors[name][point.row])):
                warn_user(
                    f"{_NAME}: {name} does not preserve the {point.kind} at load factor "
                    f"{point.factor:g}, or several modes are critical there, so its derivative "
                    "does not exist (NaN); differentiate limit points of the path with an "
                    "imperfection instead."
                )
    return EquilibriumSensitivities(
        path, {x: float(model.parameters[x]) for x in names}, factors, q, lam, differences
    )
