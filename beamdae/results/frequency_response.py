"""Frequency response: periodic motions over a parameter, with folds and peaks of the curve."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae import deferred
from beamdae.errors import kind_of_message
from beamdae.read_only import read_only_data
from beamdae.results.columns import (
    UNITS_OF_TRANSLATIONS,
    Header,
    largest_by,
    select_column,
)
from beamdae.results.displays import HasPage, HasTable, Plot
from beamdae.results.noise import mark_resting_columns
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import PeriodicMotion, largest_modulus, run_warnings
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

STABILITY_MARGIN = 1e-3  # moduli of the multipliers of stable motions may exceed 1 by this
# Half ranges whose relative changes along the curve are smaller are constant: errors of the runs.
_MIN_VARIATION = 1e-4
# Smaller half ranges, relative to the largest ones of the same kind, are rounding errors.
_NOISE_RATIO = 1e-9
# Peaks exceed the highest point by at most this factor; otherwise, the points do not resolve them.
_MAX_PEAK_RATIO = 1.25


@read_only_data
@dataclass(frozen=True, eq=False)
class ResponsePoint:
    """One periodic motion on a response curve.

    Attributes
    ----------
    parameter
        Value of the varied parameter.
    period
        Period [s].
    solution
        One period of the motion.
    multipliers
        Floquet multipliers, complex, sorted by descending modulus; see `PeriodicMotion`.
    forward
        True if the parameter increases along the curve at this point.
    """

    parameter: float
    period: float
    solution: Solution
    multipliers: Array
    forward: bool = True

    @cached_property
    def errors(self) -> Any:
        """Errors of the columns and of the largest multiplier, see `Errors`."""
        return PeriodicMotion(self.solution, self.period, self.multipliers).errors

    @property
    def stable(self) -> bool:
        """True if the moduli of all Floquet multipliers are at most 1.001."""
        return largest_modulus(self.multipliers) <= 1.0 + STABILITY_MARGIN


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(HasTable, HasPage):
    """Response curve: periodic motions over a parameter.

    Attributes
    ----------
    parameter
        Name of the parameter.
    points
        The motions, in order along the curve; empty if no first motion was found.
    status
        Outcome of the continuation; `status.kind` is "ok" if the curve reached the end of the range
        of the parameter, and "failed" if it folded back and returned to the start of the range.
    unit
        Unit of the parameter: that of the model, otherwise "Hz" for a frequency, or "".
    critical_points
        Pairs of a kind and the value of the parameter, in order along the curve: "fold", where the
        parameter reverses, "branch point", where another curve crosses, "period doubling" and
        "torus point", where disturbances begin or cease to grow.
    """

    parameter: str
    points: tuple[ResponsePoint, ...]
    status: Status
    unit: str = ""
    critical_points: tuple[tuple[str, float], ...] = ()
    _headers: tuple[str, ...] = field(default=(), repr=False)

    def __repr__(self) -> str:
        values = [point.parameter for point in self.points]
        unit = f" {self.unit}" if self.unit else ""
        span = f", {self.parameter} {min(values):g} to {max(values):g}{unit}" if values else ""
        return (
            f"<FrequencyResponse: {len(values)} motions{span}; {self.status.kind}, "
            f"{self.status.sentence}>"
        )

    @property
    def label(self) -> str:
        """Name of the parameter with its unit, such as "frequency [Hz]"."""
        return f"{self.parameter} [{self.unit}]" if self.unit else self.parameter

    @cached_property
    def errors(self) -> Any:
        """Errors of the first, the last, each 20th and the largest motions, see `Errors`."""
        return deferred.module("accuracy.periodic").measure_response(self)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reason if the curve ended early, and warnings of the motions.

        The second one is about `errors`. Of others that differ only in numbers, the first one.
        """
        return self._list_warnings(includes_model=True)

    def _list_warnings(self, includes_model: bool) -> tuple[str, ...]:
        """Return `warnings`, with or without those that were issued when models were built."""
        first: dict[str, str] = {}
        if not self.status.success:
            first[""] = f"frequency_response: {self.status.sentence}."
        if self.points:
            check = deferred.module("accuracy.runs").check_errors
            first |= {x: x for x in check(self, self.points[0].solution)}
        for point in self.points:
            solution = point.solution
            # Sizes of columns do not depend on rows.
            for sentence in run_warnings(solution, includes_rows=False):
                if not includes_model and sentence in solution.equations.build_warnings:
                    continue
                text = f"{self.parameter} = {point.parameter:.6g}: {sentence}"
                first.setdefault(kind_of_message(sentence), text)
        return tuple(first.values())

    def table(self) -> pd.DataFrame:
        """Return one row per motion: parameter, period, and sizes of the observed columns.

        These are the mean, the half range and the largest magnitude over one period. The half range
        is half the difference between maximum and minimum: the amplitude of a sine, but half of it
        for its magnitude. All of them include the steps of the runs. The last columns are "stable",
        "largest multiplier" (the largest modulus) and "fold", which is true at the first motion
        after the parameter reverses its direction.
        """
        import pandas as pd

        headers = self.points[0].solution.columns if self.points else self._headers
        columns: dict[str, Any] = {
            self.parameter: [x.parameter for x in self.points],
            "period [s]": [x.period for x in self.points],
        }
        for header in headers:
            means = [x.solution._column_means[header] for x in self.points]
            columns |= dict(zip(_size_headers(header), (means, *self._sizes(header)), strict=True))
        forward = np.array([x.forward for x in self.points], bool)
        return pd.DataFrame(
            columns
            | {
                "stable": [x.stable for x in self.points],
                "largest multiplier": [largest_modulus(x.multipliers) for x in self.points],
                "fold": np.diff(forward, prepend=forward[:1]),
            }
        )

    def _extremes(self, header: str) -> Array:
        """Return the smallest and the largest value (2, k) of an observed column by its header."""
        ranges = [point.solution._column_ranges[header] for point in self.points]
        return np.array(ranges, float).reshape(-1, 2).T

    def _sizes(self, header: str) -> tuple[Array, Array]:
        """Return half the range (k,) and the largest magnitude (k,) of an observed column."""
        least, largest = self._extremes(header)
        return 0.5 * (largest - least), np.maximum(np.abs(least), np.abs(largest))

    def plot(self, column: str, x: str | None = None) -> Plot:
        """Plot the half range of an observed column over the parameter.

        Unstable parts of the curve are dashed, and its peaks over the parameter are marked.

        Parameters
        ----------
        column
            Name of the column, with or without its unit, such as "tip.y".
        x
            Observed column whose half range is on the horizontal axis. Defaults to the parameter.

        Raises
        ------
        BeamdaeError
            If no observed column has this name.
        """
        return deferred.module("report.result_displays").draw_result(self, column, x=x)

    @property
    def folds(self) -> list[float]:
        """Parameter values at which the curve folds back."""
        return [value for kind, value in self.critical_points if kind == "fold"]

    def peaks(self, column: str) -> list[tuple[float, float]]:
        """Return (parameter, half range) at each peak of the curve of an observed column.

        Each peak is the vertex of a parabola through the three nearest points: 1 / half range^2
        over the parameter, with an error below 0.2 % for a linear resonance with a damping ratio up
        to 1 % and two points within the half-power bandwidth. Where the curve folds, or the peak
        would be more than 25 % above the highest point, it is the highest point. The ends of the
        curve are not peaks.

        Parameters
        ----------
        column
            Name of the column, with or without its unit, such as "tip.y".

        Raises
        ------
        BeamdaeError
            If no observed column has this name.
        """
        if not self.points:
            return []
        values, sizes = self.curve(column)
        return [self._peak(k, values, sizes) for k in _find_maxima(sizes)]

    def peak_table(self) -> pd.DataFrame:
        """Return one row per peak of the observed columns that vary, see `peaks`.

        The columns are "observed", the parameter, "half range" and "largest magnitude" (in the unit
        of the observed column). At a peak, the largest magnitude is a linear function of the half
        range, through the highest point and the lower one of its neighbors: exact for sines with a
        constant mean and for their magnitudes.
        """
        import pandas as pd

        rows = []
        for name in self.varying_columns:
            values, sizes = self.curve(name)
            magnitudes = self._sizes(name)[1]
            for k in _find_maxima(sizes):
                parameter, size = self._peak(k, values, sizes)
                lower = k - 1 if sizes[k - 1] < sizes[k + 1] else k + 1
                slope = (magnitudes[k] - magnitudes[lower]) / (sizes[k] - sizes[lower])
                magnitude = magnitudes[k] + slope * (size - sizes[k])
                rows.append((name, parameter, size, float(magnitude)))
        names = ["observed", self.parameter, "half range", "largest magnitude"]
        return pd.DataFrame(rows, columns=names)

    def _peak(self, k: int, values: Array, sizes: Array) -> tuple[float, float]:
        """Return (parameter, half range) of the peak next to the point `k`."""
        near = slice(k - 1, k + 2)
        before, here, after = values[near].tolist()
        if (here - before) * (after - here) > 0.0 and np.all(sizes[near] > 0.0):
            a, b, c = np.polyfit(values[near] - here, (sizes[k] / sizes[near]) ** 2, 2).tolist()
            shift, lowest = -0.5 * b / a, c - 0.25 * b**2 / a
            is_between = min(before, after) <= here + shift <= max(before, after)
            if a > 0.0 and is_between and lowest * _MAX_PEAK_RATIO**2 > 1.0:
                return here + shift, float(sizes[k] / np.sqrt(lowest))
        return here, float(sizes[k])

    def curve(self, column: str) -> tuple[Array, Array]:
        """Return the parameter (k,) and the half range (k,) of an observed column.

        Parameters
        ----------
        column
            Name of the column, with or without its unit, such as "tip.y".

        Raises
        ------
        BeamdaeError
            If no observed column has this name.
        """
        if self.points:
            column = select_column("frequency_response", self.points[0].solution.columns, column)
        return np.array([point.parameter for point in self.points]), self._sizes(column)[0]

    @cached_property
    def varying_columns(self) -> tuple[str, ...]:
        """Headers of the observed columns whose half ranges vary along the curve by over 0.01 %.

        Columns at the level of rounding errors are omitted.
        """
        if not self.points:
            return ()
        sizes = {name: self.curve(name)[1] for name in self.points[0].solution.columns}
        units = (Header.of(name).unit for name in sizes)
        largest = largest_by(units, (float(size.max()) for size in sizes.values()))
        varying = []
        at_rest = self.resting_columns
        for name, size in sizes.items():
            unit = Header.of(name).unit
            other = UNITS_OF_TRANSLATIONS.get(unit, (unit, 0))[0]
            noise = _NOISE_RATIO * max(largest[unit], largest.get(other, 0.0))
            if name in at_rest or size.max() <= noise:
                continue
            if np.ptp(size) > _MIN_VARIATION * size.max():
                varying.append(name)
        return tuple(varying)

    @cached_property
    def resting_columns(self) -> frozenset[str]:
        """Headers of the observed columns that are rounding errors in all motions."""
        names = list(self.points[0].solution.columns) if self.points else []
        if not names:
            return frozenset()
        rows = np.column_stack([self._extremes(name).ravel() for name in names])
        half_ranges = np.max([self._sizes(name)[0] for name in names], axis=1, initial=0.0)
        rate = 2.0 * np.pi / min(point.period for point in self.points)
        length = self.points[0].solution.equations.length
        at_rest = mark_resting_columns(names, rows, half_ranges, length, rate)
        return frozenset(name for name, rests in zip(names, at_rest, strict=True) if rests)


def _size_headers(header: str) -> list[str]:
    """Return the headers of the mean, the half range and the largest magnitude of a column."""
    name, _, unit = header.partition(" [")
    return [f"{name} {size} [{unit}" for size in ("mean", "half range", "largest magnitude")]


def _find_maxima(sizes: Array) -> list[int]:
    """Return the indices of the inner local maxima of a curve (k,)."""
    (inner,) = np.nonzero((sizes[1:-1] >= sizes[:-2]) & (sizes[1:-1] > sizes[2:]))
    return (inner + 1).tolist()
