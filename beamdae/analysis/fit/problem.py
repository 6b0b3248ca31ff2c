"""The least-squares problem of a fit: residuals and Jacobian at values of the parameters."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.fit.data import (
    FitData,
    MeasuredColumn,
    Series,
    read_fit_data,
    read_measurements,
    warn_of_missing_units,
)
from beamdae.analysis.fit.sensors import Sensor, Sensors, read_sensors
from beamdae.analysis.parameter_bounds import (
    convert_bounds,
    require_bounds_around,
    spread_starts,
)
from beamdae.analysis.sensitivities.differentiable_methods import (
    DERIVATIVE_METHOD,
)
from beamdae.analysis.sensitivities.sensitivities import Sensitivities, differentiate_run
from beamdae.analysis.sensitivities.sensitivity_result import (
    complete_parameters,
    require_parameters,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    InputWarning,
    as_real,
    kind_of_message,
    require_mapping,
    require_names,
    short_repr,
    warn_user,
)
from beamdae.integrators import Integrator
from beamdae.integrators.integrator import require_integrator
from beamdae.model_parameters import (
    conversion_factor,
    format_with_unit,
    split_unit,
)
from beamdae.results.solution import Solution
from beamdae.simulation import as_equations, simulate, skip_result_checks

Array = np.ndarray

# Data that end after more than this multiple of the end time of the model are in other units.
_MAX_DURATION = 10.0
# Data that end after more or less than these multiples of it cause a warning. Delays of sensors do
# not exceed the first; times in milliseconds that are labeled as seconds are below the second.
_MAX_USUAL_DURATION = 1.1
_MIN_USUAL_DURATION = 1.0 / 300.0
# Logarithm of the ratio of the first value of a parameter to those about zero where its variable is
# linear.
_LOG_ORIGIN = 5.3
# Singular values below this ratio to the largest are rounding errors of the derivatives.
MIN_SINGULAR_RATIO = 1e-9
# Consecutive residuals with at most this correlation are noise.
MAX_NOISE_CORRELATION = 0.5
# Distance from bounds at which a search begins, relative to their distance or to the first value.
_START_DISTANCE = 0.01


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Runs at one set of values, compared with the N data.

    Attributes
    ----------
    values
        Values (K,) of the parameters of the model, then of the shifts.
    runs
        Run with derivatives by experiment, at the times of the data.
    residuals
        Weighted residuals (N,): (model - data) / sigma, with the best scales and offsets; 0 for
        data that are left out.
    coefficients
        Best scales, then offsets, (L,).
    projected_jacobian
        Exact derivatives (N, K) of `residuals` with respect to `values`, where scales and offsets
        follow.
    jacobian
        Derivatives (N, K + L) of the weighted residuals with respect to `values` and
        `coefficients` as independent parameters.
    is_omitted
        True (N,) for data that are left out: reactions of the runs that grow without bounds there.
    """

    values: Array
    runs: Mapping[str, Sensitivities]
    residuals: Array
    coefficients: Array
    projected_jacobian: Array
    jacobian: Array
    is_omitted: Array

    @property
    def count(self) -> int:
        """Number of compared data."""
        return int(np.sum(~self.is_omitted))

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


class FitProblem:
    """Data and model of a fit, with the derivatives of the residuals.

    Scales and offsets of sensors enter linearly and are eliminated by variable projection (Golub &
    Pereyra, Inverse Problems 19 (2003) R1, doi:10.1088/0266-5611/19/2/201): with the weighted
    residuals r = A(x) c + f(x) - d, where x are the parameters of the model and the shifts, and c
    the scales and offsets, the best c for a given x is c = A^+ (d - f), and

        r' = P (A' c + f') - (A^+)^T A'^T r,    P = 1 - A A^+,

    is the exact derivative of the remaining residuals (the second term is the one that the
    approximation of Kaufman omits).

    Parameters
    ----------
    model, data, by, integrator, sigma, parameters, start, experiments, scale, offset, shift,
    data_columns
        See `fit`.

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
    first_values
        First values (K,) of the parameters of the model and of the shifts.
    build_warnings
        Kinds of the warnings that the first models issued; see `kind_of_message`.
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
        scale: Any = (),
        offset: Any = (),
        shift: Any = (),
        data_columns: Any = None,
    ) -> None:
        self.names = require_parameters("fit", model, by)
        self.model, self.start = model, start
        self.integrator = require_integrator(
            "fit", DERIVATIVE_METHOD if integrator is None else integrator
        )
        self.parameters = complete_parameters("fit", model, parameters)
        measured = read_measurements("fit", data, data_columns)
        self._settings = self._read_experiments(experiments, measured.experiments)
        self.build_warnings: set[str] = set()
        self._set_data(read_fit_data(measured, self._observed_headers(), sigma))
        self.sensors: Sensors = read_sensors(self.data.series, self.headers, scale, offset, shift)
        if not self.sensors.scales:
            pairs = zip(self.data.series, self.headers, strict=True)
            warn_of_missing_units("fit", measured, [MeasuredColumn(*x) for x in pairs])
        self.first_values = np.array(
            [self.parameters[name] for name in self.names]
            + [float(np.clip(0.0, *shift.bounds)) for shift in self.sensors.shifts]
        )
        if self.data.count < (count := len(self.variables) + len(self.coefficients)):
            raise BeamdaeError(
                f"fit: {self.data.count} data do not determine {count} parameters; add data "
                "or fit fewer parameters."
            )
        self._t_end = self._latest_times()
        for sentence in self.duration_warnings:
            warn_user(f"fit: {sentence}", InputWarning, merges=False)

    def _set_data(self, data: FitData) -> None:
        self.data = data
        self._times = np.concatenate([x.times for x in data.series])
        self._values = np.concatenate([x.values for x in data.series])
        self.weights = 1.0 / np.concatenate([x.sigma for x in data.series])

    def with_first_data(self, share: float) -> FitProblem:
        """Return a problem with the data of the first `share` of the time of each series."""
        other = copy.copy(self)
        other._set_data(self.data.first(share))
        rows = [
            np.arange(x.start, x.start + len(part.values))
            for (_, _, x), part in zip(self.rows_by_series(), other.data.series, strict=True)
        ]
        other.sensors = self.sensors.of_rows(np.concatenate(rows))
        other._t_end = other._latest_times()
        return other

    @property
    def headers(self) -> tuple[str, ...]:
        """Header of the observed column of each series of `data`."""
        return self.data.headers

    @property
    def weighted_square(self) -> float:
        """Sum of the squares of the data in standard deviations."""
        return float(np.sum((self._values * self.weights) ** 2))

    @property
    def last_time(self) -> float:
        """Longest end time of the runs [s]."""
        return max(self._t_end.values())

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the parameters that the search varies: of the model, then shifts."""
        return (*self.names, *(x.name for x in self.sensors.shifts))

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the parameters that are solved for linearly: scales, then offsets."""
        return tuple(x.name for x in self._linear)

    @property
    def _linear(self) -> tuple[Sensor, ...]:
        return (*self.sensors.scales, *self.sensors.offsets)

    def _read_experiments(
        self, experiments: Any, known: tuple[str, ...]
    ) -> dict[str, dict[str, Any]]:
        """Return the values of parameters that each experiment changes."""
        what = "a dict of values of parameters by experiment"
        given = require_mapping(
            "fit", "experiments", {} if experiments is None else experiments, what
        )
        for name, values in given.items():
            if name not in known:
                raise BeamdaeError(
                    f"fit: experiments contains {short_repr(name)}, for which there are no data; "
                    f"the data name {', '.join(filter(None, known)) or 'no experiments'}."
                )
            values = require_mapping("fit", f"experiments of {name}", values, "values by name")
            fitted = next((x for x in values if x in self.names), None)
            if fitted is not None:
                raise BeamdaeError(
                    f"fit: the experiment {name} sets {fitted}, which is in by; remove it from "
                    "one of them."
                )
            given[name] = {x: self.model.complete({x: values[x]})[x] for x in values}
        return {name: given.get(name, {}) for name in known}

    def _observed_headers(self) -> dict[str, list[str]]:
        """Return the headers of the observed columns by experiment."""
        observed: dict[str, list[str]] = {}
        for experiment, values in self._settings.items():
            mechanism = self.model(**{**self.parameters, **values})
            equations = as_equations("fit", mechanism, self.start)
            self.build_warnings.update(map(kind_of_message, equations.build_warnings))
            observed[experiment] = equations.observed_headers
        return observed

    def _latest_times(self) -> dict[str, float]:
        """Return the last time at which the run of each experiment may be compared [s]."""
        latest = self._times.copy()
        for shift in self.sensors.shifts:
            latest[shift.rows] -= shift.bounds[0]
        ends = {
            experiment: float(latest[self._rows_of(experiment)].max())
            for experiment in self.data.experiments
        }
        if min(ends.values()) <= 0.0:
            raise BeamdaeError(
                "fit: the times of data must be finite and ascend, beyond 0 s; add later data."
            )
        if self._times.max() > _MAX_DURATION * self.model.t_end:
            end, advice = self._describe_end()
            raise BeamdaeError(
                f"fit: the data end at {end}, far after the end time of {self.model.name}, "
                f"{self.model.t_end:g} s; {advice}, subtract the "
                "first time from all times, or change t_end of the model."
            )
        return ends

    def _describe_end(self) -> tuple[str, str]:
        """Return the last time of the data in their unit, and advice to check the unit."""
        series = max(self.data.series, key=lambda x: float(x.times[-1]))
        last, unit = float(series.times[-1]), split_unit(series.time_header)[1]
        if not unit:
            return f"{last:g} s", "check that their times are in seconds"
        factor = float(conversion_factor(unit, "s") or 1.0)
        end = f"{last:g} s" if factor == 1.0 else f"{last / factor:g} {unit} ({last:g} s)"
        return end, f"check the unit in the header {series.time_header!r} of their times"

    @property
    def duration_warnings(self) -> tuple[str, ...]:
        """Sentence on data that end after the end time of the model, or long before it."""
        last, t_end = self._times.max(), self.model.t_end
        if _MIN_USUAL_DURATION * t_end <= last <= _MAX_USUAL_DURATION * t_end:
            return ()
        end, advice = self._describe_end()
        of_model = f"the end time of {self.model.name}, {t_end:g} s"
        if last < t_end:
            return (f"The data end at {end}, long before {of_model}; {advice}.",)
        if any(not split_unit(x.time_header)[1] for x in self.data.series):
            return (f"The data end at {end}, after {of_model}; {advice}.",)
        return (f"The data end at {end}, after {of_model}; the runs continue until then.",)

    def rows_by_series(self) -> Iterator[tuple[Series, str, slice]]:
        """Yield the series of `data` with their headers and rows."""
        end = 0
        for series, header in zip(self.data.series, self.headers, strict=True):
            begin, end = end, end + len(series.values)
            yield series, header, slice(begin, end)

    def _rows_of(self, experiment: str) -> Array:
        numbers = np.arange(self.data.count)
        rows = self.rows_by_series()
        return np.concatenate(
            [numbers[x] for series, _, x in rows if series.experiment == experiment]
        )

    def evaluate(self, values: Array) -> Evaluation:
        """Run all experiments at the given values (K,) and compare them with the data.

        Raises
        ------
        BeamdaeError
            If a run fails or cannot be differentiated.
        """
        times = self._shift_times(values)
        runs = {x: self._run(x, values, times) for x in self.data.experiments}
        solutions = {x: run.solution for x, run in runs.items()}
        model, is_omitted = self._read(solutions, times)
        derivatives = self._differentiate(runs, times)
        return self._project(values, runs, model, derivatives, is_omitted)

    def change_of_residuals(
        self,
        evaluation: Evaluation,
        change: Callable[[EquationsOfMotion], Any],
        method: Integrator,
    ) -> Array:
        """Return the change of the residuals (N,) of an evaluation in runs with another method.

        `change` returns the mechanism that takes the place of that of the equations.

        Raises
        ------
        BeamdaeError
            If a run fails.
        """
        times = self._shift_times(evaluation.values)
        solutions = {}
        for experiment, run in evaluation.runs.items():
            with warnings.catch_warnings(), skip_result_checks():
                warnings.simplefilter("ignore", BeamdaeWarning)
                mechanism = change(run.solution.equations)
                t_end = self._t_end[experiment]
                other = simulate(mechanism, method, t_end, start=self.start, keep_steps=True)
                if other.trajectory.end < t_end:
                    raise BeamdaeError(f"fit: the run was {other.status.sentence}.")
                solutions[experiment] = other.at_times(self._needed_times(experiment, times))
        model, is_omitted = self._read(solutions, times)
        derivatives = np.zeros((len(times), len(self.variables)))
        compared = self._project(evaluation.values, {}, model, derivatives, is_omitted)
        is_omitted = is_omitted | evaluation.is_omitted
        return np.where(is_omitted, 0.0, compared.residuals - evaluation.residuals)

    @property
    def units_of_variables(self) -> dict[str, str]:
        """Units of the parameters that the search varies, by name; "-" if a unit is unknown."""
        info = self.model.parameter_info
        units = [info[name].unit for name in self.names] + [x.unit for x in self.sensors.shifts]
        return {name: unit or "-" for name, unit in zip(self.variables, units, strict=True)}

    def start_of(self, equations: EquationsOfMotion) -> Any:
        """Return the start of the runs of a model."""
        mechanism = equations.mechanism
        return self.start if self.start is not None or mechanism is None else mechanism.start

    def _shift_times(self, values: Array) -> Array:
        """Return the times (N,) of the runs at which they are compared with the data."""
        times = self._times.copy()
        shifts = values[len(self.names) :]
        for shift, value in zip(self.sensors.shifts, shifts, strict=True):
            times[shift.rows] -= value
        return times

    def _parameters(self, experiment: str, values: Array) -> dict[str, Any]:
        """Return all parameters of the model in an experiment."""
        fitted = dict(zip(self.names, values.tolist(), strict=False))
        return {**self.parameters, **self._settings[experiment], **fitted}

    def _needed_times(self, experiment: str, times: Array) -> Array:
        """Return the ascending times of the rows of an experiment, within its run."""
        needed = np.unique(times[self._rows_of(experiment)])
        # Bounds of shifts hold up to rounding.
        return np.unique(np.clip(needed, 0.0, self._t_end[experiment]))

    def recorded_values(self, evaluation: Evaluation) -> Array:
        """Return the recorded values (N,) that an evaluation predicts, or those left out."""
        return self._values + evaluation.residuals / self.weights

    def accepts(self, values: Array) -> bool:
        """Return True if the equations of all experiments can be assembled with values (K,)."""
        fitted = dict(zip(self.names, values.tolist(), strict=False))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", BeamdaeWarning)
            try:
                for changes in self._settings.values():
                    mechanism = self.model(**{**self.parameters, **changes, **fitted})
                    as_equations("fit", mechanism, self.start)
            except (ValueError, ArithmeticError):
                # BeamdaeError, or an error of the model function at extreme values.
                return False
        return True

    def weighted_rates(self, evaluation: Evaluation) -> Array:
        """Return the time derivatives (N,) of the recorded values over the sigma of the data."""
        rates = {x: column_rates(run.solution) for x, run in evaluation.runs.items()}
        result = np.empty(len(self._times))
        for series, header, rows in self.rows_by_series():
            run = evaluation.runs[series.experiment]
            at = _nearest_rows(run.t, self._times[rows])
            result[rows] = rates[series.experiment][header][at]
        for sensor, scale in zip(self.sensors.scales, evaluation.coefficients, strict=False):
            result[sensor.rows] *= scale
        return np.where(evaluation.is_omitted, 0.0, result * self.weights)

    def _run(self, experiment: str, values: Array, times: Array) -> Sensitivities:
        t_end = self._t_end[experiment]
        # The result evaluates the warnings of the last run.
        with warnings.catch_warnings(), skip_result_checks():
            warnings.simplefilter("ignore", BeamdaeWarning)
            run = differentiate_run(
                self.model,
                self.names,
                self.integrator,
                t_end,
                parameters=self._parameters(experiment, values),
                start=self.start,
                needs_high_order=False,
            )
            needed = self._needed_times(experiment, times)
            end = run.solution.trajectory.end
            if end < t_end:
                raise BeamdaeError(
                    f"fit: the run of {self.model.name} was {run.solution.status.sentence}, before "
                    f"the last data at {needed[-1]:g} s; omit later data, or do not stop the run."
                )
            return run.at_times(needed)

    def _read(self, runs: Mapping[str, Solution], times: Array) -> tuple[Array, Array]:
        """Return the model at the times of the data, (N,), and True (N,) for data to leave out."""
        model, is_omitted = np.empty(len(times)), np.zeros(len(times), bool)
        is_unbounded = {name: np.isnan(run.lam).any(axis=1) for name, run in runs.items()}
        for series, header, rows in self.rows_by_series():
            run = runs[series.experiment]
            at = _nearest_rows(run.t, times[rows])
            model[rows] = run.columns[header][at]
            is_omitted[rows] = np.isnan(model[rows]) & is_unbounded[series.experiment][at]
        return model, is_omitted

    def _differentiate(self, runs: Mapping[str, Sensitivities], times: Array) -> Array:
        """Return the derivatives (N, K) of the model at the times of the data."""
        derivatives = np.zeros((len(times), len(self.variables)))
        rates = {x: column_rates(run.solution) for x, run in runs.items() if self.sensors.shifts}
        for series, header, rows in self.rows_by_series():
            run = runs[series.experiment]
            at = _nearest_rows(run.t, times[rows])
            for j, name in enumerate(self.names):
                derivatives[rows, j] = run.sensitivity(header, name).to_numpy()[at]
            for j, shift in enumerate(self.sensors.shifts, len(self.names)):
                if rows.start in shift.rows:
                    derivatives[rows, j] = -rates[series.experiment][header][at]
        return derivatives

    def _project(
        self,
        values: Array,
        runs: Mapping[str, Sensitivities],
        model: Array,
        derivatives: Array,
        is_omitted: Array,
    ) -> Evaluation:
        """Solve for scales and offsets, and differentiate the remaining residuals."""
        weights, scales = np.where(is_omitted, 0.0, self.weights), self.sensors.scales
        model = np.where(is_omitted, 0.0, model)
        derivatives = np.where(is_omitted[:, None], 0.0, derivatives)
        matrix = np.zeros((len(model), len(self._linear)))
        is_scaled = np.zeros(len(model), bool)
        for j, sensor in enumerate(self._linear):
            is_scale = j < len(scales)
            matrix[sensor.rows, j] = ((model if is_scale else 1.0) * weights)[sensor.rows]
            is_scaled[sensor.rows] |= is_scale
        weighted = derivatives * weights[:, None]
        remainder = (self._values - np.where(is_scaled, 0.0, model)) * weights
        # Columns of equal size, so that the rank does not depend on units.
        sizes = column_lengths(matrix)
        inverse = np.linalg.pinv(matrix / sizes) / sizes[:, None]
        coefficients = inverse @ remainder
        residuals = matrix @ coefficients - remainder
        factors = np.ones(len(model))
        for sensor, scale in zip(scales, coefficients, strict=False):
            factors[sensor.rows] = scale
        scaled = weighted * factors[:, None]
        projected = scaled - matrix @ (inverse @ scaled)
        for j, sensor in enumerate(scales):
            rows = sensor.rows
            projected -= np.outer(inverse[j], weighted[rows].T @ residuals[rows])
        jacobian = np.hstack([scaled, matrix])
        return Evaluation(values, runs, residuals, coefficients, projected, jacobian, is_omitted)


class Scaling:
    """Map between the variables x of the search and the values of the parameters.

    Variables are 1 at first values v0. They are 1 + log(v / v0) for parameters in `log`,
    1 + (v - v0) / size for shifts and first values of zero, and otherwise like logarithms, but
    linear through zero: 1 + asinh(v / v0 sinh(c)) - c.

    Attributes
    ----------
    first
        First variables (K,), inside the bounds.
    limits
        Lower and upper bounds of the variables, (K,) each.
    bounds
        Lower and upper bounds of the values, (K,) each.
    bound_texts
        Lower and upper bounds by name, as given or with units.
    is_log
        True (K,) for parameters in `log`.
    sizes
        Absolute first values (K,), or typical sizes of shifts and of first values of zero.
    """

    def __init__(self, problem: FitProblem, bounds: Any, log: Any) -> None:
        names, values = problem.names, problem.first_values
        logarithmic = set(require_names("fit", "log", log, "a list of names of parameters"))
        limits = {} if bounds is None else bounds
        limits = require_mapping("fit", "bounds", limits, "a dict of (lower, upper) by name")
        for argument, given in (("log", logarithmic), ("bounds", limits)):
            unknown = next((name for name in given if name not in names), None)
            if unknown is not None:
                raise BeamdaeError(
                    f"fit: {argument} contains {short_repr(unknown)}, which is not in by; name "
                    f"one of {', '.join(names)}."
                )
        self.is_log = np.array([name in logarithmic for name in problem.variables])
        for name, value, is_log in zip(problem.variables, values, self.is_log, strict=True):
            if is_log and not value > 0.0:
                raise BeamdaeError(
                    f"fit: the first value of {name} must be positive because it is in log, got "
                    f"{value:g}; pass parameters={{{name!r}: value}}."
                )
        lower, upper = np.full((2, len(values)), [[-np.inf], [np.inf]])
        lower[self.is_log] = 0.0
        self.bound_texts: dict[str, tuple[str, ...]] = {}
        for k, name in enumerate(names):
            if name not in limits:
                continue
            unit = problem.model.parameter_info[name].unit
            ends = map(as_real, convert_bounds("fit", name, limits[name], unit))
            least, most = (np.nan if x is None else x for x in ends)
            first = float(values[k])
            require_bounds_around("fit", name, first, np.array(least), np.array(most), limits[name])
            if self.is_log[k] and -np.inf < least < 0.0:
                raise BeamdaeError(
                    f"fit: the lower bound of {name} must not be negative because it is in log, "
                    f"got {least:g}; raise the bound, or remove {name} from log."
                )
            lower[k], upper[k] = max(lower[k], least), most
            self.bound_texts[name] = tuple(
                given if isinstance(given, str) else format_with_unit(float(x), unit)
                for given, x in zip(limits[name], (least, most), strict=True)
            )
        shifts = problem.sensors.shifts
        for k, shift in enumerate(shifts, len(names)):
            lower[k], upper[k] = shift.bounds
            self.bound_texts[shift.name] = tuple(f"{x:g} s" for x in shift.bounds)
        self.bounds = lower, upper
        self._values = values
        self._is_linear = (values == 0.0) | (np.arange(len(values)) >= len(names))
        sizes = [*np.ones(len(names)), *(x.size for x in shifts)]
        self.sizes = np.where(self._is_linear, sizes, np.abs(values))
        self.limits = self.variables(lower), self.variables(upper)
        self.first = self.start(values)

    def start(self, values: Array) -> Array:
        """Return the variables at which a search from values (K,) begins, inside the bounds."""
        return self.inside(self.variables(values))

    def inside(self, x: Array) -> Array:
        """Return variables (K,) inside the bounds: searches do not continue from a bound."""
        lower, upper = self.limits
        distance = _START_DISTANCE * np.minimum(upper - lower, 1.0)
        return np.clip(x, lower + distance, upper - distance)

    def distances(self, values: Array) -> tuple[Array, Array]:
        """Return the distances (K,) of values from their bounds, in first values or variables."""
        x = self.variables(values)
        below, above = (np.abs(values - bound) / self.sizes for bound in self.bounds)
        return np.minimum(below, x - self.limits[0]), np.minimum(above, self.limits[1] - x)

    def spread(self, count: int, seed: int) -> Array:
        """Return values (count, K) distributed evenly between bounds, or between their logarithms.

        See `spread_starts`.
        """
        with np.errstate(divide="ignore"):
            lower, upper = (np.where(self.is_log, np.log(np.abs(x)), x) for x in self.bounds)
        points = spread_starts(lower, upper, count, seed)
        return np.where(self.is_log, np.exp(np.where(self.is_log, points, 0.0)), points)

    def variables(self, values: Array) -> Array:
        """Return the variables of values (K,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(self._is_linear, values - self._values, values) / self.sizes
            logarithm = np.log(ratio)
        signed = np.arcsinh(np.sinh(_LOG_ORIGIN) * ratio) - np.sign(self._values) * _LOG_ORIGIN
        return 1.0 + np.where(self._is_linear, ratio, np.where(self.is_log, logarithm, signed))

    def values(self, x: Array) -> Array:
        """Return the values of the parameters at x."""
        ratio, _ = self._ratio(x)
        values = np.where(self._is_linear, self._values, 0.0) + self.sizes * ratio
        # Bounds are exact, as values at which profiles end.
        for limit, bound in zip(self.limits, self.bounds, strict=True):
            values = np.where(x == limit, bound, values)
        return values

    def derivatives(self, x: Array) -> Array:
        """Return the derivatives of the values with respect to x, (K,)."""
        return self.sizes * self._ratio(x)[1]

    def _ratio(self, x: Array) -> tuple[Array, Array]:
        """Return ratios of values to their sizes, and the derivatives of these."""
        change = x - 1.0
        # Long steps overflow: models reject infinite values.
        with np.errstate(over="ignore"):
            logarithm = np.exp(np.where(self.is_log, change, 0.0))
            shifted = change + np.sign(self._values) * _LOG_ORIGIN
            signed, slope = (f(shifted) / np.sinh(_LOG_ORIGIN) for f in (np.sinh, np.cosh))
        ratio = np.where(self._is_linear, change, np.where(self.is_log, logarithm, signed))
        slope = np.where(self._is_linear, 1.0, np.where(self.is_log, logarithm, slope))
        return ratio, slope


def unexplained_share(problem: FitProblem, evaluation: Evaluation) -> float:
    """Return the sum of squares relative to that of the data about their means."""
    square = evaluation.chi_square
    return square / problem.data.variation if problem.data.variation else np.inf * bool(square)


def is_noise(residuals: Array) -> bool:
    """Return True if consecutive residuals are not alike."""
    square = float(residuals @ residuals)
    return float(residuals[1:] @ residuals[:-1]) <= MAX_NOISE_CORRELATION * square


def _nearest_rows(times: Array, needed: Array) -> Array:
    """Return the rows at needed times, which are among the times up to rounding."""
    return np.minimum(np.searchsorted(times, needed), len(times) - 1)


def column_lengths(matrix: Array) -> Array:
    """Return the Euclidean lengths of columns; 1 for those that are zero."""
    lengths = np.linalg.norm(matrix, axis=0)
    return np.where(lengths == 0.0, 1.0, lengths)


def column_rates(run: Solution) -> dict[str, Array]:
    """Return the time derivatives (k,) of the observed columns at the times of a run, by header.

    With an observable y(t, q, v, a, lam), these are y_t + y_q q' + y_v v' + y_a a' + y_lam lam',
    where the rates are the derivatives of the dense output. They are therefore the exact
    derivatives of the interpolated columns; at an accepted step, those of the step that ends there.
    """
    equations, trajectory = run.equations, run.trajectory
    times, at = trajectory.at(run.t)
    rate = trajectory.derivative_at(run.t)
    # Rates of (t, branch): laws do not change their piece.
    clock = np.broadcast_to([1.0, 0.0], times.shape)
    result: dict[str, Array] = {}
    numbers = trajectory.observed_numbers(equations, run.t)
    for o in equations.observables:
        p, lam, count = numbers(o.data), at.lam[:, o.rows], len(o.columns)
        q, v, dq, dv = (np.asarray(o.operator @ x.T).T for x in (at.q, at.v, rate.q, rate.v))
        arguments, rates = [times, q, v, p, lam], {0: clock, 1: dq, 2: dv, 4: rate.lam[:, o.rows]}
        if o.has_accelerations:
            local, rates[5] = (np.asarray(o.operator @ x.T).T for x in (at.a, rate.a))
            arguments.append(local)
        values = np.zeros((len(times), count))
        for argument, along in rates.items():
            jacobian = o.function.derivative(argument)(*arguments)
            shape = (len(times), along.shape[1], count)
            values += np.einsum("rij,ri->rj", jacobian.reshape(shape), along)
        result |= dict(zip(o.headers, values.T, strict=True))
    return result
