"""Result of a fit: estimates, covariance, predictions, profiles, tables, plots and pages."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import chdtrc, stdtrit

from beamdae import deferred
from beamdae.analysis.fit.data import COLUMN, EXPERIMENT, SIGMA, VALUE
from beamdae.analysis.fit.problem import FitProblem, Scaling
from beamdae.analysis.fit.profile import MAX_DECREASE, ProfileLikelihood, trace_profile
from beamdae.analysis.fit.residual_checks import check_residuals, suggest_sensors
from beamdae.analysis.fit.search import Information, SearchResult, find_covariance
from beamdae.analysis.fit.sensors import CLOCK, OFFSET, SCALE, SHIFT
from beamdae.analysis.parameter_bounds import describe_ends
from beamdae.analysis.sensitivities.sensitivities import Sensitivities
from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, kind_of_message, require_choice, warn_user
from beamdae.interrupts import acknowledge
from beamdae.model_parameters import format_with_unit
from beamdae.read_only import read_only_data
from beamdae.results.columns import require_one_column, select_observed_columns
from beamdae.results.displays import HasPage, HasTable, Plot
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution

Array = np.ndarray

# Changes of the estimates by refined runs, in standard deviations, that are reported, and those
# at which recommended settings aim.
_MAX_SHIFT, _AIM_OF_SHIFT = 0.4, 0.1


_UPPER_PROBABILITY = 0.975  # of the upper limits of intervals of 95 %


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class Fit(HasTable, HasPage):
    """Result of `fit`: estimates with covariance, and what the data do not determine.

    `to_csv` writes `table` and the units of the estimates.

    Attributes
    ----------
    parameters
        Estimated values of the parameters of the model by name.
    sensors
        Estimated shifts [s], clocks, scales and offsets by name, such as "offset of gauge 1".
    covariance
        Covariance matrix (k, k) of the estimates in the order of `names`, in their units: the
        inverse of J^T J, where J is the Jacobian of `residuals`. Variances of parameters that can
        change without an effect on the fitted columns are infinite. Those of the others hold fixed
        the estimates at a bound, and those that keep their first values because the data do not
        determine them.
    sensitivities
        Run with the estimates and its derivatives by experiment, at the times of the data. The
        experiment of data without names of experiments is "".
    residuals
        (model - data) / sigma of all data that are not missing, in the order of
        `residual_table`; 0 where reactions of the model grow without bounds.
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
        values.
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
    undetermined: tuple[str, ...]
    at_bounds: tuple[str, ...]
    _own_warnings: tuple[str, ...]
    _information: Information  # with some parameters fixed, see `covariance`
    _problem: FitProblem
    _scaling: Scaling
    _search: SearchResult
    _starts: Any

    def __repr__(self) -> str:
        estimates = zip(self.names, self.values, self.standard_deviations, strict=True)
        values = ", ".join(
            f"{name} = {value:.6g}" + ("" if np.isnan(deviation) else f" +- {deviation:.2g}")
            for name, value, deviation in estimates
        )
        bounds = f"; at a bound: {', '.join(self.at_bounds)}" if self.at_bounds else ""
        chi_square = self.describe_chi_square()
        chi_square = chi_square and f"; chi-square {chi_square}"
        end = f"<Fit: {values}; {self.status.sentence}{bounds}{chi_square}>"
        return " ".join([end, *self.warnings, *self.undetermined])

    def _repr_html_(self) -> str:
        lines = [f"Fit of {self.model_name}", self.status.sentence, self.describe_chi_square()]
        lines += [*self.warnings, *self.undetermined]
        table = self.table().to_html(float_format="{:.5g}".format)
        return "<br>".join(map(html.escape, filter(None, lines))) + table

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
        return self._problem.units

    @property
    def model_name(self) -> str:
        """Name of the model function."""
        return self._problem.model.name

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
        return deferred.module("accuracy.derivatives").measure_fit(
            self._problem, self._search.evaluation
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the estimates, followed by `run_warnings`.

        Sentences on estimates at a bound, on estimates that refined runs would change by more than
        0.4 standard deviations (see `errors`), and on residuals: the model does not explain the
        data (`sigma` is known, and larger values of chi-square have a probability below 1e-6),
        `sigma` is more than 1.4 times the residuals (smaller ones have a probability below 1e-6),
        residuals are alike over more than three data, or single ones are outliers.
        """
        return (*self._own_warnings, *self.run_warnings)

    @cached_property
    def run_warnings(self) -> tuple[str, ...]:
        """Warnings of the runs with the estimates, none if the search ended before a minimum.

        With several experiments, they begin with the name of the first one that has them. Those
        about the output rows are omitted, because a fit compares values at the times of the data.
        """
        kinds: dict[str, str] = {}
        for experiment, run in self.solutions.items() if self.status.kind != "limited" else ():
            for sentence in run.model_warnings:
                if sentence not in run.row_warnings:
                    text = sentence if len(self.solutions) == 1 else f"{experiment}: {sentence}"
                    kinds.setdefault(kind_of_message(sentence), text)
        return tuple(kinds.values())

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
        return self._problem.count - len(self.names)

    @property
    def quantile(self) -> float:
        """Half width of 95 % intervals in standard deviations.

        1.96 of the normal distribution if `sigma` was given, otherwise that of the t distribution
        with `degrees_of_freedom`.
        """
        freedom = np.inf if self.is_sigma_known else max(self.degrees_of_freedom, 1)
        return float(stdtrit(freedom, _UPPER_PROBABILITY))

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
        sums = self._starts["chi-square"].dropna()
        rounding = MAX_DECREASE * self._estimate**2, self._problem.rounding
        limit = sums.min() + max(rounding)
        return describe_ends(sums.to_numpy(float), len(self._starts), limit, "chi-square")

    def table(self) -> pd.DataFrame:
        """Return a table of estimates, standard deviations and limits of 95 % intervals.

        The limits are `quantile` standard deviations away from the estimates, within the bounds;
        for parameters in `log`, those of the logarithms, so that both limits are positive. They are
        one-sided for estimates at a bound. There are no limits (NaN) if the search did not reach a
        minimum. See `profile` for intervals without the linear approximation.
        """
        columns = ["value", "standard deviation", "lower 95 %", "upper 95 %"]
        rows = [self.values, self.standard_deviations, *self._limits]
        return pd.DataFrame(dict(zip(columns, rows, strict=True)), index=list(self.names))

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        """Lower and upper limits (k,) of the 95 % intervals."""
        values, others = self.values, len(self._problem.linear)
        is_log = np.append(self._scaling.is_log, np.zeros(others, bool))
        half = self.quantile * np.sqrt(np.diag(self.covariance))
        half = half / np.where(is_log, values, 1.0) if self.status.success else half * np.nan
        with np.errstate(over="ignore"):
            limits = [np.where(is_log, values * np.exp(x), values + x) for x in (-half, half)]
        # Scales and offsets have no bounds.
        unbounded = np.full(others, np.inf)
        low, high = self._scaling.bounds
        box = np.append(low, -unbounded), np.append(high, unbounded)
        return np.clip(limits[0], *box), np.clip(limits[1], *box)

    @property
    def _estimate(self) -> float:
        """Estimated factor of the standard deviations of the data, 1 if these are known."""
        return 1.0 if self.is_sigma_known else next(iter(self.sigma.values()))

    @property
    def _written_table(self) -> pd.DataFrame:
        """Value of `table` with the units of the estimates."""
        table = self.table().assign(unit=list(self.units.values()))
        return table.reset_index(names="parameter")

    def correlations(self) -> pd.DataFrame:
        """Return the correlation matrix C_ij / sqrt(C_ii C_jj) of the estimates [-].

        C is `covariance`; rows and columns have the names of the parameters. Estimates with
        infinite variances have none (NaN).
        """
        deviations = self.standard_deviations
        deviations = np.where(np.isfinite(deviations), deviations, np.nan)
        matrix = self.covariance / np.outer(deviations, deviations)
        return pd.DataFrame(matrix, index=list(self.names), columns=list(self.names))

    def residual_table(self) -> pd.DataFrame:
        """Return a long table of data, model and residuals, one row per measured value.

        "model" contains the recorded values that the model and the sensors predict; "residual" is
        (model - value) / sigma.
        """
        data = self._problem.data.table
        sigma = data[SIGMA] * self._estimate
        table = data[[EXPERIMENT, COLUMN, TIME, VALUE]].rename(columns={COLUMN: "observable"})
        model = data[VALUE] + self.residuals * sigma
        return table.assign(sigma=sigma, model=model, residual=self.residuals)

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
        names = list(self.sensitivities)
        if experiment is None and len(names) == 1:
            experiment = names[0]
        run = self.sensitivities[require_choice("prediction", "experiment", experiment, names)]
        columns = run.solution.columns
        selected = select_observed_columns("prediction", [column], list(columns))
        header = require_one_column("prediction", column, selected)
        derivatives = np.zeros((len(run.t), len(self.names)))
        for k, name in enumerate(self.parameters):
            derivatives[:, k] = run.sensitivity(header, name)
        value, deviations = columns[header], self._information.standard_deviations(derivatives)
        half = self.quantile * deviations
        limits = {
            "value": value,
            "standard deviation": deviations,
            "lower 95 %": value - half,
            "upper 95 %": value + half,
        }
        return pd.DataFrame(limits, index=pd.Index(run.t, name=TIME))

    def profile(self, name: str, max_points: int = 20) -> ProfileLikelihood:
        """Return the profile likelihood of a parameter of the model, a shift or a clock.

        The parameter is fixed at several values on both sides of its estimate, and all others are
        fitted again, until the sum of squares has grown by the square of `quantile`; see Raue et
        al., Bioinformatics 25 (2009) 1923, doi:10.1093/bioinformatics/btp358. The interval of the
        profile does without the linear approximation of the interval of `table`.

        Parameters
        ----------
        name
            Name of a parameter in `by`, a shift or a clock. Scales and offsets have none: given the
            others, they enter linearly.
        max_points
            Maximum number of values on each side of the estimate, at most 1000, each with one fit.

        Raises
        ------
        BeamdaeError
            If there is no such parameter, a count is invalid, or the fit did not converge.

        Warns
        -----
        BeamdaeWarning
            If no limit was found, with the reason.
        """
        name = require_choice("profile", "name", name, self._problem.variables)
        if not self.status.success:
            raise BeamdaeError(
                f"profile: the fit did not converge ({self.status.sentence}); repeat the fit first."
            )
        k, variance = self._problem.variables.index(name), self._estimate**2
        half_widths = np.abs(np.array(self._limits)[:, k] - self.values[k])
        result = trace_profile(
            self._problem,
            self._scaling,
            self._search,
            name,
            half_widths,
            variance,
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
            The figure, displayed by a notebook; `Plot.save` writes it to a file. At most six
            columns of experiments are drawn.
        """
        return deferred.module("report.result_displays").draw_result(self)

    def sensor_of(self, number: int) -> dict[str, float]:
        """Return the estimated properties of the sensor of a row of `residual_table`.

        "shift" [s], "clock", "scale" and "offset" are 0, 1, 1 and 0 unless they were fitted.
        """
        found = {SHIFT: 0.0, CLOCK: 1.0, SCALE: 1.0, OFFSET: 0.0}
        return found | {
            x.kind: self.sensors[x.name] for x in self._problem.sensors if x.rows[number]
        }


def create_fit(problem: FitProblem, scaling: Scaling, search: SearchResult, starts: Any) -> Fit:
    """Return the result at the last values of a search."""
    end, data = search.evaluation, problem.data.table
    values, sigma = dict(zip(problem.estimated, end.estimates.tolist(), strict=True)), 1.0
    if not problem.data.is_sigma_known:
        # Data computed by the model itself have no residuals, but rounding errors.
        rounding = float(np.finfo(float).eps) * (float(data[VALUE].abs().max()) or 1.0)
        freedom = max(problem.count - len(values), 1)
        sigma = max(float(np.sqrt(end.chi_square / freedom)), rounding)
    whole, information, covariance = find_covariance(problem, scaling, end, search.at_bounds, sigma)
    undetermined = whole.describe_undetermined(values, problem.units) if search.explains else []
    status, residuals, errors = search.status, end.residuals / sigma, None
    sentences = []
    for k in np.flatnonzero(search.at_bounds):
        name, distances = problem.variables[k], [abs(x[k] - end.values[k]) for x in scaling.bounds]
        is_upper = distances[1] < distances[0]
        side, beyond = ("upper", "larger") if is_upper else ("lower", "smaller")
        bound = format_with_unit(float(scaling.bounds[int(is_upper)][k]), problem.units[name])
        sentences.append(
            f"{name} is at its {side} bound {bound} and has no standard deviation; those of other "
            f"estimates hold it there. Widen the bounds if {beyond} values are possible (of a "
            f"shift, omit earlier data), or leave {name} out of the fit."
        )
    # Data without noise are computed by runs that are as accurate.
    is_computed = end.chi_square <= problem.rounding and not problem.data.is_sigma_known
    try:
        if not search.explains:
            causes = suggest_sensors(problem, scaling, search)
            advice = (
                "check signs, units and times of the data and start=, or start from other values"
            )
            status = Status("limited", f"{status.sentence}; {causes}{advice}")
        elif status.success or not search.failures:
            sentences += check_residuals(problem, scaling, search, residuals)
        if search.explains and status.kind != "interrupted" and not is_computed:
            errors = deferred.module("accuracy.derivatives").measure_fit(problem, end)
            shifts = errors.companions[: len(end.values)] - end.values
            shift = float(np.linalg.norm(end.projected_jacobian @ shifts)) / sigma
            # Residuals far above sigma, perhaps in a wrong unit, are no errors of the steps.
            if shift > _MAX_SHIFT * max(1.0, float(np.sqrt(np.mean(residuals**2)))):
                aim = errors.largest * _AIM_OF_SHIFT / shift
                sentences.append(
                    f"The estimates would change by up to {shift:.2g} standard deviations in "
                    f"{errors.refined}; use {errors.recommend(aim)}."
                )
    except KeyboardInterrupt:
        acknowledge()
        status = Status("interrupted", "interrupted while the end of the search was checked")
    mean_squares = (data[SIGMA] ** 2).groupby(data[COLUMN], sort=False).mean()
    fit = Fit(
        parameters={x: values[x] for x in problem.names},
        sensors={x: y for x, y in values.items() if x not in problem.names},
        covariance=covariance,
        sensitivities=dict(end.runs),
        residuals=residuals,
        sigma={str(x): sigma * float(y) ** 0.5 for x, y in mean_squares.items()},
        is_sigma_known=problem.data.is_sigma_known,
        evaluations=search.evaluations,
        status=status,
        undetermined=tuple(undetermined),
        at_bounds=tuple(np.array(problem.variables)[search.at_bounds].tolist()),
        _own_warnings=tuple(sentences),
        _information=information,
        _problem=problem,
        _scaling=scaling,
        _search=search,
        _starts=starts,
    )
    if errors is not None:
        vars(fit)["errors"] = errors
    return fit
