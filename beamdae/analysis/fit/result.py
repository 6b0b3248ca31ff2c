"""Result of a fit: estimates, covariance, predictions, profiles, tables, plots and pages."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import chdtr, chdtrc, stdtrit

from beamdae import deferred
from beamdae.analysis.fit.data import Series
from beamdae.analysis.fit.intervals import bounded_interval
from beamdae.analysis.fit.problem import (
    MAX_NOISE_CORRELATION,
    MIN_SINGULAR_RATIO,
    Evaluation,
    FitProblem,
    Scaling,
)
from beamdae.analysis.fit.profile import ProfileLikelihood, trace_profile
from beamdae.analysis.fit.residual_causes import suggest_causes
from beamdae.analysis.fit.search import (
    MAX_RELATIVE_DEVIATION,
    MIN_RELATIVE_RESIDUAL,
    SearchResult,
)
from beamdae.analysis.sensitivities.sensitivities import Sensitivities
from beamdae.equations import measures
from beamdae.errors import BeamdaeError, kind_of_message, require_choice, warn_user
from beamdae.interrupts import acknowledge
from beamdae.model_parameters import split_unit
from beamdae.read_only import read_only_data
from beamdae.results.columns import require_one_column, select_observed_columns
from beamdae.results.displays import Plot, load_views
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution
from beamdae.results.storage.files import require_file_path, write_escaped_table

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Quantile of the normal distribution for intervals of 95 %, and its probability.
_NORMAL_QUANTILE = 1.959964
_UPPER_PROBABILITY = 0.975
# Format of numbers in notebooks.
_DIGITS = "{:.5g}".format
# Changes of parameters below this ratio to their first value are relative to the first value.
_MIN_RELATIVE_VALUE = 1e-3
# Changes of the estimates by refined runs, in standard deviations, that are reported, and those
# at which recommended settings aim.
_MAX_SHIFT, _AIM_OF_SHIFT = 0.4, 0.1
# Searches with a larger difference of their sums of squares, in variances, have other minima.
_MAX_SUM_DIFFERENCE = 0.1
# Data with smaller errors, relative to their size, are computed: the runs are as accurate.
_MIN_RELATIVE_SIGMA = 1e-6
# If larger values of chi-square are less probable, the model does not explain the data; if smaller
# ones are, sigma is too large.
_MIN_PROBABILITY = 1e-6
# Probability of larger values of chi-square below which the model is doubtful.
_MIN_USUAL_PROBABILITY = 1e-3
# From this ratio of sigma to the residuals of a column, sigma is reported.
_MAX_SIGMA_RATIO = 1.4
# Share of the variation of the data that the residuals of a known sigma leave at a local minimum.
_MIN_LOCAL_SHARE = 0.2
# Residuals below this ratio to the standard deviation of the data may be errors of the runs.
_MAX_NOISELESS_RATIO = 1e-3
# Numbers of data from which their noise is judged.
_MIN_NOISE_COUNT = 10
# Outliers are this many robust standard deviations away; at most one in ten data is an outlier.
_OUTLIER_DISTANCE = 6.0
_MAX_OUTLIER_SHARE = 0.1
_NORMAL_DEVIATION = 1.4826  # standard deviation of normal noise by the median of its magnitude
_MAX_NAMED_OUTLIERS = 3
# Share of chi-square of outliers that explain a large value.
_MIN_OUTLIERS_SHARE = 0.5
# Ratio of the scatter of two series from which equal weights are reported.
_MAX_SCATTER_RATIO = 3.0
# Singular values of the Jacobian with columns of unit length at which two estimates have a
# correlation of 0.99: s^2 = 1 - 0.99.
_MIN_INDEPENDENCE = 0.1
# Parameters with smaller shares of a direction are not named.
_MIN_NAMED_SHARE = 0.05


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Result of `fit`: estimates with covariance, and what the data do not determine.

    Attributes
    ----------
    parameters
        Estimated values of the parameters of the model by name.
    sensors
        Estimated shifts [s], scales and offsets by name, such as "offset of gauge 1".
    covariance
        Covariance matrix (k, k) of the estimates in the order of `names`, in their units: the
        inverse of J^T J, where J is the Jacobian of `residuals`. Variances of parameters that can
        change without an effect on the fitted columns are infinite. Those of the others hold fixed
        the estimates at a bound, the parameters whose intervals reach both of their bounds, and
        those that keep their first values because the data do not determine them.
    sensitivities
        Run with the estimates and its derivatives by experiment, at the times of the data. The
        experiment of data without names of experiments is "".
    residuals
        (model - data) / sigma of all data that are not missing, in the order of
        `residual_table`; 0 where reactions of the model grow without bounds, which leaves these
        data out.
    sigma
        Standard deviation of the errors of each fitted column, by header: as given, its root mean
        square if it varies, or estimated from the residuals if it was not given.
    is_sigma_known
        False if `sigma` was estimated from the residuals.
    evaluations
        Number of evaluations, each with one run with derivatives per experiment, in the search from
        the best start.
    status
        Status and reason of the end of the search: "ok" if it converged, "limited" if it ended
        before a minimum or explains less than half of the variation of the data, and
        "interrupted".
    undetermined
        Sentences that name combinations of parameters which the data do not determine: those with a
        relative standard deviation above 100 %, in which the estimates stay close to the first
        values, and those with correlations above 0.99.
    at_bounds
        Names of parameters at a bound, which have no standard deviations.
    """

    parameters: Mapping[str, float]
    sensors: Mapping[str, float]
    covariance: Array
    sensitivities: Mapping[str, Sensitivities]
    residuals: Array
    sigma: Mapping[str, float]
    is_sigma_known: bool
    evaluations: int
    status: Status
    undetermined: tuple[str, ...] = ()
    at_bounds: tuple[str, ...] = ()
    _own_warnings: tuple[str, ...] = field(default=(), repr=False)
    # Information on all parameters, and with some of them fixed, see `covariance`.
    _full_information: Information = field(default=None, repr=False)  # type: ignore[assignment]
    _information: Information = field(default=None, repr=False)  # type: ignore[assignment]
    _jacobian: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    _problem: FitProblem = field(default=None, repr=False)  # type: ignore[assignment]
    _scaling: Scaling = field(default=None, repr=False)  # type: ignore[assignment]
    _search: SearchResult = field(default=None, repr=False)  # type: ignore[assignment]
    _starts: Any = field(default=None, repr=False)
    _last: Evaluation = field(default=None, repr=False)  # type: ignore[assignment]

    def __repr__(self) -> str:
        values = ", ".join(
            f"{name} = {value:.6g}" + ("" if np.isnan(deviation) else f" +- {deviation:.2g}")
            for name, value, deviation in zip(
                self.names, self.values, self.standard_deviations, strict=True
            )
        )
        bounds = f"; at a bound: {', '.join(self.at_bounds)}" if self.at_bounds else ""
        end = f"<Fit: {values}; {self.status.sentence}{bounds}{self._chi_square_text}>"
        return " ".join([end, *self.warnings, *self.undetermined])

    def _repr_html_(self) -> str:
        end = f"Fit of {self.model_name}: {self.status.sentence}{self._chi_square_text}"
        lines = [end, *self.warnings, *self.undetermined]
        return "<br>".join(map(html.escape, lines)) + self.table().to_html(float_format=_DIGITS)

    @property
    def _chi_square_text(self) -> str:
        """Text that follows the status: chi-square with its probability, or "" without `sigma`."""
        description = self.describe_chi_square()
        return f"; chi-square {description}" if description else ""

    def describe_chi_square(self) -> str:
        """Return chi-square, the degrees of freedom and `probability`; "" if sigma is estimated.

        Without `sigma`, chi-square is equal to the degrees of freedom by construction.
        """
        if not self.is_sigma_known:
            return ""
        return (
            f"{self.chi_square:.4g} at {self.degrees_of_freedom} degrees of freedom (probability "
            f"{self.probability:.2g})"
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all estimates: parameters of the model, then properties of sensors."""
        return (*self.parameters, *self.sensors)

    @property
    def values(self) -> Array:
        """All estimates (k,) in the order of `names`."""
        return np.array([*self.parameters.values(), *self.sensors.values()])

    @property
    def units(self) -> dict[str, str]:
        """Units of the estimates by name; "" if a unit is unknown."""
        described, sensors = self._problem.model.parameter_info, self._problem.sensors
        by_sensor = {
            sensor.name: sensor.unit
            for sensor in (*sensors.scales, *sensors.offsets, *sensors.shifts)
        }
        return {
            name: described[name].unit if name in described else by_sensor.get(name, "")
            for name in self.names
        }

    @property
    def solution(self) -> Solution:
        """Run with the estimates, at the times of the data; `plot` shows it beside the data.

        Raises
        ------
        BeamdaeError
            If there are several experiments; see `solutions`.
        """
        if len(self.sensitivities) > 1:
            raise BeamdaeError(
                f"Fit: there are several experiments ({', '.join(self.sensitivities)}); use "
                "fit.solutions[name]."
            )
        return next(iter(self.sensitivities.values())).solution

    @property
    def solutions(self) -> dict[str, Solution]:
        """Runs with the estimates by experiment, at the times of the data."""
        return {name: run.solution for name, run in self.sensitivities.items()}

    @cached_property
    def errors(self) -> Any:
        """Errors of the estimates and of the fitted columns by runs and beams, see `Errors`.

        Errors of estimates are relative to their values, those of columns to half the range of the
        data.
        """
        return deferred.module("accuracy.fits").measure_fit(self._problem, self._last)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the estimates, followed by `run_warnings`.

        Sentences on values of parameters that the model rejected, on estimates that refined runs
        would change by more than 0.4 standard deviations (see `errors`), on models that do
        not explain the data (`sigma` is known, and larger values of chi-square have a probability
        below 1e-3), on a given `sigma` of more than 1.4 times the residuals of its column (if
        smaller residuals have a probability below 1e-6), on residuals that are no white noise
        (consecutive ones have a correlation above 0.5, single ones are outliers, or, without
        `sigma`, columns or experiments scatter
        differently), on estimates at a bound, on intervals of correlated parameters whose linear
        approximation may fail (`profile` does without it), or on data that end after the end time
        of the model.
        """
        return (*self._own_warnings, *self.run_warnings)

    @cached_property
    def run_warnings(self) -> tuple[str, ...]:
        """Warnings of the runs with the estimates.

        If the search ended before a minimum, only those that the first runs also have.
        Warnings that not all experiments have begin with the name of the first one. Those
        about the output rows are omitted, because a fit compares values at the times of the data.
        """
        kinds: dict[str, dict[str, str]] = {}
        for experiment, run in self.solutions.items():
            omitted = set(run.row_warnings)
            for sentence in (x for x in run.model_warnings if x not in omitted):
                if self._is_side_effect(experiment, sentence):
                    continue
                kinds.setdefault(kind_of_message(sentence), {}).setdefault(experiment, sentence)
        sentences = []
        for by_experiment in kinds.values():
            experiment, sentence = next(iter(by_experiment.items()))
            is_everywhere = len(by_experiment) == len(self.solutions)
            sentences.append(sentence if is_everywhere else f"{experiment}: {sentence}")
        return tuple(sentences)

    def _is_side_effect(self, experiment: str, sentence: str) -> bool:
        """Return True for a warning about values of a failed search, unlike the first ones."""
        if self.status.kind != "limited" or self._search.first is None:
            return False
        first = self._search.first.runs[experiment].solution.model_warnings
        return kind_of_message(sentence) not in set(map(kind_of_message, first))

    @property
    def model_name(self) -> str:
        """Name of the model function."""
        return self._problem.model.name

    @property
    def series(self) -> list[tuple[Series, str]]:
        """Measured series, and the header of the observed column of each."""
        return list(zip(self._problem.data.series, self._problem.headers, strict=True))

    @property
    def standard_deviations(self) -> Array:
        """Standard deviations (k,) of the estimates.

        NaN for estimates at a bound, and for all if the search did not reach a minimum.
        """
        deviations = np.sqrt(np.diag(self.covariance))
        has_none = np.isin(self.names, self.at_bounds) | (not self.status.success)
        return np.where(has_none & np.isfinite(deviations), np.nan, deviations)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of compared data minus number of estimates."""
        return self._search.evaluation.count - len(self.names)

    @property
    def quantile(self) -> float:
        """Half width of 95 % intervals in standard deviations.

        1.96 of the normal distribution if `sigma` was given, otherwise that of the t distribution
        with `degrees_of_freedom`.
        """
        if self.is_sigma_known:
            return _NORMAL_QUANTILE
        return float(stdtrit(max(self.degrees_of_freedom, 1), _UPPER_PROBABILITY))

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals.

        If the model is right and `sigma` is known, it is near `degrees_of_freedom`.
        """
        return float(self.residuals @ self.residuals)

    @property
    def probability(self) -> float:
        """Probability of a larger `chi_square` if the model and `sigma` are right.

        Small values indicate a wrong model. It is NaN if `sigma` was not given.
        """
        if not self.is_sigma_known or self.degrees_of_freedom < 1:
            return float("nan")
        return float(chdtrc(self.degrees_of_freedom, self.chi_square))

    @property
    def singular_values(self) -> Array:
        """Singular values of the Jacobian of the residuals, (k,), in descending order.

        The Jacobian is taken with respect to relative changes of the parameters: 1 / s is the
        relative standard deviation of the combination of parameters that belongs to s. Changes of
        offsets are relative to half the range of their data, and changes of shifts to half the
        width of their bounds.
        """
        return self._full_information.singular

    @property
    def starts(self) -> pd.DataFrame | None:
        """Table of all searches with first values, estimates, sum of squares and status.

        None without the argument `starts` of `fit`.
        """
        return None if self._starts is None else self._starts.copy()

    def describe_starts(self) -> str:
        """Return how many of several searches ended at the estimates, or "" of one search.

        Others have a sum of squares that is larger by over 0.1 times the variance of the errors.
        """
        if self._starts is None:
            return ""
        sums = self._starts["chi-square"].dropna().to_numpy(float)
        variance = 1.0 if self.is_sigma_known else self.chi_square / max(self.degrees_of_freedom, 1)
        rounding = MIN_RELATIVE_RESIDUAL**2 * self._problem.weighted_square
        limit = sums.min(initial=np.inf) + max(_MAX_SUM_DIFFERENCE * variance, rounding)
        text = f"{np.sum(sums <= limit)} of {len(self._starts)} searches end at these estimates"
        worse = sums[sums > limit]
        if len(worse):
            text += f"; the next lowest chi-square is {worse.min():.4g}, not {sums.min():.4g}"
        return text

    def table(self) -> pd.DataFrame:
        """Return a table of estimates, standard deviations and limits of 95 % intervals.

        The limits are `quantile` standard deviations away from the estimates; for parameters in
        `log`, those of the logarithms, so that both limits are positive. If such an interval of a
        parameter would exceed its bounds, the intervals of all are those of the profile likelihood
        within the bounds, for a model that is linear about the estimates: they end at bounds, and
        are one-sided for estimates at a bound. There are no limits (NaN) if the search did not
        reach a minimum.
        """
        import pandas as pd

        lower, upper = self._limits.T
        return pd.DataFrame(
            {
                "value": self.values,
                "standard deviation": self.standard_deviations,
                "lower 95 %": lower,
                "upper 95 %": upper,
            },
            index=list(self.names),
        )

    @cached_property
    def _limits(self) -> Array:
        """Lower and upper limits (k, 2) of the 95 % intervals."""
        values, deviations = self.values, self.standard_deviations
        count = len(self._problem.variables)
        is_log = np.append(self._scaling.is_log, np.zeros(len(values) - count, bool))
        slopes = np.where(is_log, values, 1.0)
        half = self.quantile * deviations / slopes
        changes = np.stack([-half, half], axis=1)
        below, above = _distances_to_bounds(self._problem, self._scaling, values)
        if self.status.success and (self.at_bounds or np.any((half > below) | (half > above))):
            for k in range(len(values)):
                changes[k] = bounded_interval(
                    self._jacobian * slopes, self.residuals, (-below, above), k, self.quantile
                )
        with np.errstate(over="ignore"):
            factors = np.exp(np.where(is_log[:, None], changes, 0.0))
        return np.where(is_log[:, None], values[:, None] * factors, values[:, None] + changes)

    def to_csv(self, path: str | Path, *, sep: str = ",", decimal: str = ".") -> Path:
        """Write `table` and the units of the estimates as CSV and return the path.

        Parameters
        ----------
        path
            Path of the file. An existing file is replaced.
        sep, decimal
            See `Solution.to_csv`.

        Raises
        ------
        BeamdaeError
            If an argument is invalid or the file cannot be written.
        """
        table = self.table().assign(unit=list(self.units.values()))
        return write_escaped_table(path, table.reset_index(names="parameter"), sep, decimal)

    def correlations(self) -> pd.DataFrame:
        """Return the correlation matrix C_ij / sqrt(C_ii C_jj) of the estimates [-].

        C is `covariance`; rows and columns have the names of the parameters. Estimates with
        infinite variances have none (NaN).
        """
        import pandas as pd

        names, deviations = list(self.names), self.standard_deviations
        deviations = np.where(np.isfinite(deviations), deviations, np.nan)
        matrix = self.covariance / np.outer(deviations, deviations)
        return pd.DataFrame(matrix, index=names, columns=names)

    def residual_table(self) -> pd.DataFrame:
        """Return a long table of data, model and residuals, one row per measured value.

        "model" contains the recorded values that the model and the sensors predict; "residual" is
        (model - value) / sigma. Both are NaN for data that are left out.
        """
        import pandas as pd

        # Estimated standard deviations are the given ones, 1, times the estimate.
        estimate = 1.0 if self.is_sigma_known else next(iter(self.sigma.values()))
        whole = np.where(self._search.evaluation.is_omitted, np.nan, self.residuals)
        tables, end = [], 0
        for series, header in self.series:
            begin, end = end, end + len(series.values)
            residuals, sigma = whole[begin:end], estimate * series.sigma
            tables.append(
                pd.DataFrame(
                    {
                        "experiment": series.experiment,
                        "observable": header,
                        measures.TIME: series.times,
                        "value": series.values,
                        "sigma": sigma,
                        "model": series.values + residuals * sigma,
                        "residual": residuals,
                    }
                )
            )
        return pd.concat(tables, ignore_index=True)

    def prediction(self, column: str, experiment: str | None = None) -> pd.DataFrame:
        """Return an observed column of the model with its uncertainty, over time.

        The variance of the column y is g^T C g, where g are the derivatives of y with respect to
        the parameters and C their covariance. The uncertainty is that of the true column, without
        errors of sensors, and to first order in the errors of the parameters.

        Parameters
        ----------
        column
            Header of an observed column, with or without its unit. It need not be fitted.
        experiment
            Name of the experiment. May be omitted if there is only one.

        Returns
        -------
        pandas.DataFrame
            Columns "value", "standard deviation", "lower 95 %" and "upper 95 %", indexed by the
            times of the data [s].

        Raises
        ------
        BeamdaeError
            If the experiment or the column does not exist.
        """
        import pandas as pd

        names = list(self.sensitivities)
        if experiment is None and len(names) == 1:
            experiment = names[0]
        run = self.sensitivities[require_choice("prediction", "experiment", experiment, names)]
        columns = run.solution.columns
        header = require_one_column(
            "prediction", column, select_observed_columns("prediction", [column], list(columns))
        )
        derivatives = np.zeros((len(run.t), len(self.names)))
        for k, name in enumerate(self.parameters):
            derivatives[:, k] = run.sensitivity(header, name)
        deviations = self._information.standard_deviations(derivatives)
        value = columns[header]
        return pd.DataFrame(
            {
                "value": value,
                "standard deviation": deviations,
                "lower 95 %": value - self.quantile * deviations,
                "upper 95 %": value + self.quantile * deviations,
            },
            index=pd.Index(run.t, name=measures.TIME),
        )

    def profile(self, name: str, max_points: int = 20) -> ProfileLikelihood:
        """Return the profile likelihood of a parameter of the model or of a shift.

        The parameter is fixed at several values on both sides of its estimate, and all others are
        fitted again, until the sum of squares has grown by the square of `quantile`; see Raue et
        al., Bioinformatics 25 (2009) 1923, doi:10.1093/bioinformatics/btp358. The interval of the
        profile does without the linear approximation of the interval of `table`.

        Parameters
        ----------
        name
            Name of a parameter in `by`, or of a shift. Scales and offsets have none: given the
            others, they enter linearly.
        max_points
            Maximum number of values on each side of the estimate, at most 1000, each with one fit.

        Raises
        ------
        BeamdaeError
            If there is no such parameter, or a count is invalid.

        Warns
        -----
        BeamdaeWarning
            If no limit was found, with the reason.
        """
        name = require_choice("profile", "name", name, self._problem.variables)
        index = self._problem.variables.index(name)
        half_widths = np.abs(self._limits[index] - self.values[index])
        if not self.status.success:
            deviations = self._full_information.standard_deviations(np.eye(len(self.names)))
            half_widths = np.full(2, self.quantile * deviations[index])
        factor = 1.0 if self.is_sigma_known else next(iter(self.sigma.values())) ** 2
        result = trace_profile(
            self._problem,
            self._scaling,
            self._search,
            name,
            half_widths,
            factor,
            self.quantile,
            max_points,
        )
        for sentence in result.warnings:
            warn_user(sentence)
        return result

    def plot(self) -> Plot:
        """Plot data and model, and the residuals in standard deviations, over time.

        Returns
        -------
        Plot
            The figure, displayed by a notebook; `Plot.save` writes it to a file. At most six series
            are drawn.
        """
        return load_views().plot_fit(self)

    def page(self, path: str | Path) -> Path:
        """Write an HTML page with estimates, curves of data and model, and the animated motion.

        The data on the page are corrected by the estimated shifts, offsets and scales.

        Parameters
        ----------
        path
            Path of the file.

        Raises
        ------
        BeamdaeError
            If the file cannot be written.
        """
        write: Any = deferred.module("report.fit_page").write_fit_page
        return Path(write(self, require_file_path("page", path)))

    def sensor_of(self, series: int) -> tuple[float, float, float]:
        """Return the estimated shift [s], scale and offset of a series, by its number in the data.

        They are 0, 1 and 0 unless they were fitted.
        """
        begin = sum(len(x.values) for x, _ in self.series[:series])
        values = []
        sensors = self._problem.sensors
        for kind, default in ((sensors.shifts, 0.0), (sensors.scales, 1.0), (sensors.offsets, 0.0)):
            fitted = (self.sensors[x.name] for x in kind if begin in x.rows)
            values.append(next(fitted, default))
        shift, scale, offset = values
        return shift, scale, offset


@read_only_data
@dataclass(frozen=True, eq=False)
class Information:
    """Singular value decomposition of the Jacobian of the residuals.

    Attributes
    ----------
    singular
        Singular values (k,) for relative changes of the parameters, in descending order.
    directions
        Orthonormal relative changes (k, k) of the parameters, one row per singular value.
    sizes
        Sizes (k,) to which changes are relative; 0 for fixed parameters.
    """

    singular: Array
    directions: Array
    sizes: Array

    @classmethod
    def of(cls, jacobian: Array, sizes: Array) -> Information:
        """Return the decomposition of a Jacobian (n, k) of weighted residuals."""
        _, singular, directions = np.linalg.svd(jacobian * sizes, full_matrices=False)
        return cls(singular, directions, sizes)

    @cached_property
    def is_dependent(self) -> Array:
        """True (k,) for directions without an effect on the residuals."""
        return np.asarray(self.singular <= MIN_SINGULAR_RATIO * self.singular[0])

    @property
    def covariance(self) -> Array:
        """Covariance (k, k) of the parameters; undetermined ones have infinite variances."""
        with np.errstate(divide="ignore"):
            variances = np.where(self.is_dependent, 0.0, 1.0 / self.singular**2)
        covariance = (self.directions.T * variances) @ self.directions
        # Parameters that take part in a direction without any effect are undetermined.
        shares = np.abs(self.directions[self.is_dependent]).max(axis=0, initial=0.0)
        for k in np.flatnonzero((shares > _MIN_NAMED_SHARE) & (self.sizes != 0.0)):
            covariance[k, k] = np.inf
        return np.asarray(covariance * np.outer(self.sizes, self.sizes))

    def standard_deviations(self, derivatives: Array) -> Array:
        """Return the standard deviations (j,) of quantities with derivatives (j, k).

        They are infinite if a direction without an effect on the residuals changes the quantity.
        """
        along = (derivatives * self.sizes) @ self.directions.T
        largest = np.abs(along).max(axis=1, initial=0.0, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            terms = np.where(np.abs(along) > _MIN_NAMED_SHARE * largest, np.inf, 0.0)
            terms = np.where(self.is_dependent, terms, along / self.singular)
        return np.asarray(np.sqrt((terms**2).sum(axis=1)))

    def undetermined(
        self, texts: Mapping[str, str], free: Information | None = None
    ) -> tuple[str, ...]:
        """Return sentences on combinations of parameters that the data do not determine.

        Correlations are those of `free`, in which some parameters may be fixed.

        Parameters
        ----------
        texts
            Format of a change by name, for example "stiffness by {:+.2g} %", of which the number
            is a hundred times the relative change. In the order of the parameters.
        """
        sentences, named = [], []
        for s, direction, dependent in zip(
            self.singular, self.directions, self.is_dependent, strict=True
        ):
            if not dependent and s * MAX_RELATIVE_DEVIATION >= 1.0:
                continue
            # Relative to the largest share, whose sign is positive.
            largest = direction[np.argmax(np.abs(direction))]
            direction = direction / largest
            size = 1.0 if dependent else 100.0 * abs(largest) / s
            shares = [
                text.format(size * share)
                for text, share in zip(texts.values(), direction, strict=True)
                if abs(share) > _MIN_NAMED_SHARE
            ]
            named.append(np.abs(direction) > _MIN_NAMED_SHARE)
            effect = (
                "do not change the fitted columns"
                if dependent
                else "lie within one standard deviation"
            )
            subject = "Changes of" if len(shares) == 1 else "Joint changes of"
            sentences.append(f"{subject} {', '.join(shares)} {effect}.")
        free = self if free is None else free
        for members in free._correlated():
            if any(np.all(other[members]) for other in named):
                continue
            *others, last = (name for name, is_in in zip(texts, members, strict=True) if is_in)
            subject = f"The data hardly distinguish the effects of {', '.join(others)} and {last}"
            factor = float(np.sqrt(free._variance_inflation[members].max()))
            if (
                free.is_dependent[: np.count_nonzero(free.sizes)].any()
                and factor < 0.5 / _MIN_INDEPENDENCE
            ):
                # Dependent combinations contribute to this one, and have no standard deviations.
                sentences.append(f"{subject} (correlation above 0.99).")
                continue
            correlation = np.sqrt(1.0 - 1.0 / factor**2)
            kind, rest = "correlation", "the other was"
            if np.count_nonzero(free.sizes) > 2:
                kind, rest = "multiple correlation", "all other parameters were"
            sentences.append(
                f"{subject} ({kind} {correlation:.4f}): their standard deviations are up to "
                f"{factor:.2g} times as large as if {rest} known."
            )
        return tuple(sentences)

    def nonlinear(self) -> Array:
        """Return True (k,) for correlated parameters whose intervals may be far from linear.

        A change by one standard deviation d, relative to the parameter, changes the residuals by
        the ratio r of d to the deviation with all others known. Their curvature is about d r.
        """
        variances = np.diag(self.covariance) / np.where(self.sizes, self.sizes, 1.0) ** 2
        is_correlated = np.any([np.zeros(len(self.sizes), bool), *self._correlated()], axis=0)
        # Infinite intervals hold.
        squares = np.where(np.isfinite(variances), variances, 0.0) * self._variance_inflation
        return np.asarray(is_correlated & (squares > MAX_RELATIVE_DEVIATION**2))

    @property
    def _variance_inflation(self) -> Array:
        """Ratios (k,) of the variances of parameters to those with all others known.

        The multiple correlation coefficient of an estimate with all others is sqrt(1 - 1 / ratio).
        """
        jacobian = self.singular[:, None] * self.directions
        is_known = ~self.is_dependent
        inverse = self.directions[is_known] / self.singular[is_known, None]
        return np.asarray((inverse**2).sum(axis=0) * (jacobian**2).sum(axis=0))

    def _correlated(self) -> list[Array]:
        """Return the members (k,) of combinations with nearly dependent effects."""
        jacobian = self.singular[:, None] * self.directions
        lengths = np.linalg.norm(jacobian, axis=0)
        # The direction of a negligible effect is arbitrary.
        kept = np.flatnonzero(lengths * MAX_RELATIVE_DEVIATION >= 1.0)
        _, singular, directions = np.linalg.svd(jacobian[:, kept] / lengths[kept])
        shares = np.zeros((len(kept), len(lengths)))
        shares[:, kept] = np.abs(directions)
        groups = [
            x > _MIN_NAMED_SHARE * x.max()
            for s, x in zip(singular, shares, strict=True)
            if s < _MIN_INDEPENDENCE
        ]
        return [x for x in groups if x.sum() > 1]


def create_fit(
    problem: FitProblem,
    scaling: Scaling,
    search: SearchResult,
    starts: Any,
) -> Fit:
    """Return the result at the last values of a search."""
    evaluation, names = search.evaluation, problem.variables
    all_names = (*names, *problem.coefficients)
    estimates = np.concatenate([evaluation.values, evaluation.coefficients])
    residuals, jacobian = evaluation.residuals, evaluation.jacobian
    estimate = 1.0
    sigma = _column_sigma(problem)
    if not problem.data.is_sigma_known:
        freedom = max(evaluation.count - len(all_names), 1)
        # Data computed by the model itself have no residuals, but rounding errors.
        largest = max(float(np.abs(x.values).max()) for x in problem.data.series)
        rounding = float(np.finfo(float).eps) * (largest or 1.0)
        estimate = max(float(np.sqrt(residuals @ residuals / freedom)), rounding)
        residuals, jacobian = residuals / estimate, jacobian / estimate
        sigma = {name: x * estimate for name, x in sigma.items()}
    sizes, texts = _sizes(problem, all_names, estimates)
    full = Information.of(jacobian, sizes)
    is_fixed = _find_fixed(problem, scaling, search, estimates, full)
    information = Information.of(jacobian, np.where(is_fixed, 0.0, sizes))
    # Fixed estimates keep the variances of the complete fit.
    variances = np.where(is_fixed, np.diag(full.covariance), np.diag(information.covariance))
    covariance = information.covariance
    np.fill_diagonal(covariance, variances)
    status = search.status
    if not search.explains:
        causes = suggest_causes(problem, evaluation, search.first)
        advice = "check signs, units and times of the data and start=, or start from other values"
        status = Status("limited", f"{status.sentence}; {causes}{advice}")
    steps: tuple[str, ...] = ()
    errors = None
    # Residuals far above sigma, perhaps in a wrong unit, are no errors of the steps.
    scatter = float(np.sqrt(np.mean(residuals**2)))
    if status.kind != "interrupted" and search.explains:
        try:
            if not _are_computed(problem, estimate * max(1.0, scatter)):
                errors = deferred.module("accuracy.fits").measure_fit(problem, evaluation)
                steps = _check_errors(evaluation, errors, estimate, max(1.0, scatter))
        except KeyboardInterrupt:
            acknowledge()
            status = Status("interrupted", "interrupted while the accuracy of the runs was checked")
    doubts: tuple[str, ...] = ()
    if search.explains and (search.status.success or not search.rejected):
        doubts = _check_residuals(problem, search, residuals, len(all_names))
    count = len(problem.names)
    values = dict(zip(all_names, estimates.tolist(), strict=True))
    fit = Fit(
        parameters={name: values[name] for name in all_names[:count]},
        sensors={name: values[name] for name in all_names[count:]},
        covariance=covariance,
        sensitivities=dict(evaluation.runs),
        residuals=residuals,
        sigma=sigma,
        is_sigma_known=problem.data.is_sigma_known,
        evaluations=search.evaluations,
        status=status,
        undetermined=() if not search.explains else full.undetermined(texts, information),
        at_bounds=tuple(n for n, at in zip(names, search.at_bounds, strict=True) if at),
        _own_warnings=(
            *problem.duration_warnings,
            *_check_omitted(evaluation),
            *_check_rejected_values(search, values),
            *_check_bounds(problem, scaling, search, estimates),
            *doubts,
            *_check_intervals(problem, information),
            *steps,
        ),
        _full_information=full,
        _information=information,
        _jacobian=jacobian,
        _problem=problem,
        _scaling=scaling,
        _search=search,
        _starts=starts,
        _last=evaluation,
    )
    if errors is not None:
        vars(fit)["errors"] = errors
    return fit


def _distances_to_bounds(
    problem: FitProblem, scaling: Scaling, estimates: Array
) -> tuple[Array, Array]:
    """Return the distances (k,) of all estimates from their lower and upper bounds.

    They are infinite without bounds, and differences of logarithms for parameters in `log`.
    """
    count = len(problem.variables)
    others = np.full(len(estimates) - count, np.inf)
    ends = []
    for bound in (estimates[:count], *scaling.bounds):
        with np.errstate(divide="ignore"):
            ends.append(np.where(scaling.is_log, np.log(np.abs(bound)), bound))
    values, lower, upper = ends
    return np.append(values - lower, others), np.append(upper - values, others)


def _find_fixed(
    problem: FitProblem,
    scaling: Scaling,
    search: SearchResult,
    estimates: Array,
    information: Information,
) -> Array:
    """Return True (k,) for estimates that the covariance of the others holds fixed.

    They are at a bound, or have intervals that exceed both bounds, or relative standard deviations
    above 100 % even if all others are known.
    """
    count = len(problem.variables)
    below, above = _distances_to_bounds(problem, scaling, estimates)
    slopes = np.ones(len(estimates))
    slopes[:count][scaling.is_log] = estimates[:count][scaling.is_log]
    half = _NORMAL_QUANTILE * np.sqrt(np.diag(information.covariance)) / slopes
    is_fixed = np.asarray(half > np.maximum(below, above))
    is_fixed[:count] |= search.at_bounds
    effects = np.linalg.norm(information.singular[:, None] * information.directions, axis=0)
    # Near zero, changes are relative to the first value.
    effects[:count] *= np.maximum(scaling.sizes / information.sizes[:count], 1.0)
    is_fixed |= effects * MAX_RELATIVE_DEVIATION < 1.0
    return np.asarray(is_fixed)


def _check_bounds(
    problem: FitProblem, scaling: Scaling, search: SearchResult, estimates: Array
) -> tuple[str, ...]:
    """Return a warning for each estimate at a bound."""
    x = scaling.variables(estimates[: len(problem.variables)])
    lower, upper = scaling.limits
    largest_shifts = [x.name for x in problem.sensors.shifts if x.is_at_first_time]
    sentences = []
    for k in np.flatnonzero(search.at_bounds):
        name, is_upper = problem.variables[k], upper[k] - x[k] < x[k] - lower[k]
        side, beyond = ("upper", "larger") if is_upper else ("lower", "smaller")
        bound = scaling.bound_texts[name][int(is_upper)]
        remedy = "Widen the bounds"
        if is_upper and name in largest_shifts:
            # The run starts at 0 s, and a shift moves times back.
            remedy = f"Omit data before {2.0 * float(estimates[k]):.3g} s"
        sentences.append(
            f"{name} is at its {side} bound {bound} and has no standard deviation; those of other "
            f"estimates hold it there. {remedy} if {beyond} values are possible, or leave {name} "
            "out of the fit."
        )
    return tuple(sentences)


def _check_rejected_values(search: SearchResult, values: Mapping[str, float]) -> tuple[str, ...]:
    """Return a warning about values of parameters that the model rejected during the search."""
    if search.status.success or not search.rejected:
        return ()
    bounds = []
    for name, rejected in search.rejected.items():
        # Most domains end at zero.
        limit = 0.0 if rejected * values[name] <= 0.0 else values[name]
        ends = f"{limit:.4g}, upper" if rejected < values[name] else f"lower, {limit:.4g}"
        bounds.append(f"{name!r}: ({ends})")
    named = " and ".join(f"{name} = {x:.4g}" for name, x in search.rejected.items())
    return (
        f"The model rejected {named} during the search; pass bounds={{{', '.join(bounds)}}}, "
        "because searches next to invalid values may end early or elsewhere.",
    )


def _check_omitted(evaluation: Evaluation) -> tuple[str, ...]:
    """Return a sentence on data that were left out."""
    if evaluation.count == len(evaluation.residuals):
        return ()
    return (
        f"The fit leaves out {np.sum(evaluation.is_omitted)} of {len(evaluation.residuals)} data, "
        "at which reactions of the model grow without bounds.",
    )


def _check_intervals(problem: FitProblem, information: Information) -> tuple[str, ...]:
    """Return a warning if intervals of correlated parameters may not hold."""
    is_nonlinear = information.nonlinear()[: len(problem.variables)]
    names = [x for x, is_in in zip(problem.variables, is_nonlinear, strict=True) if is_in]
    if not names:
        return ()
    return (
        f"The intervals of {', '.join(names)} may not hold: their linear approximation fails "
        "because the data hardly distinguish effects of estimates; use "
        f"fit.profile({names[0]!r}), which does without it, search for other minima (starts=5), or "
        "fix a parameter.",
    )


def _check_residuals(
    problem: FitProblem, search: SearchResult, residuals: Array, count: int
) -> tuple[str, ...]:
    """Return the first kind of warnings about the residuals that applies.

    The residuals of the search are in units of the weights, `residuals` in standard deviations.
    """
    left, freedom = float(residuals @ residuals), search.evaluation.count - count
    probability = 1.0
    if problem.data.is_sigma_known and freedom > 0:
        probability = float(chdtrc(freedom, left))
    parts = _split_by_series(problem, residuals)
    if probability < _MIN_PROBABILITY:
        sentence = (
            f"The model does not explain the data: the residuals are {np.sqrt(left / freedom):.3g} "
            "times as large as the given sigma, and the standard deviations do not apply"
        )
        outliers = np.concatenate([part[_find_outliers(part)] for part in parts])
        if outliers @ outliers > _MIN_OUTLIERS_SHARE * left:
            named = _name_outliers(problem, parts)
            return (f"{sentence}; most of their squares are outliers.", *named)
        local = ""
        if left > _MIN_LOCAL_SHARE * problem.data.variation:
            local = (
                "start from other values, or pass bounds= and starts= to search from several, "
                "because the search may have ended at a local minimum, "
            )
        causes = suggest_causes(problem, search.evaluation, search.first)
        return (
            f"{sentence}; {causes}{local}check the unit of sigma, which is that of its column, or "
            "add what the model lacks.",
        )
    sentences = _check_sigma(problem, search.evaluation, residuals, count)
    sentences = sentences or _check_noise(problem, search)
    if sentences or probability >= _MIN_USUAL_PROBABILITY:
        return sentences
    return (
        "The model may not explain the data: if it and sigma are right, larger residuals have a "
        f"probability of {probability:.1g}; check sigma and the residuals over time (plot).",
    )


def _split_by_series(problem: FitProblem, residuals: Array) -> list[Array]:
    return [residuals[rows] for _, _, rows in problem.rows_by_series()]


def _check_sigma(
    problem: FitProblem, evaluation: Evaluation, residuals: Array, count: int
) -> tuple[str, ...]:
    """Return a warning for each column with a given sigma clearly above its residuals.

    Residuals that are small compared with the data may be those of computed data without noise.
    """
    if not problem.data.is_sigma_known:
        return ()
    columns: dict[str, list[Array]] = {}
    for series, _, rows in problem.rows_by_series():
        changes = (series.values - series.values.mean()) / series.sigma
        compared = np.stack([residuals[rows], changes])[:, ~evaluation.is_omitted[rows]]
        columns.setdefault(series.name_in_data or series.column, []).append(compared)
    sentences = []
    for name, parts in columns.items():
        values = np.concatenate(parts, axis=1)
        left, variation = np.sum(values**2, axis=1)
        freedom = len(values.T) - count
        is_improbable = freedom >= _MIN_NOISE_COUNT and chdtr(freedom, left) < _MIN_PROBABILITY
        is_large = left * _MAX_SIGMA_RATIO**2 < freedom
        if is_improbable and is_large and left > _MAX_NOISELESS_RATIO**2 * variation:
            column, unit = split_unit(name)
            sentences.append(
                f"sigma of {column} is {np.sqrt(freedom / left):.2g} times as large as the "
                "residuals, so the standard deviations are too large; reduce it, or check its "
                f"unit, which is that of the column in the data{unit and f', {unit}'}."
            )
    return tuple(sentences)


def _check_noise(problem: FitProblem, search: SearchResult) -> tuple[str, ...]:
    """Return warnings if the residuals of a good fit are not white noise of known relative size."""
    residuals = search.evaluation.residuals
    parts = _split_by_series(problem, residuals)
    left = float(residuals @ residuals)
    if (
        residuals.size < _MIN_NOISE_COUNT
        or left <= _MAX_NOISELESS_RATIO**2 * problem.data.variation
    ):
        return ()
    correlation = sum(float(x[:-1] @ x[1:]) for x in parts) / left
    if correlation > MAX_NOISE_CORRELATION:
        factor = np.sqrt((1.0 + correlation) / (1.0 - correlation))
        causes = suggest_causes(problem, search.evaluation, search.first)
        return (
            f"Consecutive residuals have a correlation of {correlation:.2f}, so the standard "
            f"deviations are too small, by a factor of up to {factor:.2g}; "
            f"{causes}use fewer data per second if the noise is slow, other first values or "
            "starts= if another minimum may be lower, or add what the model lacks, such as shift= "
            "or offset=.",
        )
    sentences = list(_name_outliers(problem, parts))
    scatter = {
        x.label: float(np.sqrt(np.mean(part**2)))
        for x, part in zip(problem.data.series, parts, strict=True)
        if len(part) >= _MIN_NOISE_COUNT
    }
    if len(scatter) > 1 and not problem.data.is_sigma_known:
        most, least = max(scatter, key=scatter.__getitem__), min(scatter, key=scatter.__getitem__)
        if scatter[most] > _MAX_SCATTER_RATIO * scatter[least]:
            sentences.append(
                f"The residuals of {most} are {scatter[most] / scatter[least]:.2g} times as large "
                f"as those of {least}, but have the same weights; pass a long table with a column "
                "sigma."
            )
    return tuple(sentences)


def _name_outliers(problem: FitProblem, parts: list[Array]) -> Iterator[str]:
    """Yield a sentence on the outliers among the residuals of each series."""
    accuracy = _describe_accuracy(problem)
    for series, part in zip(problem.data.series, parts, strict=True):
        rows = _find_outliers(part)
        if not len(rows):
            continue
        times = [f"{x:g} s" for x in series.times[rows[:_MAX_NAMED_OUTLIERS]]]
        more = len(rows) - len(times)
        yield (
            f"{series.label} has outliers at t = {', '.join(times)}"
            f"{f' and at {more} further times' if more else ''}, more than {_OUTLIER_DISTANCE:g} "
            "robust standard deviations from the model, which may shift the estimates; if "
            f"{accuracy} leaves them there, replace wrong values by NaN, and fit again."
        )


def _find_outliers(residuals: Array) -> Array:
    """Return the indices of the outliers among the residuals of a series, if these are few."""
    deviation = _NORMAL_DEVIATION * float(np.median(np.abs(residuals)))
    rows = np.flatnonzero(np.abs(residuals) > _OUTLIER_DISTANCE * deviation)
    are_few = len(rows) <= _MAX_OUTLIER_SHARE * len(residuals) and deviation > 0.0
    return rows if are_few else rows[:0]


def _check_errors(
    evaluation: Evaluation, errors: Any, sigma: float, scatter: float
) -> tuple[str, ...]:
    """Return a warning if errors of the runs change estimates by over 0.4 standard deviations.

    `sigma` is the estimated factor of the standard deviations of the data, and `scatter` the ratio
    of the residuals to these if it exceeds 1.
    """
    values = evaluation.values
    change = evaluation.projected_jacobian @ (errors.companions[: len(values)] - values)
    shift = float(np.linalg.norm(change))
    if not shift > _MAX_SHIFT * sigma * scatter:
        return ()
    aim = errors.largest * _AIM_OF_SHIFT * sigma / shift
    return (
        f"The estimates would change by up to {shift / sigma:.2g} standard deviations in "
        f"{errors.refined}; use {errors.recommend(aim)}.",
    )


def _are_computed(problem: FitProblem, deviation: float) -> bool:
    """Return True if the data seem to be those of a run, by the deviation of the residuals."""
    largest = max(float(np.abs(x.values / x.sigma).max()) for x in problem.data.series)
    return deviation <= _MIN_RELATIVE_SIGMA * largest and not problem.data.is_sigma_known


def _describe_accuracy(problem: FitProblem) -> str:
    """Return the setting of more accurate runs."""
    return "a shorter step" if problem.integrator.accuracy.name == "step" else "a smaller rtol"


def _column_sigma(problem: FitProblem) -> dict[str, float]:
    """Return the root mean square of the standard deviations by header."""
    by_header: dict[str, list[Array]] = {}
    for series, header in zip(problem.data.series, problem.headers, strict=True):
        by_header.setdefault(header, []).append(series.sigma)
    return {
        header: float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
        for header, parts in by_header.items()
    }


def _sizes(
    problem: FitProblem, names: tuple[str, ...], estimates: Array
) -> tuple[Array, dict[str, str]]:
    """Return the sizes (k,) to which changes are relative, and their formats by name."""
    sensors = problem.sensors
    special = {x.name: x for x in (*sensors.shifts, *sensors.offsets)}
    sizes, texts = [], {}
    first = dict(zip(problem.names, problem.first_values.tolist(), strict=False))
    for name, value in zip(names, estimates.tolist(), strict=True):
        if abs(value) < _MIN_RELATIVE_VALUE * abs(first.get(name, 0.0)):
            sizes.append(abs(first[name]))
            texts[name] = f"{name} by {{:+.3g}} % of its first value"
        elif name in special:
            what = "range" if special[name].unit != "s" else "width of its bounds"
            sizes.append(special[name].size)
            texts[name] = f"{name} by {{:+.3g}} % of half the {what}"
        else:
            sizes.append(abs(value) or 1.0)
            texts[name] = f"{name} by {{:+.3g}} %" if value else f"{name} by {{:+.3g}} / 100"
    # Names may contain braces, and only the number is formatted.
    escaped = {
        name: text.replace(name, name.replace("{", "{{").replace("}", "}}"), 1)
        for name, text in texts.items()
    }
    return np.array(sizes), escaped
