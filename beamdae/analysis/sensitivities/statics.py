"""`equilibrium_sensitivities`: derivatives of equilibrium paths and their critical loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.analysis.continuation.critical import FLUTTER
from beamdae.analysis.sensitivities.model_differences import Difference, difference_model
from beamdae.analysis.sensitivities.observable_derivatives import differentiate_observable
from beamdae.analysis.sensitivities.path_derivatives import (
    FlutterPoint,
    PrescribedPoint,
    SingularPoint,
)
from beamdae.analysis.sensitivities.sensitivity_result import (
    SensitivityResult,
    complete_parameters,
    require_parameters,
)
from beamdae.analysis.sensitivities.static_derivatives import LoadDerivatives
from beamdae.analysis.statics.load_scaling import LoadedEquations, Loading, build_loading
from beamdae.analysis.statics.prescribed_column import PrescribedColumn
from beamdae.analysis.statics.static_equilibrium import equilibrium
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.errors import (
    BeamdaeError,
    format_exception,
    record_warnings,
    short_repr,
    warn_user,
)
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_functions import Model
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.read_only import read_only_data
from beamdae.results.column_derivatives import (
    derivative_columns,
    derivative_header,
    select_derivative,
)
from beamdae.results.equilibrium import FACTOR, KIND, Equilibrium
from beamdae.simulation import as_equations

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray
PathPoint = PrescribedPoint | SingularPoint | FlutterPoint

_NAME = "equilibrium_sensitivities"
# Stages of loads are complete if their factors differ from one by less than this.
_FACTOR_TOLERANCE = 1e-9


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
        at branch points that the parameter does not preserve.
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

    def sensitivity(self, column: str, parameter: str) -> pd.Series:
        """Return the derivative of a column with respect to a parameter, along the path.

        Parameters
        ----------
        column
            Header of a load factor, observed column, coordinate or multiplier, with or without its
            unit, as in `equilibrium["tip.y"]`.
        parameter
            Name of the parameter.

        Returns
        -------
        pandas.Series
            Derivative (k,) in the unit of the column per unit of the parameter, indexed by the load
            factor.

        Raises
        ------
        BeamdaeError
            If the parameter is not one of `parameters`, or the name selects no column or several
            columns.
        """
        parameter = self._require_parameter("sensitivity", parameter)
        observed = self._columns[parameter]
        headers = self.equilibrium.coordinate_columns()
        values = np.hstack([self.q[parameter], self.lam[parameter]]).T
        columns: dict[str, Array] = dict(zip(headers, values, strict=True))
        columns |= observed
        index = FACTOR, self.equilibrium.factors.sum(axis=1)
        return select_derivative(columns, column, parameter, index, "Equilibrium", observed)

    def table(self) -> pd.DataFrame:
        """Return the load factors and the derivatives of all observed columns, one row per point.

        The header of the derivative of "tip.y [m]" with respect to "E" is "d(tip.y)/d(E) [m per
        unit of E]". Load factors are differentiated where they are not prescribed.
        """
        import pandas as pd

        columns = {
            header: column
            for header, column in self.equilibrium.all_columns().items()
            if header.startswith("load factor") or header == KIND
        }
        kinds = columns.pop(KIND)
        return pd.DataFrame({**columns, **derivative_columns(self._columns), KIND: kinds})

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
        parameter = self._require_parameter("derivative", parameter)
        if not callable(function):
            raise BeamdaeError(
                "derivative: function must be a function of an Equilibrium, got "
                f"{short_repr(function)}."
            )
        difference, path = self._differences[parameter], self.equilibrium
        neighbors = {
            id(equations): replace(
                path,
                equations=equations,
                factors=path.factors + step * self.factors[parameter],
                q=path.q + step * self.q[parameter],
                lam=path.lam + step * self.lam[parameter],
            )
            for equations, step in zip(difference.equations, difference.steps, strict=True)
        }

        def evaluate(e: EquationsOfMotion) -> Array:
            try:
                return np.asarray(function(neighbors[id(e)]), float)
            except BeamdaeError:
                raise
            except Exception as problem:
                raise BeamdaeError(
                    f"derivative: the function failed: {format_exception(problem)}."
                ) from problem

        return difference.derivative(evaluate)

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
        times = np.full((len(path.q), 2), path.t)
        equations = path.observed_equations
        for number, observable in enumerate(equations.observables):
            for name, rows in differentiate_observable(
                equations, number, times, at, along, self._differences
            ).items():
                derivatives = dict(zip(observable.headers, rows.T, strict=True))
                result[name] |= {x: y for x, y in derivatives.items() if x in path.columns}
        return result


@dataclass(frozen=True)
class _PathPoints:
    """Points of a path with the conditions that determine them."""

    path: Equilibrium
    loading: Loading

    def differentiate(
        self, difference: Difference, neighbors: Sequence[Loading]
    ) -> tuple[Array, Array, Array]:
        """Return the derivatives of the load factors, coordinates and multipliers of all rows.

        `neighbors` are the loadings of the models of `difference`. Derivatives that do not exist
        are NaN.
        """
        path, loading = self.path, self.loading
        stages = [
            LoadDerivatives.of(difference, system, [x.systems[k] for x in neighbors])
            for k, system in enumerate(loading.systems)
        ]
        factors, q = np.full_like(path.factors, np.nan), np.full_like(path.q, np.nan)
        lam = np.full_like(self._multipliers, np.nan)
        rates = self._column_rates(difference)
        for row in range(len(path.q)):
            if path.free_coordinates[row]:
                continue
            stage = self._stage(row)
            point = self._point(row, stages[stage].system)
            change = (
                point.derivative(stages[stage], rates[row])
                if isinstance(point, PrescribedPoint)
                else point.derivative(stages[stage])
            )
            if change is not None:
                factors[row] = 0.0
                dx, factors[row, stage : stage + 1] = change
                q[row], lam[row] = np.split(dx, [path.q.shape[1]])
        # No negative zeros in tables.
        return factors + 0.0, q + 0.0, self._restore(difference, neighbors, q, lam) + 0.0

    @cached_property
    def _multipliers(self) -> Array:
        """Multipliers of the constraints that are not redundant, (k, m)."""
        path, loading = self.path, self.loading
        if loading.reduction is None:
            return path.lam[:, loading.multiplier_rows]
        rows = []
        for row, q in enumerate(path.q):
            system, n = loading.systems[self._stage(row)], len(q)
            x, mu = np.append(q, np.zeros(len(loading.multiplier_rows))), self._factor(row)
            forces = system.residual(x, mu)[0][:n]
            reactions = system.matrix(x, mu).toarray()[:n, n:]
            rows.append(-np.linalg.lstsq(reactions, forces)[0])
        return np.array(rows)

    def _restore(
        self, difference: Difference, neighbors: Sequence[Loading], q: Array, lam: Array
    ) -> Array:
        """Return the derivatives of all multipliers from those of independent constraints.

        The reactions of redundant constraints are differenced along the derivatives.
        """
        path, loading = self.path, self.loading
        result = np.full_like(path.lam, np.nan)
        (rows,) = np.nonzero(np.isfinite(q).all(axis=1))
        if loading.reduction is None:
            result[rows] = 0.0
            result[np.ix_(rows, loading.multiplier_rows)] = lam[rows]
            return result
        multipliers = {
            id(e): neighbor.full_multipliers(
                path.q[rows] + step * q[rows], self._multipliers[rows] + step * lam[rows]
            )
            for e, neighbor, step in zip(
                difference.equations, neighbors, difference.steps, strict=True
            )
        }
        result[rows] = difference.derivative(lambda e: multipliers[id(e)])
        return result

    def lost(self, derivatives: tuple[Array, Array, Array]) -> list[int]:
        """Return the numbers of the critical points whose derivatives do not exist."""
        points = enumerate(self.path.critical)
        return [k for k, point in points if np.any(np.isnan(derivatives[0][point.row]))]

    def _stage(self, row: int) -> int:
        factors = self.path.factors[row]
        (unfinished,) = np.nonzero(np.abs(factors - 1.0) > _FACTOR_TOLERANCE)
        return int(unfinished[0]) if len(unfinished) else max(len(factors) - 1, 0)

    def _factor(self, row: int) -> float:
        factors = self.path.factors[row]
        return float(factors[self._stage(row)]) if len(factors) else 1.0

    def _point(self, row: int, system: LoadedEquations) -> PathPoint:
        """Return the point in a row; parameters with the same `system` share its factors."""
        key = (row, id(system))
        if key not in self._points:
            self._points[key] = self._create_point(row, system)
        return self._points[key]

    @cached_property
    def _points(self) -> dict[tuple[int, int], PathPoint]:
        return {}

    def _create_point(self, row: int, system: LoadedEquations) -> PathPoint:
        path = self.path
        x, mu = np.append(path.q[row], self._multipliers[row]), self._factor(row)
        kinds = {point.row: point.kind for point in path.critical}
        if row in kinds:
            if kinds[row] == FLUTTER:
                return FlutterPoint(system, x, mu)
            return SingularPoint(system, x, mu, kinds[row]).refine()
        gradient = np.zeros_like(x), 1.0
        if self._control is not None and self._is_column_prescribed(row):
            gradient = self._control.gradient(x), 0.0
        return PrescribedPoint(system, x, mu, gradient)

    def _is_column_prescribed(self, row: int) -> bool:
        # The path begins at the load factor zero.
        is_last = self._stage(row) == self.path.factors.shape[1] - 1
        return is_last and bool(self.path.factors[row, -1] != 0.0)

    @cached_property
    def _control(self) -> PrescribedColumn | None:
        """Prescribed observed position; None if load factors are prescribed."""
        to = self.path.settings["to"]
        if not isinstance(to, Mapping):
            return None
        time = self.loading.systems[0].loaded.time
        return PrescribedColumn.from_name(self.path.equations, next(iter(to)), time)

    def _column_rates(self, difference: Difference) -> Array:
        """Return the derivative of the prescribed quantity at constant (x, mu) in each row."""
        path, control = self.path, self._control
        rates = np.zeros(len(path.q))
        if control is None:
            return rates
        rest, none = np.zeros_like(path.q), np.zeros_like(path.lam)
        number = [o is control.observable for o in path.equations.observables].index(True)
        times = np.full((len(path.q), 2), path.t)
        along = {difference.name: State(rest, rest, rest, none)}
        columns = differentiate_observable(
            path.observed_equations,
            number,
            times,
            State(path.q, rest, rest, path.lam),
            along,
            {difference.name: difference},
        )[difference.name]
        is_prescribed = [self._is_column_prescribed(row) for row in range(len(path.q))]
        return np.where(is_prescribed, columns[:, control.column], 0.0)


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

    With the static equations R(x; mu, p) = 0 in x = (q, lam), where p are the numbers in the
    equations, each point of the path and each parameter take one solution of

        R_x dx + R_mu dmu + R_p dp = 0

    with the exact tangent and directional derivatives of the kernels; only the model function is
    differenced, see `sensitivities`. What `to` prescribes is constant: load factors, or an observed
    position; then, the load factors have derivatives. Critical points move with the parameters:
    the derivative of the load factor at a limit point is

        dmu = -w^T R_p dp / w^T R_mu

    with the left null vector w of R_x. At a branch point, w^T R_mu and, if the parameter preserves
    the branch point, w^T R_p are zero, and the derivatives of the condition w^T R_x v = 0 are used,
    with the right null vector v. See Godoy, Theory of Elastic Stability: Analysis and Sensitivity,
    Taylor & Francis (1999), and Wriggers & Simo, Int. J. Numer. Meth. Eng. 30 (1990) 155,
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
    names = require_parameters(_NAME, model, by)
    values = complete_parameters(_NAME, model, parameters)
    mechanism = model(**values)
    path = equilibrium(mechanism, loads, to, control, step, switch, max_points, t, start)
    if not path.status.success:
        raise BeamdaeError(
            f"{_NAME}: the path of {model.name} did not reach its end ({path.status.sentence}); "
            "change to= or control=."
        )
    if path.free:
        raise BeamdaeError(
            f"{_NAME}: {path.free} of {model.name} can move without stiffness, so the position of "
            "the equilibrium has no derivative; add a spring or a joint."
        )
    path = replace(path, model={"name": model.name, "parameters": values})
    stages = [list(stage) for stage in path.loads] or None

    def assemble(mechanism: Any) -> EquationsOfMotion:
        return as_equations(_NAME, mechanism, AS_DRAWN)

    def load(equations: EquationsOfMotion) -> Loading:
        mechanism = equations.mechanism
        source = equations if mechanism is None else mechanism
        return build_loading(source, equations, stages, path.t)

    points = _PathPoints(path, load(path.equations))
    differences = {
        name: difference_model(model, name, values, path.equations, assemble, moves_operators=True)
        for name in names
    }
    derivatives = {}
    with single_threaded:
        for name, difference in differences.items():
            derivatives[name] = points.differentiate(
                difference, [load(equations) for equations in difference.equations]
            )
            for point in points.lost(derivatives[name]):
                warn_user(
                    f"{_NAME}: {name} does not preserve the {path.critical[point].kind} at load "
                    f"factor {path.critical[point].factor:g}, so its derivative does not exist "
                    "(NaN); differentiate limit points of the path with an imperfection instead."
                )
    factors, q, lam = ({name: x[k] for name, x in derivatives.items()} for k in range(3))
    return EquilibriumSensitivities(
        path, {name: float(values[name]) for name in names}, factors, q, lam, differences
    )
