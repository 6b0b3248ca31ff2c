"""The least-squares problem of a fit: residuals and Jacobian at values of the parameters."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import signal

from beamdae.analysis.fit.data import (
    COLUMN,
    EXPERIMENT,
    SIGMA,
    VALUE,
    MeasuredData,
    read_fit_data,
    read_measurements,
)
from beamdae.analysis.fit.sensors import CLOCK, OFFSET, SCALE, TIMING, Sensor, read_sensors
from beamdae.analysis.parameter_bounds import (
    LOG_ORIGIN,
    ParameterScales,
    draw_starts,
    read_bounds,
)
from beamdae.analysis.sensitivities.differentiable_run import DERIVATIVE_METHOD
from beamdae.analysis.sensitivities.observable_derivatives import differentiate_column
from beamdae.analysis.sensitivities.sensitivities import Sensitivities, differentiate_run
from beamdae.analysis.sensitivities.sensitivity_result import (
    complete_parameters,
    require_parameters,
)
from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, require_mapping, require_names, short_repr
from beamdae.integrators import Integrator
from beamdae.integrators.integrator import require_integrator
from beamdae.model_functions import transform_mechanisms
from beamdae.simulation import as_equations, silenced

Array = np.ndarray

# Data that end after more than this multiple of the end time of the model are in other units.
_MAX_DURATION = 10.0
# Singular values below this ratio to the largest are rounding errors of the derivatives.
MIN_SINGULAR_RATIO = 1e-9
# Residuals below this ratio to the data are rounding errors.
MIN_RELATIVE_RESIDUAL = 1e-6
# Residuals with at most this correlation length are noise; neighbors may be correlated by 0.5.
_MAX_CORRELATION_LENGTH, _LAGS_PER_LENGTH = 3.0, 5.0


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Runs at one set of values, compared with the N data.

    Attributes
    ----------
    values
        Values (K,) of the parameters of the model, then of shifts and clocks.
    runs
        Run with derivatives by experiment, at the times of the data.
    residuals
        Weighted residuals (N,): (model - data) / sigma, with the best scales and offsets; 0 where
        reactions of the model grow without bounds.
    coefficients
        Best scales, then offsets, (L,).
    projected_jacobian
        Exact derivatives (N, K) of `residuals` with respect to `values`, where scales and offsets
        follow.
    jacobian
        Derivatives (N, K + L) of the weighted residuals with respect to `values` and
        `coefficients` as independent parameters.
    """

    values: Array
    runs: Mapping[str, Sensitivities]
    residuals: Array
    coefficients: Array
    projected_jacobian: Array
    jacobian: Array

    @property
    def estimates(self) -> Array:
        """The values and the coefficients, (K + L,)."""
        return np.append(self.values, self.coefficients)

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


class FitProblem:
    """Data and model of a fit, with the derivatives of the residuals.

    Scales and offsets of sensors enter linearly and are eliminated by variable projection (Golub &
    Pereyra, Inverse Problems 19 (2003) R1, doi:10.1088/0266-5611/19/2/201): with the weighted
    residuals r = A(x) c + f(x) - d, where x are the parameters of the model and timing, and c
    the scales and offsets, the best c for a given x is c = A^+ (d - f), and

        r' = P (A' c + f') - (A^+)^T A'^T r,    P = 1 - A A^+,

    is the exact derivative of the remaining residuals (the second term is the one that the
    approximation of Kaufman omits).

    Parameters
    ----------
    model, data, by, integrator, sigma, parameters, start, experiments, data_columns
        See `fit`.
    sensors
        Arguments "shift", "clock", "scale" and "offset" of `fit` by name.

    Attributes
    ----------
    model
        The model function.
    names
        Names of the parameters of the model.
    data
        The data.
    sensors
        Unknown properties of sensors.
    weights
        Reciprocal standard deviations (N,) of the data.
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        by: Any,
        integrator: Integrator | None = None,
        sigma: Any = None,
        parameters: Any = None,
        start: Any = None,
        experiments: Any = None,
        sensors: Mapping[str, Any] | None = None,
        data_columns: Any = None,
    ) -> None:
        self.names = require_parameters("fit", model, by)
        self.model, self.start = model, start
        method = DERIVATIVE_METHOD if integrator is None else integrator
        self.integrator = require_integrator("fit", method)
        self.parameters = complete_parameters("fit", model, parameters)
        measured = read_measurements("fit", data, data_columns)
        known, what = measured.experiments, "a dict of values of parameters by experiment"
        given = {} if experiments is None else experiments
        self._settings = dict.fromkeys(known, self.parameters)
        for name, entries in require_mapping("fit", "experiments", given, what).items():
            if name not in known:
                raise BeamdaeError(
                    f"fit: experiments contains {short_repr(name)}, for which there are no data; "
                    f"the data name {', '.join(filter(None, known)) or 'no experiments'}."
                )
            values = require_mapping("fit", f"experiments of {name}", entries, "values by name")
            for fitted in set(values) & set(self.names):
                raise BeamdaeError(
                    f"fit: the experiment {name} sets {fitted}, which is in by; remove it from "
                    "one of them."
                )
            changes = {x: model.complete({x: values[x]})[x] for x in values}
            self._settings[name] = self.parameters | changes
        headers = {
            x: as_equations("fit", model(**values), start).observed_headers
            for x, values in self._settings.items()
        }
        table = read_fit_data(measured, headers, sigma)
        self._set_data(table, read_sensors(table, sensors or {}))
        if self.count < (unknowns := len(self.estimated)):
            raise BeamdaeError(
                f"fit: {self.count} data do not determine {unknowns} parameters; add data or fit "
                "fewer parameters."
            )

    @property
    def first_values(self) -> Array:
        """First values (K,) of the parameters of the model, shifts and clocks."""
        timing = [float(np.clip(x.perfect, *x.bounds)) for x in self.timing]
        return np.array([self.parameters[name] for name in self.names] + timing)

    def _set_data(self, data: MeasuredData, sensors: tuple[Sensor, ...]) -> None:
        self.data, self.sensors = data, sensors
        self._times, self._values, sigma = (data.table[x].to_numpy() for x in (TIME, VALUE, SIGMA))
        self.weights = 1.0 / sigma
        self._scaled, offset, self.timing = (
            [x for x in sensors if x.kind in kinds] for kinds in ((SCALE,), (OFFSET,), TIMING)
        )
        self.linear = [*self._scaled, *offset]
        self._linear_rows = np.array([x.rows for x in self.linear], float)
        self._linear_rows = self._linear_rows.reshape(len(self.linear), self.count)
        # The last time at which the run of each experiment may be compared [s].
        latest, _ = self._correct_times([x.bounds[0] for x in self.timing])
        self._rows = {x: (data.table[EXPERIMENT] == x).to_numpy() for x in data.experiments}
        self._t_end = {x: float(latest[rows].max()) for x, rows in self._rows.items()}
        limit = _MAX_DURATION * self.model.t_end
        if not (min(self._t_end.values()) > 0.0 and self._times.max() <= limit):
            raise BeamdaeError(
                f"fit: the data end at {self._times.max():g} s, but must end after 0 s and before "
                f"{limit:g} s, {_MAX_DURATION:g} times the end time of {self.model.name}; check "
                "the unit of their times, subtract the first time from all times, or change t_end "
                "of the model."
            )

    def within(self, begin: float, end: float) -> tuple[FitProblem, Array]:
        """Return the problem with the data between two shares of the time, and their rows.

        See `MeasuredData.within`.
        """
        data, rows = self.data.within(begin, end)
        return self._with(data, tuple(replace(x, rows=x.rows[rows]) for x in self.sensors)), rows

    def with_sensors(self, kinds: Sequence[str]) -> FitProblem:
        """Return a problem in which each column has further unknown properties of its sensor.

        Columns for which they are unknown already, or whose values are constant, are omitted.
        """
        columns = dict[str, list[str]]()
        for kind in kinds:
            known = [x.rows for x in self.sensors if x.kind == kind]
            others = self.data.table[~np.any([np.zeros(self.count, bool), *known], axis=0)]
            parts = others.groupby(COLUMN, sort=False)[VALUE]
            columns[kind] = [str(x) for x, values in parts if varies(values.to_numpy())]
        return self._with(self.data, (*self.sensors, *read_sensors(self.data, columns)))

    def _with(self, data: MeasuredData, sensors: tuple[Sensor, ...]) -> FitProblem:
        other = copy.copy(self)
        other._set_data(data, sensors)
        return other

    @property
    def count(self) -> int:
        """Number of data."""
        return len(self._values)

    @property
    def rounding(self) -> float:
        """Sum of squared residuals of which only rounding errors are left."""
        return float(np.sum((MIN_RELATIVE_RESIDUAL * self._values * self.weights) ** 2))

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the parameters that the search varies: of the model, then shifts and clocks."""
        return (*self.names, *(x.name for x in self.timing))

    @property
    def estimated(self) -> tuple[str, ...]:
        """Names of the variables, and of scales and offsets, which are solved for linearly."""
        return (*self.variables, *(x.name for x in self.linear))

    @property
    def units(self) -> dict[str, str]:
        """Units of parameters and properties of sensors by name; "" if unknown."""
        info = self.model.parameter_info
        return {x: info[x].unit for x in self.names} | {x.name: x.unit for x in self.sensors}

    def evaluate(self, values: Array) -> Evaluation:
        """Run all experiments at the given values (K,) and compare them with the data.

        Raises
        ------
        BeamdaeError
            If a run fails or cannot be differentiated.
        """
        times, by_timing = self._correct_times(values[len(self.names) :])
        runs = {}
        fitted = dict(zip(self.names, values.tolist(), strict=False))
        for experiment, t_end in self._t_end.items():
            # Bounds hold up to rounding.
            needed = np.unique(np.clip(times[self._rows[experiment]], 0.0, t_end))
            settings = {"parameters": self._settings[experiment] | fitted, "start": self.start}
            # The result evaluates the warnings of the last run.
            with silenced():
                run = differentiate_run(self.model, self.names, self.integrator, t_end, **settings)
                if run.solution.trajectory.end < t_end:
                    raise BeamdaeError(
                        f"fit: the run of {self.model.name} was {run.solution.status.sentence}, "
                        f"before the last data at {needed[-1]:g} s; omit later data, or do not "
                        "stop the run."
                    )
                runs[experiment] = run.at_times(needed)
        model, derivatives = np.empty(self.count), np.zeros((self.count, len(self.variables)))
        for source, rows in self.data.rows:
            run = runs[source.experiment]
            # The times are among those of the run up to rounding.
            at = np.minimum(np.searchsorted(run.t, times[rows]), len(run.t) - 1)
            model[rows] = run.solution.columns[source.header][at]
            for j, name in enumerate(self.names):
                derivatives[rows, j] = run.sensitivity(source.header, name).to_numpy()[at]
            if by_timing[rows].any():
                rates = differentiate_column(run.solution, source.header, times[rows])
                derivatives[rows, len(self.names) :] = rates[:, None] * by_timing[rows]
        # Reactions that grow without bounds are left out: their residuals are zero.
        is_missing, count = np.isnan(model), len(self._scaled)
        if is_missing.all():
            raise BeamdaeError(
                "fit: reactions of the model grow without bounds at all times of the data; choose "
                "other first values in parameters, or other columns."
            )
        weights, model = np.where(is_missing, 0.0, self.weights), np.nan_to_num(model)
        scaled, offset = self._linear_rows[:count], self._linear_rows[count:]
        has_scale = scaled.any(axis=0)
        matrix = (np.vstack([scaled * model, offset]) * weights).T
        remainder = (self._values - np.where(has_scale, 0.0, model)) * weights
        # Columns of equal size, so that the rank does not depend on units.
        sizes = np.linalg.norm(matrix, axis=0)
        sizes = np.where(sizes == 0.0, 1.0, sizes)
        inverse = np.linalg.pinv(matrix / sizes) / sizes[:, None]
        coefficients = inverse @ remainder
        residuals = matrix @ coefficients - remainder
        weighted = np.where(is_missing[:, None], 0.0, derivatives * weights[:, None])
        scales = np.where(has_scale, coefficients[:count] @ scaled, 1.0)
        effects = weighted * scales[:, None]
        projected = effects - matrix @ (inverse @ effects)
        projected -= inverse[:count].T @ ((scaled * residuals) @ weighted)
        jacobian = np.hstack([effects, matrix])
        return Evaluation(values, runs, residuals, coefficients, projected, jacobian)

    def _correct_times(self, timing: Sequence[float] | Array) -> tuple[Array, Array]:
        """Return the true times (N,) for shifts and clocks, and their derivatives, (N, sensors)."""
        times, derivatives = self._times.copy(), np.zeros((self.count, len(self.timing)))
        for j, (one, value) in enumerate(zip(self.timing, timing, strict=True)):
            if one.kind == CLOCK:
                times[one.rows] /= value
                derivatives[one.rows] /= value
                derivatives[one.rows, j] = -times[one.rows] / value
            else:
                times[one.rows] -= value
                derivatives[one.rows, j] = -1.0
        return times, derivatives

    def repeat(self, values: Array, method: Integrator, change: Callable[[Any], Any]) -> Evaluation:
        """Return `evaluate` by runs of changed mechanisms with another integrator.

        Raises
        ------
        BeamdaeError
            If a run fails.
        """
        other = copy.copy(self)
        other.model, other.integrator = transform_mechanisms(self.model, change), method
        return other.evaluate(values)

    def recorded_values(self, evaluation: Evaluation) -> Array:
        """Return the recorded values (N,) that an evaluation predicts."""
        return self._values + evaluation.residuals / self.weights


def unexplained_share(problem: FitProblem, evaluation: Evaluation) -> float:
    """Return the sum of squares relative to that of the data about their means."""
    square = evaluation.chi_square
    return square / problem.data.variation if problem.data.variation else np.inf * bool(square)


def find_correlation(parts: Sequence[Array]) -> float:
    """Return the number of consecutive residuals that are alike, 0 for noise.

    This is the largest 1 + 2 (r_1 + ... + r_k) with the autocorrelations r of all parts, up to the
    first k that is five times as large as the sum (Sokal, in: Functional Integration, 1997, DOI
    10.1007/978-1-4899-0319-8_6). Later ones of an oscillation cancel.
    """
    covariances = np.zeros(max(map(len, parts)))
    for x in parts:
        covariances[: len(x)] += signal.correlate(x, x)[len(x) - 1 :]
    lengths = 2.0 * np.cumsum(covariances) / (covariances[0] or 1.0) - 1.0
    are_long_enough = np.arange(len(lengths)) >= _LAGS_PER_LENGTH * lengths
    count = 1 + np.argmax(are_long_enough) if are_long_enough.any() else len(lengths)
    largest = float(np.max(lengths[:count]))
    return largest if largest > _MAX_CORRELATION_LENGTH else 0.0


def is_noise(problem: FitProblem, residuals: Array) -> bool:
    """Return True if consecutive residuals of a column are not alike."""
    return not find_correlation([residuals[rows] for _, rows in problem.data.rows])


def varies(values: Array) -> bool:
    """Return False for values that may be noise, or rounding errors, about a constant."""
    changes = values - values.mean()
    is_rounding = np.abs(changes) <= np.sqrt(len(values)) * np.spacing(np.abs(values).max())
    return find_correlation([np.where(is_rounding, 0.0, changes)]) > 0.0


# Logarithm of the ratio of the first value of a parameter that is not in `log` to those about zero
# where its variable is linear.
_ORIGIN = 5.3


class Scaling(ParameterScales):
    """Scales of the parameters (K,) of a fit; timing and first values of zero are linear.

    `is_log` is True (K,) for parameters in `log`.
    """

    def __init__(self, problem: FitProblem, bounds: Any, log: Any) -> None:
        self._given = bounds, log
        self._names, values, timing = problem.variables, problem.first_values, problem.timing
        first = dict(zip(problem.names, values.tolist(), strict=False))
        logarithmic = set(require_names("fit", "log", log, "a list of names of parameters"))
        ends = read_bounds("fit", bounds, first, problem.units) | {x.name: x.bounds for x in timing}
        pairs = [np.ravel(ends.get(x, (-np.inf, np.inf))) for x in self._names]
        lower, upper = np.array(pairs).T
        for name in logarithmic:
            if name not in first:
                raise BeamdaeError(
                    f"fit: log contains {short_repr(name)}, which is not in by; name one of "
                    f"{', '.join(first)}."
                )
            low = float(lower[self._names.index(name)])
            if first[name] <= 0.0 or -np.inf < low < 0.0:
                raise BeamdaeError(
                    f"fit: the first value of {name} must be positive and its lower bound not "
                    f"negative because it is in log, got {first[name]:g} and {low:g}; pass others, "
                    f"or remove {name} from log."
                )
        self.is_log = np.isin(self._names, list(logarithmic))
        lower = np.where(self.is_log, np.maximum(lower, 0.0), lower)
        is_linear = (values == 0.0) | (np.arange(len(values)) >= len(first))
        origins = np.where(is_linear, 0.0, np.where(self.is_log, LOG_ORIGIN, _ORIGIN))
        sizes = np.array([*[1.0] * len(first), *(x.size for x in timing)])
        super().__init__(values, sizes, origins, lower, upper)

    def of(self, problem: FitProblem) -> Scaling:
        """Return the scales of a problem with other sensors."""
        return Scaling(problem, *self._given)

    def draw_starts(self, count: int, seed: int) -> Array:
        """Return first values (count, K) of further searches; see `draw_starts`."""
        return draw_starts("fit", self._names, *self.bounds, count, seed, self.is_log)
