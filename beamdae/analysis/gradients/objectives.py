"""Objectives: scalar functions of the columns of a run, with their derivatives."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, NoReturn, TypeAlias

import numpy as np

from beamdae.analysis.sensitivities.observable_derivatives import read_column
from beamdae.beams.shape_functions import gauss_points
from beamdae.errors import (
    BeamdaeError,
    as_real,
    as_text,
    format_distinct,
    require_between,
    require_choice,
    require_finite,
    require_sequence,
    set_fields,
    short_repr,
)
from beamdae.read_only import read_only_data
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Gauss points per step of methods with stages, whose steps are long and have a smooth dense output:
# a vibration with 10 steps per period has 80 points per period.
_POINTS_PER_STEP = 8
# Powers of larger exponents of a smooth maximum are dominated by rounding errors of single rows.
_MAX_EXPONENT = 1000.0
_MIN_DEVIATION = 1e-150  # standard deviations whose squares are not zero
RUN = "run"  # kind of an analysis
Values: TypeAlias = "Mapping[AnalysisQuantity, float]"


class Quantity:
    """Scalar function of the parameters of a model, for `optimize`; base class.

    Quantities and objectives of runs can be added, subtracted and multiplied by numbers, as in
    `Mass() + 0.1 * EndValue("tip.y")`.

    Attributes
    ----------
    label
        Short description for tables.
    parts
        Quantities of which this one is a function; none if it is the result of an analysis.
    """

    label: str
    parts: tuple[Quantity, ...] = ()

    @property
    def leaves(self) -> tuple[AnalysisQuantity, ...]:
        """The results of analyses of which the quantity is a function."""
        return tuple(leaf for part in self.parts for leaf in part.leaves)

    def combine(self, values: Array) -> tuple[float, Array]:
        """Return the value, and its derivatives, for values (n,) of the parts."""
        raise NotImplementedError

    def differentiate(self, values: Values) -> tuple[float, dict[Any, float]]:
        """Return the value and its derivatives with respect to the leaves, given their values."""
        parts = [x.differentiate(values) for x in self.parts]
        value, factors = self.combine(np.array([x for x, _ in parts]))
        weights = dict.fromkeys(self.leaves, 0.0)
        for factor, (_, derivatives) in zip(factors.tolist(), parts, strict=True):
            for leaf, derivative in derivatives.items():
                weights[leaf] += factor * derivative
        return value, weights

    def value(self, solution: Solution) -> float:
        """Return the value for a run, if the quantity is a function of objectives.

        Raises
        ------
        BeamdaeError
            If a name selects no column or several columns, a time lies outside the run, or the
            quantity is not that of a run.
        """
        if not isinstance(solution, Solution):
            raise BeamdaeError(
                f"{type(self).__name__}: value needs a Solution, got {short_repr(solution)}."
            )
        return self.differentiate({x: x.evaluate_run(solution) for x in self.leaves})[0]

    def find_unit(self, columns: Mapping[str, str]) -> str:
        """Return the unit of the value, "" if it is unknown; `columns` are units of columns."""
        units = {x.find_unit(columns) for x in self.parts}
        return units.pop() if len(units) == 1 else ""

    @property
    def terms(self) -> tuple[tuple[float, Any], ...]:
        """Factors and terms whose weighted sum is this quantity."""
        return ((1.0, self),)

    def __add__(self, other: Any) -> Any:
        if not isinstance(other, Quantity):
            return self._reject("+", other)
        return QuantitySum((*self.terms, *other.terms))

    def __radd__(self, other: Any) -> Any:
        # `sum` begins with zero.
        return self if other == 0 else self._reject("+", other)

    def __sub__(self, other: Any) -> Any:
        return self + -other if isinstance(other, Quantity) else self._reject("-", other)

    def __rsub__(self, other: Any) -> Any:
        return self._reject("-", other)

    def __neg__(self) -> Any:
        return self * -1.0

    def __mul__(self, factor: Any) -> Any:
        if as_real(factor) is None:
            return self._reject("*", factor)
        number = require_finite(type(self).__name__, "a factor", factor)
        return QuantitySum(tuple((number * weight, term) for weight, term in self.terms))

    __rmul__ = __mul__

    def __truediv__(self, divisor: Any) -> Any:
        number = as_real(divisor)
        if not number:
            return self._reject("/", divisor)
        return self * (1.0 / number)

    def __rtruediv__(self, dividend: Any) -> Any:
        return self._reject("/", dividend)

    def _reject(self, sign: str, operand: Any) -> NoReturn:
        raise BeamdaeError(
            f"{type(self).__name__}: {sign} {short_repr(operand)} is not supported; add "
            "objectives and quantities, and multiply them by numbers."
        )


@dataclass(frozen=True)
class QuantitySum(Quantity):
    """Sum of factor * quantity."""

    weighted_terms: tuple[tuple[float, Any], ...]

    def __post_init__(self) -> None:
        label = format_sum((weight, x.label) for weight, x in self.terms)
        set_fields(self, parts=tuple(x for _, x in self.terms), label=label)

    @property
    def terms(self) -> tuple[tuple[float, Any], ...]:
        """See `Quantity`."""
        return self.weighted_terms

    def combine(self, values: Array) -> tuple[float, Array]:
        """See `Quantity`."""
        factors = np.array([factor for factor, _ in self.terms])
        return float(factors @ values), factors

    def find_unit(self, columns: Mapping[str, str]) -> str:
        """See `Quantity`; a factor other than a sign may convert the unit."""
        is_sign = len(self.terms) == 1 and abs(self.terms[0][0]) == 1.0
        return super().find_unit(columns) if is_sign else ""


def format_sum(terms: Iterable[tuple[float, str]]) -> str:
    """Return a weighted sum of labels, such as 'mass - 0.5 frequency 1'."""
    text = ""
    for weight, label in terms:
        size = "" if abs(weight) == 1.0 else f"{abs(weight):g} "
        sign = "-" if weight < 0.0 else "+"
        text += f" {sign} {size}{label}" if text else f"{sign.strip('+')}{size}{label}"
    return text


class AnalysisQuantity(Quantity):
    """Result of one analysis of the model.

    Attributes
    ----------
    analysis
        Kind and arguments of the analysis; quantities with equal ones share it.
    unit
        Unit of the value; "" if it is unknown, None if it is that of the attribute `column`.
    """

    analysis: tuple[str, ...]
    unit: str | None = ""

    @property
    def leaves(self) -> tuple[AnalysisQuantity, ...]:
        """See `Quantity`."""
        return (self,)

    def evaluate_run(self, solution: Solution) -> float:
        """Return the value for a run."""
        raise BeamdaeError(
            f"{self.label}: this is no quantity of a run; "
            "use EndValue, TimeIntegral, SmoothMaximum or SquaredErrors."
        )

    def differentiate(self, values: Values) -> tuple[float, dict[Any, float]]:
        """See `Quantity`."""
        return values[self], {self: 1.0}

    def find_unit(self, columns: Mapping[str, str]) -> str:
        """See `Quantity`."""
        return columns.get(getattr(self, "column", ""), "") if self.unit is None else self.unit


class Objective(AnalysisQuantity):
    """Function of the values of one column at times that it selects; base class.

    Derived classes define the attribute `column`, `sample_times` and `evaluate`.
    """

    column: str
    analysis = (RUN,)

    def __post_init__(self) -> None:
        name = as_text(self.column)
        if name is None:
            raise BeamdaeError(
                f"{type(self).__name__}: column must be the name of a column, got "
                f"{short_repr(self.column)}."
            )
        set_fields(self, column=name, label=f"{type(self).__name__} of {name}")

    def evaluate_run(self, solution: Solution) -> float:
        """See `Quantity.value`."""
        grid = SampleGrid.of(solution.trajectory)
        run = solution.at_times(self.sample_times(grid))
        return self.evaluate(read_column(run, self.column)[1], grid.weights)[0]

    def sample_times(self, grid: SampleGrid) -> Array:
        """Return the ascending times at which the column is evaluated [s]."""
        return grid.t

    def evaluate(self, y: Array, weights: Array) -> tuple[float, Array]:
        """Return the value and its derivatives (k,).

        Parameters
        ----------
        y
            Values (k,) of the column at the sample times.
        weights
            Weights of integrals over the times of the grid [s].
        """
        raise NotImplementedError

    def end_derivative(self, value: float, y: float, rate: float, duration: float) -> float:
        """Return the derivative of the objective with respect to the end time of the run.

        Parameters
        ----------
        value
            Value of the objective.
        y, rate
            Value of the column at the end, and its rate per s.
        duration
            Duration of the run [s].
        """
        return 0.0


@dataclass(frozen=True)
class EndValue(Objective):
    """Value y(t_end) of a column at the end of the run.

    Attributes
    ----------
    column
        Header of an observed column, coordinate, velocity or multiplier, with or without its unit,
        such as "tip.y".

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.quantities.EndValue("tip.y") - 2.0 * bd.quantities.EndValue("tip.x")
    QuantitySum(weighted_terms=((1.0, EndValue(column='tip.y')), (-2.0, EndValue(column='tip.x'))))
    """

    column: str
    unit = None

    def sample_times(self, grid: SampleGrid) -> Array:
        """See `Objective`."""
        return np.array([grid.end])

    def evaluate(self, y: Array, weights: Array) -> tuple[float, Array]:
        """See `Objective`."""
        return float(y[0]), np.ones(1)

    def end_derivative(self, value: float, y: float, rate: float, duration: float) -> float:
        """See `Objective`."""
        return rate


@dataclass(frozen=True)
class TimeIntegral(Objective):
    """Integral of y or y^2 over the time of the run.

    For `GeneralizedAlpha`, the trapezoidal rule is applied to the values at the steps of the run,
    with an error of second order in the step, as that of the integrator. For `Radau`, the dense
    output is integrated with 8 Gauss points per step. The column may jump at events, impacts and
    breakpoints of laws.

    Attributes
    ----------
    column
        Header of a column, see `EndValue`.
    power
        1 for the integral of y, 2 for that of y^2.
    """

    column: str
    power: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        set_fields(self, power=require_choice("TimeIntegral", "power", self.power, [1, 2]))

    def evaluate(self, y: Array, weights: Array) -> tuple[float, Array]:
        """See `Objective`."""
        if self.power == 1:
            return float(weights @ y), weights
        return float(weights @ y**2), 2.0 * weights * y

    def end_derivative(self, value: float, y: float, rate: float, duration: float) -> float:
        """See `Objective`."""
        return float(y**self.power)


@dataclass(frozen=True)
class SmoothMaximum(Objective):
    """Smooth approximation of max |y| over the time of the run, by the p-norm.

    With the duration T of the run, the value is

        (1/T integral |y|^p dt)^(1/p),

    integrated as by `TimeIntegral`. It does not exceed max |y| and approaches it
    as p increases. For a peak max|y| (1 - (t/tau)^2 / 2), it is max|y| (sqrt(2 pi / p) tau/T)^(1/p)
    for large p: 7 % below the maximum for p = 50 and tau = T/10. `optimize` corrects limits by this
    ratio.

    Attributes
    ----------
    column
        Header of a column, see `EndValue`.
    exponent
        The exponent p, between 1 and 1000. Larger exponents are closer to the maximum, but the
        derivative then changes abruptly if another peak becomes the largest.
    """

    column: str
    exponent: float = 50.0
    unit = None

    def __post_init__(self) -> None:
        super().__post_init__()
        set_fields(self, exponent=require_exponent("SmoothMaximum", self.exponent))

    def evaluate(self, y: Array, weights: Array) -> tuple[float, Array]:
        """See `Objective`."""
        return measure_norm(y, self.exponent, weights / np.sum(weights))

    def end_derivative(self, value: float, y: float, rate: float, duration: float) -> float:
        """See `Objective`."""
        if value == 0.0:
            return 0.0
        p = self.exponent
        return value * ((abs(y) / value) ** p - 1.0) / (p * duration)


@read_only_data
@dataclass(frozen=True, eq=False)
class SquaredErrors(Objective):
    """Sum over samples of ((y(t_i) - value_i) / sigma_i)^2, for a fit to data or a desired path.

    Attributes
    ----------
    column
        Header of a column, see `EndValue`.
    times
        Ascending times (k,) of the samples within the run [s]. Between steps, the dense output of
        the run is used.
    values
        Values (k,) of the samples; NaN for missing ones.
    sigma
        Standard deviation of the samples, a positive number or one per sample; the weight of a
        sample is 1 / sigma^2.
    """

    column: str
    times: Any
    values: Any
    sigma: Any = 1.0
    _weights: Array = field(default_factory=lambda: np.zeros(0), init=False, repr=False)

    def __post_init__(self) -> None:
        name = "SquaredErrors"
        times = read_numbers(name, "times", self.times, "a time")
        values = read_numbers(name, "values", self.values, "a value", allows_missing=True)
        sigma = read_numbers(name, "sigma", self.sigma, "sigma")
        if not len(times) or np.any(np.diff(times) <= 0.0):
            raise BeamdaeError(
                f"{name}: times must be a nonempty list of ascending times [s], got "
                f"{short_repr(self.times)}."
            )
        if len(values) != len(times):
            raise BeamdaeError(
                f"{name}: values must contain one number or NaN per time, got {len(values)} values "
                f"for {len(times)} times."
            )
        require_deviations(name, sigma, len(times), "time")
        super().__post_init__()
        weights = np.where(np.isnan(values), 0.0, 1.0 / sigma**2)
        set_fields(self, times=times, values=values, _weights=weights)

    def sample_times(self, grid: SampleGrid) -> Array:
        """See `Objective`."""
        if self.times[0] < grid.start or self.times[-1] > grid.end:
            ends = (grid.start, grid.end, self.times[0], self.times[-1])
            start, end, first, last = format_distinct(*ends)
            raise BeamdaeError(
                f"SquaredErrors: times must lie within the run, {start} to {end} s, got {first} to "
                f"{last} s."
            )
        return np.asarray(self.times)

    def evaluate(self, y: Array, weights: Array) -> tuple[float, Array]:
        """See `Objective`."""
        errors = np.where(self._weights > 0.0, y - self.values, 0.0)
        weighted = self._weights * errors
        return float(weighted @ errors), 2.0 * weighted


def require_exponent(part: str, value: Any) -> float:
    """Return the exponent of a smooth maximum."""
    return require_between(part, "exponent", value, 1.0, _MAX_EXPONENT)


def measure_norm(y: Array, p: float, weights: Array | float = 1.0) -> tuple[float, Array]:
    """Return (sum of weights |y|^p)^(1/p), and its derivatives (k,)."""
    largest = float(np.max(np.abs(y)))
    if largest == 0.0 or not np.isfinite(largest):
        return largest, np.zeros_like(y)
    ratios = np.abs(y) / largest
    mean = float(np.sum(weights * ratios**p))
    norm = mean ** (1.0 / p)
    return largest * norm, norm / mean * weights * ratios ** (p - 1.0) * np.sign(y)


class SampleGrid(NamedTuple):
    """Times at which columns are evaluated for integrals over the time of a run.

    Attributes
    ----------
    t, weights
        Ascending times, and weights of their values in integrals, (k,) each [s].
    start, end
        Start and end of the run [s].
    """

    t: Array
    weights: Array
    start: float
    end: float

    @classmethod
    def of(cls, trajectory: Trajectory) -> SampleGrid:
        """Return the grid of a run: all steps or, for methods with stages, points within them.

        Raises
        ------
        BeamdaeError
            If the run stores only some of its steps.
        """
        trajectory.require_all_steps("objectives")
        grids, (points, shares) = [], gauss_points(_POINTS_PER_STEP)
        for k, interval in enumerate(trajectory.intervals):
            t = interval.t
            if interval.nodes_per_step > 1:
                half = 0.5 * np.diff(t)[:, None]
                grids.append(
                    ((t[:-1, None] + half * (1.0 + points)).ravel(), (half * shares).ravel())
                )
                continue
            # Columns may jump at a restart; results at this time are those before the jump.
            after = np.maximum(t, np.nextafter(t[0], np.inf)) if k > 0 else t
            grids.append((after, 0.5 * (np.diff(t, append=t[-1:]) + np.diff(t, prepend=t[:1]))))
        t, weights = (np.concatenate(x) for x in zip(*grids, strict=True))
        # Steps may have no length.
        t, position = np.unique(t, return_inverse=True)
        weights = np.bincount(position, weights, len(t))
        return cls(t, weights, trajectory.start, trajectory.end)


def read_numbers(
    part: str, name: str, value: Any, entry: str = "an entry", *, allows_missing: bool = False
) -> Array:
    """Return a number, or the entries of a list of finite numbers or NaN, as an array."""
    entries = [value] if as_real(value) is not None else value
    numbers = require_sequence(part, name, entries, "a list of numbers")
    missing = [allows_missing and (y := as_real(x)) is not None and np.isnan(y) for x in numbers]
    pairs = zip(numbers, missing, strict=True)
    return np.array([np.nan if y else require_finite(part, entry, x) for x, y in pairs])


def require_deviations(part: str, sigma: Array, count: int, noun: str) -> None:
    """Reject standard deviations whose squares vanish, or neither one nor one per `noun`."""
    if len(sigma) not in (1, count) or not np.all(sigma > _MIN_DEVIATION):
        raise BeamdaeError(
            f"{part}: sigma must be positive, one number or one for each {noun} ({count}), got "
            f"{short_repr(sigma.tolist() if len(sigma) != 1 else float(sigma[0]))}."
        )
