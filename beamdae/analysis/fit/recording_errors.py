"""Errors of recorded columns that no parameter explains: signs, units and delays."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from beamdae.analysis.fit.data import Series
from beamdae.analysis.fit.problem import Evaluation, FitProblem, Scaling, column_lengths
from beamdae.analysis.fit.search import is_explained, is_noise, search
from beamdae.analysis.fit.sensors import Sensor
from beamdae.errors import BeamdaeError, BeamdaeWarning, InputWarning, list_first, warn_user
from beamdae.interrupts import Interrupted
from beamdae.model_parameters import conversion_factor, format_with_unit, split_unit
from beamdae.results.columns import remove_unit

Array = np.ndarray

# Ratio of the ranges of a column in the first run and in the data from which a fit warns, and from
# which it does not search if no parameter explains it.
_MAX_RANGE_RATIO = 100.0
_MAX_SEARCHED_RATIO = 300.0
# A model is about proportional to a power of a parameter, of at least the first number, if its
# derivative has at least this squared correlation with the model.
_MIN_EXPONENT, _MIN_SHAPE = 0.5, 0.9
# Squared correlation of model and data from which a scale describes the data of the first run, and
# share of the residuals of an offset alone that it may leave.
_MIN_SQUARED_CORRELATION = 0.7
_MAX_LEFT_BY_SCALE = 0.3
# Share of the time in which vibrations of the first run and of the data are rather in phase.
_PART_IN_PHASE = 0.25
# Scales within this factor of 1 are no errors of signs or units.
_MIN_FACTOR = 1.8
_MAX_MIRRORED_FACTOR = 3.0
# An error explains the data if a search that estimates it leaves less than these shares of the
# variation of the data and of the residuals without it.
_MAX_LEFT_VARIATION = 0.05
_MAX_LEFT_RESIDUALS = 0.1
# Evaluations of a search that estimates an error.
_MAX_EVALUATIONS = 25
# Share of the effect of an error that changes of parameters cannot compensate, squared, and its
# size in standard deviations.
_MIN_INDEPENDENT_SHARE = 0.1
_MIN_DEVIATIONS = 5.0
# A sign leaves the amplitude unchanged, up to this relative error. A second error explains data
# better than a first one if it leaves less than this share; a delay better than a sign that changes
# the amplitude if it leaves less than its inverse.
_MAX_SIGN_ERROR = 0.03
_MAX_LEFT_SHARE = 0.5
# A search of a delay begins with the best one of this number, from early data by the first share of
# the duration up to data that are late by the second one, beyond those whose first value is at the
# start, with bounds at the last share on both sides.
_DELAY_COUNT = 400
_MAX_EARLY_SHARE, _MAX_LATE_SHARE = 0.5, 0.2
_MAX_FIRST_SHARE = 0.3
_DELAY_WINDOW = 0.05
# Delays that differ by whole periods of a vibration and are smaller by at least this share are
# searched, too, up to this number.
_MIN_REDUCTION, _MAX_SMALLER_DELAYS = 0.1, 3
# Distances between delays, whose median is the period, that may be shorter at the ends.
_OUTER_PERIODS = 2
_TIMES_PER_DELAY = 4  # of the run, between which it is linear
_MIN_SINGULAR_VALUE = 1e-9  # of columns of unit length; smaller ones are rounding errors
# Unit, factor and names of units that are mistaken for each other; "" means any unit.
_MISTAKEN_UNITS = (
    ("m/s^2", 9.80665, "g and m/s^2"),
    ("m", 10.0, "cm and mm"),
    ("m", 25.4, "inches and mm"),
    ("rad", 180.0 / np.pi, "degrees and radians"),
    ("m", 100.0, "m and cm"),
    ("", 1e3, "a unit and its thousandth"),
    ("", 1e6, "a unit and its millionth"),
)
_FACTOR_TOLERANCE = 0.05
_MIN_OFFSET_SHARE = 0.05  # of the range of a column; smaller offsets are not named
_MAX_NAMES = 3  # in a message
_MAX_PARTS = 6  # columns whose scales are searched one by one


def check_ranges(problem: FitProblem, scaling: Scaling, first: Evaluation) -> None:
    """Compare the ranges of the columns in the first run and in the data.

    Columns with an unknown scale are not compared, nor data that may be noise about a constant.

    Raises
    ------
    BeamdaeError
        If the ranges of a column differ by a factor above 300 that no parameter explains.

    Warns
    -----
    BeamdaeWarning
        If they differ by a factor above 100.
    """
    model = problem.recorded_values(first)
    for series, header, rows in _unscaled_series(problem):
        changes = series.values - series.values.mean()
        if is_noise(changes):
            continue
        low, high = sorted(ranges := [float(np.ptp(x)) for x in (model[rows], series.values)])
        if high <= _MAX_RANGE_RATIO * low:
            continue
        unit = split_unit(header)[1]
        texts = [format_with_unit(float(f"{x:.3g}"), unit) for x in ranges]
        sentence = (
            f"fit: {series.label} has a range of {texts[0]} in the first run and of "
            f"{texts[1]} in the data"
        )
        if (
            high < _MAX_SEARCHED_RATIO * low
            or low == 0.0
            or _has_scaling_parameter(problem, first, rows)
            or _bounds_permit(scaling, first, high / low)
        ):
            advice = "check start=, loads, units and first values"
            warn_user(f"{sentence}; {advice}.", InputWarning, merges=False)
            continue
        raise BeamdaeError(
            f"{sentence}, and no change of {', '.join(problem.names)} explains this factor of "
            f"{high / low:.2g}; check the unit in the header "
            f"{series.name_in_data or series.column!r}, start=, loads and first values, or "
            f"estimate the factor with scale=[{remove_unit(header)!r}]."
        )


class RecordingErrors:
    """Search of errors of the recorded columns that explain data which the model does not explain.

    Parameters
    ----------
    problem, scaling
        The fit.
    bounds, log, max_evaluations
        See `fit`.

    Attributes
    ----------
    first
        The first evaluation, after `check_ranges`.
    """

    def __init__(
        self, problem: FitProblem, scaling: Scaling, bounds: Any, log: Any, max_evaluations: int
    ) -> None:
        self._problem, self._scaling, self._bounds, self._log = problem, scaling, bounds, log
        self._max_evaluations = min(max_evaluations, _MAX_EVALUATIONS)
        self._is_searched = False
        self.first: Evaluation | None = None

    def check_ranges(self, first: Evaluation) -> None:
        """Compare the ranges of the first run and the data; see the function `check_ranges`."""
        self.first = first
        check_ranges(self._problem, self._scaling, first)

    def check_scales(self, best: Evaluation) -> str:
        """Return a clause on an error, or "", if a scale describes the data of the first run.

        A search of the scale decides, because the first values may be far from the estimates.
        """
        # Before their search, free delays may look like signs and scales.
        if self._problem.sensors.shifts:
            return ""
        with np.errstate(all="ignore"):
            if headers := self._list_scaled(1.0):
                return self._find(headers, best, self._scaling.first)
            if is_explained(self._problem, best):
                return ""
            headers = self._list_scaled(_PART_IN_PHASE)
            if not headers:
                return ""
            problem = _with_linear_sensors(self._problem, headers)
            end, scales = self._search_scales(problem, self._scaling.first, self._limit(best))
            if end is None or not scales or any(map(_is_mirrored, scales.values())):
                return ""
            return _describe_scales(problem, end, scales)

    def _list_scaled(self, share: float) -> list[str]:
        """Return the headers of columns that look scaled in a first share of the time."""
        assert self.first is not None
        headers = []
        for series, header, rows in _unscaled_series(self._problem):
            last = share * self._problem.last_time
            count = int(np.searchsorted(series.times, last, side="right"))
            part = slice(rows.start, rows.start + count)
            if (
                count
                and _looks_scaled(self._problem, self.first, series, part)
                and not _has_scaling_parameter(self._problem, self.first, part)
            ):
                headers.append(header)
        return headers

    def _limit(self, best: Evaluation) -> float:
        """Return the sum of squares that an error leaves which explains data far better."""
        return min(
            _MAX_LEFT_RESIDUALS * best.chi_square,
            _MAX_LEFT_VARIATION * self._problem.data.variation,
        )

    def check_progress(self, best: Evaluation) -> str:
        """Return a clause on an error, or "", if a search has not explained the data yet."""
        if is_explained(self._problem, best) or self._is_searched:
            return ""
        headers = [header for _, header, _ in _unscaled_series(self._problem)]
        problem = _with_linear_sensors(self._problem, headers, has_scales=False)
        # Searches of errors may run away to extreme values.
        with np.errstate(all="ignore"):
            # With an unknown scale, the search would reduce the amplitude of vibrations that are
            # not in phase.
            first = self._scaling.first
            opposite = problem.with_mirrored_data(headers)
            mirrored = self._search(opposite, self._scaling, first, has_short_steps=False)
            if mirrored is not None and is_explained(opposite, mirrored):
                first = self._scaling.start(mirrored.values)
            shifted = self._search(problem, self._scaling, self._scaling.first)
            if shifted is not None and (clause := self._find_offsets(problem, shifted)):
                return clause
            return self._find(headers, best if shifted is None else shifted, first)

    def _find_offsets(self, problem: FitProblem, end: Evaluation) -> str:
        """Return a clause on the offsets of a search that leaves noise, or ""."""
        if self._problem.sensors.offsets or not is_noise(end.residuals):
            return ""
        clause = _describe_offsets(problem, end)
        self._is_searched = bool(clause)
        return clause

    def _find(self, headers: Sequence[str], best: Evaluation, first: Array) -> str:
        """Return a clause on the error that explains the data far better than an evaluation.

        Vibrations that are half a period late or early look mirrored, by a factor that is due to
        damping, and mirrored ones look delayed.
        """
        self._is_searched = True
        assert self.first is not None
        limit = self._limit(best)
        if clause := self._find_in_part(headers, limit):
            return clause
        problem = _with_linear_sensors(self._problem, headers)
        scaled, scales = self._search_scales(problem, first, limit)
        if scaled is not None and scales:
            factors = [-x for x in scales.values() if _is_mirrored(x)]
            is_sign = all(abs(x - 1.0) < _MAX_SIGN_ERROR for x in factors)
            if not factors or (is_sign and is_noise(scaled.residuals)):
                return _describe_scales(problem, scaled, scales)
            share = _MAX_LEFT_SHARE if is_sign else 1.0 / _MAX_LEFT_SHARE
            limit = min(limit, share * scaled.chi_square)
        evaluations = [self.first, best, *([] if scaled is None else [scaled])]
        delayed = self._search_delay(evaluations, limit)
        if delayed is not None and not scales:
            begin = self._scaling.start(delayed.values[:-1])
            limit = _MAX_LEFT_SHARE * delayed.chi_square
            scaled, scales = self._search_scales(problem, begin, limit)
            delayed = None if scales else delayed
        if delayed is not None:
            return _describe_delay(self._problem, self._reduce_delay(delayed))
        if scaled is not None and scales:
            return _describe_scales(problem, scaled, scales)
        return self._find_delayed_column(evaluations[:2], limit)

    def _find_delayed_column(self, evaluations: Sequence[Evaluation], limit: float) -> str:
        """Return a clause on a delay of one of several columns, or ""."""
        names = list(dict.fromkeys(self._problem.headers))
        for name in names[:_MAX_PARTS] if len(names) > 1 else ():
            delayed = self._search_delay(evaluations, limit, name)
            if delayed is not None:
                delayed = self._reduce_delay(delayed, name)
                return _describe_delay(self._problem, delayed, name)
        return ""

    def _find_in_part(self, headers: Sequence[str], limit: float) -> str:
        """Return a clause on scales of one column, or of the columns with one unit, or "".

        The other columns determine the phase of vibrations, which a search of all scales may lose.
        """
        names = list(dict.fromkeys(headers))
        by_unit: dict[str, list[str]] = {}
        for name in names:
            by_unit.setdefault(split_unit(name)[1], []).append(name)
        groups = [x for x in by_unit.values() if len(x) > 1]
        for part in [*([x] for x in names[:_MAX_PARTS]), *groups]:
            if set(part) == set(self._problem.headers):
                continue
            problem = _with_linear_sensors(self._problem, part)
            end = self._search(problem, self._scaling, self._scaling.first)
            if end is None or end.chi_square > limit:
                continue
            # Another search decides whether parameters compensate the scale, not derivatives.
            scales = {name: scale for _, name, scale in _list_scales(problem, end)}
            if scales and not self._is_needless(end):
                return _describe_scales(problem, end, scales)
        return ""

    def _search_scales(
        self, problem: FitProblem, first: Array, limit: float
    ) -> tuple[Evaluation | None, dict[str, float]]:
        """Return the end of a search of scales, and those that are errors.

        There are none if the end leaves more than a sum of squares, or if delays that the fit
        estimates explain them.
        """
        end = self._search(problem, self._scaling, first)
        if end is None or end.chi_square > limit:
            return end, {}
        scales = _find_scales(problem, end)
        if scales and self._problem.sensors.shifts and self._is_needless(end):
            return end, {}
        return end, scales

    def _search_delay(
        self, evaluations: Sequence[Evaluation], limit: float, column: str = ""
    ) -> Evaluation | None:
        """Return the end of a search of a delay of all data or of a column, or None.

        There is none if the end leaves more than a sum of squares. The search begins with the best
        of several evaluations, at first without delays for which early data are ignored.
        """
        problem = self._problem
        if problem.sensors.shifts or problem.sensors.scales:
            return None
        guesses = [(*_scan_delays(problem, x, column), x.values) for x in evaluations]
        latest = min(float(x.times[0]) for x in problem.data.series)
        for is_late in (False, True):
            best = []
            for delays, shares, values in guesses:
                is_in = (delays > latest) == is_late
                k = int(np.argmin(np.where(is_in, shares, np.inf)))
                best.append((float(shares[k]), float(delays[k]), values))
            share, delay, values = min(best, key=lambda x: x[0])
            end = self._search_near_delay(delay, values, column) if share < np.inf else None
            if end is not None and end.chi_square <= limit and not self._is_needless(end):
                return end
        return None

    def _search_near_delay(
        self, delay: float, values: Array, column: str = ""
    ) -> Evaluation | None:
        """Return the end of a search from a delay and values of the parameters, or None."""
        problem = _with_delay(self._problem, delay, column)
        scaling = Scaling(problem, self._bounds, self._log)
        return self._search(problem, scaling, scaling.start(np.append(values, delay)))

    def _reduce_delay(self, delayed: Evaluation, column: str = "") -> Evaluation:
        """Return the end with the smallest delay that explains the data about as well.

        Other parameters, such as the damping, may compensate whole periods of a vibration.
        """
        size, values = abs(float(delayed.values[-1])), delayed.values[:-1]
        delays = _list_best_delays(self._problem, delayed, column)
        smaller = sorted(delays[np.abs(delays) < (1.0 - _MIN_REDUCTION) * size], key=abs)
        for delay in smaller[:_MAX_SMALLER_DELAYS]:
            end = self._search_near_delay(delay, values, column)
            is_smaller = end is not None and abs(end.values[-1]) < size
            if end and is_smaller and _MAX_LEFT_SHARE * end.chi_square <= delayed.chi_square:
                return end
        return delayed

    def _is_needless(self, end: Evaluation) -> bool:
        """Return True if a search from these parameters explains the data without the error.

        Delays are needless where runs explain the data periods later, and signs where a delay that
        the fit estimates does.
        """
        values = end.values[: len(self._problem.variables)].copy()
        if self._problem.sensors.shifts:
            values[len(self._problem.names) :] = _guess_delay(self._problem, end)[1]
        again = self._search(self._problem, self._scaling, self._scaling.start(values))
        return again is not None and _MAX_LEFT_SHARE * again.chi_square < end.chi_square

    def _search(
        self,
        problem: FitProblem,
        scaling: Scaling,
        first: Array,
        *,
        has_short_steps: bool = True,
    ) -> Evaluation | None:
        """Return the end of a short search, or None if it fails."""
        try:
            return search(
                problem,
                scaling,
                first,
                self._max_evaluations,
                has_short_steps=has_short_steps,
                can_stall=True,
            ).evaluation
        except Interrupted:
            # The partial result is not that of the fit.
            raise Interrupted from None
        except (ValueError, ArithmeticError):
            # BeamdaeError, or an error of the model function.
            return None


def _unscaled_series(problem: FitProblem) -> Iterator[tuple[Series, str, slice]]:
    """Yield the series without an unknown scale, with their headers and rows."""
    for series, header, rows in problem.rows_by_series():
        if not any(rows.start in sensor.rows for sensor in problem.sensors.scales):
            yield series, header, rows


def _looks_scaled(problem: FitProblem, first: Evaluation, series: Series, rows: slice) -> bool:
    """Return True if data = scale * model + offset, and an offset alone leaves far more."""
    # With weighted means, the offset is eliminated.
    values, sigma = (z[: rows.stop - rows.start] for z in (series.values, series.sigma))
    weights = sigma**-2 / np.sum(sigma**-2)
    model = problem.recorded_values(first)[rows]
    x, y = ((z - weights @ z) / sigma for z in (model, values))
    square, variation, work = float(x @ x), float(y @ y), float(x @ y)
    if square == 0.0 or variation == 0.0:
        return False
    left = variation - work**2 / square
    is_described = left <= (1.0 - _MIN_SQUARED_CORRELATION) * variation
    is_better = left < _MAX_LEFT_BY_SCALE * float((x - y) @ (x - y))
    return is_described and is_better and _is_scale(work / square)


def _is_scale(scale: float) -> bool:
    """Return True if a scale is too far from 1 to be that of a calibration."""
    return scale < 0.0 or _factor(scale) > _MIN_FACTOR


def _factor(scale: float) -> float:
    """Return the absolute value of a scale, or of its inverse if that is larger."""
    return max(abs(scale), 1.0 / abs(scale)) if scale else np.inf


def _has_scaling_parameter(problem: FitProblem, first: Evaluation, rows: slice) -> bool:
    """Return True if a change of a parameter may scale the model.

    It may if its value is zero, or if the model is about proportional to a power of it.
    """
    # The values of delays, which follow those of parameters, do not scale it.
    count = len(problem.names)
    values, jacobian = first.values[:count], first.projected_jacobian[rows, :count]
    is_zero = (values == 0.0) & np.any(jacobian, axis=0)
    model = (problem.recorded_values(first) * problem.weights)[rows]
    changes = jacobian * values
    model, changes = model - model.mean(), changes - changes.mean(axis=0)
    size, work = float(model @ model), model @ changes
    is_power = (abs(work) > _MIN_EXPONENT * size) & (
        work**2 > _MIN_SHAPE * size * np.sum(changes**2, axis=0)
    )
    return bool(np.any(is_zero | is_power))


def _bounds_permit(scaling: Scaling, first: Evaluation, ratio: float) -> bool:
    """Return True if the bounds of a parameter permit a change by a ratio."""
    values, (lower, upper) = first.values, map(scaling.values, scaling.limits)
    is_between = (lower > 0.0) & np.isfinite(upper)
    return bool(np.any(is_between & ((upper >= ratio * values) | (lower * ratio <= values))))


def _with_linear_sensors(
    problem: FitProblem, headers: Sequence[str], has_scales: bool = True
) -> FitProblem:
    """Return a problem with an unknown offset, and an unknown scale, of each of some columns."""
    rows: dict[str, list[Array]] = {}
    for _, header, part in _unscaled_series(problem):
        if header in headers:
            rows.setdefault(header, []).append(np.arange(part.start, part.stop))
    added = [Sensor(header, np.concatenate(parts), 1.0, "") for header, parts in rows.items()]
    sensors = replace(
        problem.sensors,
        scales=(*problem.sensors.scales, *(added if has_scales else ())),
        offsets=(*problem.sensors.offsets, *added),
    )
    return problem.with_sensors(sensors, problem.first_values)


def _with_delay(problem: FitProblem, delay: float, column: str = "") -> FitProblem:
    """Return a problem with an unknown delay of all data, or of a column, about a first one.

    Late data may begin before the run; those that may be earlier than its start are ignored.
    """
    size = _DELAY_WINDOW * problem.last_time
    latest = min(float(x.times[0]) for x in problem.data.series)
    if delay <= latest:
        bounds = delay - size, min(delay + size, latest)
    else:
        bounds = delay - size, delay + size
        problem = problem.without_data_before(bounds[1])
    parts = [rows for _, header, rows in problem.rows_by_series() if column in ("", header)]
    rows = np.concatenate([np.arange(x.start, x.stop) for x in parts])
    shift = Sensor("shift of *", rows, size, "s", bounds)
    sensors = replace(problem.sensors, shifts=(shift,))
    return problem.with_sensors(sensors, np.append(problem.first_values, delay))


def _guess_delay(problem: FitProblem, evaluation: Evaluation) -> tuple[float, float]:
    """Return the share of the variation that the best delay of the data leaves, and the delay."""
    delays, shares = _scan_delays(problem, evaluation)
    best = int(np.argmin(shares))
    return (float(shares[best]), float(delays[best])) if shares[best] < np.inf else (np.inf, 0.0)


def _list_best_delays(problem: FitProblem, evaluation: Evaluation, column: str = "") -> Array:
    """Return the delays that leave less of the variation than those beside them, ascending."""
    delays, shares = _scan_delays(problem, evaluation, column)
    before, after = np.append(np.inf, shares[:-1]), np.append(shares[1:], np.inf)
    return delays[(shares < before) & (shares <= after)]


def _scan_delays(
    problem: FitProblem, evaluation: Evaluation, column: str = ""
) -> tuple[Array, Array]:
    """Return delays of the data, or of a column, and the shares of the variation that they leave.

    Data are compared with the run where it covers their times less the delay.
    """
    times = [x.times for x in problem.data.series]
    latest, last = min(float(x[0]) for x in times), problem.last_time
    columns = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BeamdaeWarning)
        for name, run in evaluation.runs.items():
            t = np.linspace(0.0, run.solution.trajectory.end, _TIMES_PER_DELAY * _DELAY_COUNT)
            columns[name] = t, run.solution.at_times(t).columns
    # Data that begin late relative to their duration are hardly early.
    begins_late = latest > _MAX_FIRST_SHARE * (last - latest)
    first = 0.0 if begins_late else -_MAX_EARLY_SHARE * last
    delays = np.linspace(first, latest + _MAX_LATE_SHARE * (last - latest), _DELAY_COUNT)
    shares = np.full(len(delays), np.inf)
    for k, delay in enumerate(delays):
        left = variation = 0.0
        for series, header in zip(problem.data.series, problem.headers, strict=True):
            if column not in ("", header):
                continue
            t, model = columns[series.experiment]
            moved = series.times - delay
            is_covered = (moved >= 0.0) & (moved <= t[-1])
            if not is_covered.any():
                continue
            values, sigma = series.values[is_covered], series.sigma[is_covered]
            change = np.interp(moved[is_covered], t, model[header]) - values
            left += float(np.sum((change / sigma) ** 2))
            variation += float(np.sum(((values - values.mean()) / sigma) ** 2))
        if variation > 0.0:
            shares[k] = left / variation
    return delays, shares


def _is_significant(end: Evaluation, column: int, change: float, constants: Array) -> bool:
    """Return True if the data determine a change, whatever the other estimates are.

    Parameters
    ----------
    end
        End of a search of all estimates.
    column, change
        Column of the Jacobian, and the change of its estimate that an error is.
    constants
        Columns of the Jacobian of offsets, which may always compensate.
    """
    effect, others = end.jacobian[:, column], np.delete(end.jacobian, column, axis=1)
    size = np.linalg.norm(project_out(effect, end.jacobian[:, constants]))
    independent = np.linalg.norm(project_out(effect, others))
    deviation = np.sqrt(end.chi_square / len(effect))
    return bool(
        independent**2 > _MIN_INDEPENDENT_SHARE * size**2
        and independent * abs(change) > _MIN_DEVIATIONS * deviation
    )


def project_out(vectors: Array, matrix: Array) -> Array:
    """Return the part of a vector, or of columns, that is orthogonal to the columns of a matrix."""
    directions, singular, _ = np.linalg.svd(matrix / column_lengths(matrix), full_matrices=False)
    directions = directions[:, singular > _MIN_SINGULAR_VALUE]
    return np.asarray(vectors - directions @ (directions.T @ vectors))


def _is_mirrored(scale: float) -> bool:
    """Return True if a scale may be that of a wrong sign."""
    return scale < 0.0 and _factor(scale) < _MAX_MIRRORED_FACTOR


def _find_scales(problem: FitProblem, end: Evaluation) -> dict[str, float]:
    """Return the scales that are errors, by header."""
    offsets = len(problem.variables) + len(problem.sensors.scales)
    constants = np.arange(offsets, end.jacobian.shape[1])
    return {
        name: scale
        for column, name, scale in _list_scales(problem, end)
        if _is_significant(end, column, scale - 1.0, constants)
    }


def _list_scales(problem: FitProblem, end: Evaluation) -> Iterator[tuple[int, str, float]]:
    """Yield column of the Jacobian, header and value of the large scales that were added."""
    scales = zip(problem.sensors.scales, end.coefficients.tolist(), strict=False)
    for column, (sensor, scale) in enumerate(scales, len(problem.variables)):
        if sensor.name in problem.headers and _is_scale(scale):
            yield column, sensor.name, scale


def _describe_scales(problem: FitProblem, end: Evaluation, scales: Mapping[str, float]) -> str:
    """Return a clause on scales of one kind by header: that of the largest factor."""
    worst = max(scales, key=lambda x: _factor(scales[x]))
    scale = scales[worst]
    is_mirrored = _is_mirrored(scale)
    alike = [x for x in scales if x != worst and _is_mirrored(scales[x]) == is_mirrored]
    headers = [worst, *alike]
    columns = [remove_unit(x) for x in headers]
    remedy = f"scale=[{', '.join(map(repr, columns))}]"
    if shifted := [remove_unit(x) for x in headers if _has_offset(problem, end, x)]:
        remedy += f" and offset=[{', '.join(map(repr, shifted))}]"
    named = f"the data of {list_first(columns, _MAX_NAMES)} look"
    if is_mirrored:
        return (
            f"{named} mirrored (scale {scale:.3g}); reverse their sign, or estimate it with "
            f"{remedy}"
        )
    series = problem.data.series[problem.headers.index(worst)]
    return (
        f"{named} scaled (scale {scale:.3g}{_guess_units(worst, scale)}); check the calibration "
        f"and the unit in the header {series.name_in_data or series.column!r}, or estimate the "
        f"factor with {remedy}"
    )


def _describe_offsets(problem: FitProblem, end: Evaluation) -> str:
    """Return a clause on large constant errors of columns, or ""."""
    names = dict.fromkeys(header for _, header, _ in _unscaled_series(problem))
    headers = [x for x in names if _has_offset(problem, end, x)]
    if not headers:
        return ""
    columns = [remove_unit(x) for x in headers]
    offset = dict(zip(problem.coefficients, end.coefficients.tolist(), strict=True))[headers[0]]
    size = format_with_unit(float(f"{offset:.3g}"), split_unit(headers[0])[1])
    return (
        f"the data of {list_first(columns, _MAX_NAMES)} look shifted (offset {size}); correct the "
        f"zero of the sensor, or estimate it with offset=[{', '.join(map(repr, columns))}]"
    )


def _has_offset(problem: FitProblem, end: Evaluation, header: str) -> bool:
    """Return True if a column has a large constant error."""
    # Offsets follow scales.
    offsets = dict(zip(problem.coefficients, end.coefficients.tolist(), strict=True))
    pairs = zip(problem.data.series, problem.headers, strict=True)
    size = max(float(np.ptp(x.values)) for x, name in pairs if name == header)
    return abs(offsets[header]) > _MIN_OFFSET_SHARE * size


def _describe_delay(problem: FitProblem, end: Evaluation, column: str = "") -> str:
    """Return a clause on a delay, which vibrations determine up to whole periods.

    It is that of all data, or of a column.
    """
    columns, delay = dict.fromkeys(map(remove_unit, problem.headers)), float(end.values[-1])
    name = "*" if len(columns) > 1 else next(iter(columns))
    name = remove_unit(column) or name
    what = f"{name} looks" if column else "the data look"
    periods, or_more = np.diff(_list_best_delays(problem, end, column)), ", up to whole periods"
    if len(periods) > _OUTER_PERIODS:
        or_more = f", or by whole periods of {np.median(periods):.2g} s more or less"
    omit = advise_omission(problem, delay)
    return (
        f"{what} {'late' if delay > 0.0 else 'early'} by {abs(delay):.3g} s{or_more}; "
        f"correct their times, or {omit}estimate the delay with shift=[{name!r}]"
    )


def advise_omission(problem: FitProblem, delay: float) -> str:
    """Return advice to omit data that are earlier than the start of the run, or "".

    The default bounds of shift= are the first time of the data on both sides.
    """
    first = min(float(x.times[0]) for x in problem.data.series)
    return f"omit data before {2.0 * delay:.2g} s and " if delay > first else ""


def _guess_units(header: str, scale: float) -> str:
    """Return ", as between inches and mm" if such units of a column have this ratio, or ""."""
    unit = split_unit(header)[1]
    for like, ratio, names in _MISTAKEN_UNITS:
        is_near = abs(np.log(_factor(scale) / ratio)) < _FACTOR_TOLERANCE
        if is_near and (not like or not unit or conversion_factor(unit, like) is not None):
            return f", as between {names}"
    return ""
