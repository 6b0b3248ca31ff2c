"""Error estimate of a run from a second run, and verification by a different method."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    MissingPackageError,
    format_percent,
    name_with_others,
    short_repr,
)
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.integrators.limits import Progress
from beamdae.integrators.pilot_run import reuse_motion
from beamdae.interrupts import Interrupted, interruptible
from beamdae.results.columns import (
    Header,
    largest_of_kind,
    mark_resting_columns,
    mark_unresolved_columns,
    measure_amplitudes,
    remove_unit,
)
from beamdae.results.diagnostics.rounding_limits import rounding_limits
from beamdae.results.diagnostics.suspected_errors import SuspectedError
from beamdae.results.run_data import find_drift
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Error estimate: second runs of adaptive integrators. With these factors, the estimate covers the
# errors of 96 % of the columns of validation/tolerances at every rtol; see validation/README.md.
_TIGHTENING_FACTOR = 0.1  # tolerance: second run / first run
_LOOSENING_FACTOR = 10.0
_MIN_RTOL = 1e-10  # of tightened runs
_MAX_RTOL = 0.1  # of loosened runs
# Error of a run / its difference from a tighter run by a more accurate method or by the same one.
_FACTOR_OF_ANOTHER_METHOD = 1.25
_FACTOR_OF_THE_SAME_METHOD = 1.75
# Error of a run / (its difference from a looser run, divided by the predicted ratio of errors - 1).
_FACTOR_OF_A_LOOSER_RUN = 4.5
_MAX_DIFFERENCE_FACTOR = 3.0  # largest error estimate / difference of the two runs
_ORDER_OF_RADAU = 5
_LIMITED_ORDER = 2  # of BDF: a tenth of the tolerance takes two to three times the steps
# If the ratio of the numbers of steps is larger, the tolerance does not determine the steps, and
# the difference of the two runs shows no errors.
_MAX_STEP_COUNT_RATIO = 0.95
# Largest estimated error with fixed steps, relative to half the range. In 244 runs of 56 mechanisms
# with errors of 0.1 to 50 %, estimates by twice the step are 1.6 to 6 times the error in nine of
# ten (at most 18 times), and those by half the step, which replace larger ones, 1.6 to 2.6 times.
# Of 84 runs with errors of more than 10 %, 83 are above this limit, and 7 of the others.
_MAX_ERROR_OF_FIXED_STEPS = 0.15
_MAX_WORK = 2e5  # steps times coordinates of such a run
# Steps of a run that examines a suspected error, relative to those of the run, and its work.
_MAX_STEPS_OF_PROOF, _MAX_WORK_OF_PROOF = 2.0, 1e6
# Differences from such a run, relative to half the range, that are no errors.
_SMALL_DIFFERENCE = 0.02
_RECOMMENDED_ERROR = 0.01  # estimated error with the step that a warning names
# Estimated error from which on no sufficient step follows from it, and the part of the step that is
# named instead.
_UNRELATED_ERROR = 1.0
_STEP_RATIO_WITHOUT_ESTIMATE = 0.1
# A second run is abandoned after this multiple of the steps of the first run, but not before the
# smallest number, which takes about a second.
_MAX_STEPS_RATIO = 20
_MIN_MAX_STEPS = 10_000

# Verification.
# Guaranteed error of positions, angles and deflections / rtol.
_ALLOWED_ERROR = 100.0
_ALLOWED_ERROR_OF_DAMPED_BEAMS = 30.0
_ALLOWED_ERROR_WITHOUT_RTOL = 1e-3
_NEGLIGIBLE_SHARE = 1e-3  # half range of a column relative to the largest one of its kind
_RTOL_FOR_FIXED_STEPS = 1e-6  # of the second run, if the first run has fixed steps

# Columns of the tables.
HALF_RANGE = "half the range"
RELATIVE_ERROR = "error over half the range"
SIGNED_ERROR = "signed error"

_CACHED_ESTIMATE = "_estimate_of_fixed_steps"  # attribute of a solution
_MAX_NAMES = 2  # of further columns in a warning

# Columns of a table with one row per observed column, by header.
ErrorColumns = dict[str, Any]


@dataclass(frozen=True)
class _SecondRun:
    """Settings of a second run for the error estimate.

    Attributes
    ----------
    integrator
        Integrator of the second run.
    factor
        Estimated error of the first run / difference of the two runs, before the correction by the
        numbers of steps.
    order
        If not None, the second run has the same method as the first run and a tighter tolerance or
        a smaller step. The errors are then proportional to (number of steps)^-order.
    same_method
        True if both runs have the same method, so that their numbers of steps must differ.
    is_rough
        True if the estimate may be several times the error: one that has a warning is replaced by
        that of the next second run.
    """

    integrator: Integrator
    factor: float
    order: int | None = None
    same_method: bool = True
    is_rough: bool = False

    def difference_factor(self, steps: int, other_steps: int) -> float | None:
        """Return estimated error / difference of the runs, or None.

        None means that both runs have the same method and that their numbers of steps differ by
        less than about 5 %.
        """
        ratio = other_steps / max(steps, 1)
        if self.same_method and _MAX_STEP_COUNT_RATIO < ratio < 1.0 / _MAX_STEP_COUNT_RATIO:
            return None
        if self.order is None:
            return self.factor
        # The second run may have fewer steps if its tighter tolerance prevents failures of Newton's
        # method.
        correction = 1.0 / (1.0 - ratio**-self.order) if ratio > 1.0 else np.inf
        return float(min(self.factor * correction, max(self.factor, _MAX_DIFFERENCE_FACTOR)))


@interruptible
def error_estimate(solution: Solution) -> pd.DataFrame:
    """Estimate the error of each observed column, including forces and reactions.

    The motion is integrated again, and the estimate is the largest difference of the two runs times
    a factor. If the run has a tolerance, the second run has a tenth of it, but at least 1e-10:

    - after `Radau`, or `Ida` with a maximum order above 2, it uses the same method, and the
      factor is 1.75 / (1 - (n / n2)^p), at most 3, with the numbers of steps n and n2 of the first
      and second runs and p = 5 for `Radau` or the maximum order for `Ida`;
    - after `GeneralizedAlpha`, or `Ida` with a maximum order of 1 or 2, it uses `Radau`, and the
      factor is 1.25: the same method would take two to three times the steps.

    If this run does not reach the end, or the tolerance does not determine its steps, another
    tolerance or another method is used. For fixed steps, the second run has twice the step; the
    factor is 4.5 / (2^order - 1), at most 3. The checks of `simulate` have made this second run
    already, and it is not repeated.

    In the cases of validation/tolerances, the estimate covers the true error of 96 to 99.5 % of the
    columns of runs of `Auto`; the median of estimate over true error is 1.7 to 1.9.

    Parameters
    ----------
    solution
        The run.

    Returns
    -------
    pandas.DataFrame
        One row per observed column: half of its range or, if the column is constant but for errors,
        its largest magnitude (of positions and angles: the largest displacement from the drawing)
        [unit of the column]; the estimated largest error relative to this
        [-]; and the signed error [-], the run minus the second run at the time of their largest
        difference, in the same unit. Errors of columns at rest are 0. Errors are NaN for columns
        that are not finite, and for a run with a single row. If no second run allows an estimate,
        the estimated errors are infinite and the signed errors NaN.

    Raises
    ------
    BeamdaeError
        If `solution` is not a solution or does not contain its integrator.
    Interrupted
        If the second run is interrupted.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> bob = mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
    >>> rod = mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), bob.point))
    >>> mech.observe("bob", bob.point)
    >>> errors = bd.error_estimate(bd.simulate(mech, t_end=1.0))
    >>> bool(errors["error over half the range"].max() < 1e-3)
    True
    """
    return _tabulate(solution, _estimate(solution, None))


def estimate_errors(
    solution: Solution, progress: Progress | None = None, max_steps: int | None = None
) -> ErrorColumns:
    """Return the columns of `error_estimate`, except the signed error, as arrays by header.

    Parameters
    ----------
    solution
        The run.
    progress
        Progress function of the second run; see `simulate`.
    max_steps
        Largest number of steps of a second run. Defaults to 20 times those of the run, at least
        10 000.

    Raises
    ------
    BeamdaeError, Interrupted
        See `error_estimate`.
    """
    columns = _estimate(solution, progress, max_steps)
    return {name: columns[name] for name in (HALF_RANGE, RELATIVE_ERROR)}


def _estimate(
    solution: Solution, progress: Progress | None, max_steps: int | None = None
) -> ErrorColumns:
    name, _ = _require_own_integrator("error_estimate", solution).accuracy
    if name == "step":
        # The checks of the run, `error_estimate` and reports share one second run.
        cache = vars(solution)
        if _CACHED_ESTIMATE not in cache:
            cache[_CACHED_ESTIMATE] = _compare_second_run(solution, progress, max_steps)
        columns: ErrorColumns = cache[_CACHED_ESTIMATE]
        return columns
    return _compare_second_run(solution, progress, max_steps)


def _compare_second_run(
    solution: Solution, progress: Progress | None, max_steps: int | None
) -> ErrorColumns:
    integrator = solution.made_by
    name, value = integrator.accuracy
    rough: ErrorColumns | None = None
    if len(solution.t) > 1:
        for second in _second_runs(solution, integrator, max_steps):
            # With the same amplitudes, only the tolerance differs.
            motion = solution.trajectory
            try:
                other = run_again(solution, second.integrator, progress, motion=motion)
            except MissingPackageError:
                continue  # Ida is one of several methods
            if other is None:
                continue
            steps = solution.trajectory.steps, other.trajectory.steps
            factor = second.difference_factor(*steps)
            if factor is None:
                continue
            columns = _compare(solution, other, factor, value if name == "rtol" else 0.0)
            if not (second.is_rough and accuracy_warning(solution, columns)):
                return columns
            rough = columns
    if rough is not None:
        return rough
    # A single row has no range.
    return _compare(solution, None, np.inf if len(solution.t) > 1 else np.nan)


def _second_runs(
    solution: Solution, integrator: Integrator, max_steps: int | None
) -> Iterator[_SecondRun]:
    """Yield second runs for the error estimate, the preferred one first."""
    name, value = integrator.accuracy
    if max_steps is None:
        max_steps = max(_MAX_STEPS_RATIO * solution.trajectory.steps, _MIN_MAX_STEPS)
    if name == "step":
        order = integrator.order
        coarse = min(_FACTOR_OF_A_LOOSER_RUN / (2.0**order - 1.0), _MAX_DIFFERENCE_FACTOR)
        is_short = solution.trajectory.steps * solution.equations.n <= _MAX_WORK
        yield _SecondRun(_with_accuracy(integrator, 2.0 * value), coarse, is_rough=is_short)
        yield _SecondRun(
            _with_accuracy(integrator, 0.5 * value), _FACTOR_OF_THE_SAME_METHOD, order=order
        )
        yield _SecondRun(
            Radau(
                _RTOL_FOR_FIXED_STEPS,
                max_steps=max_steps,
                time_limit=getattr(integrator, "time_limit", None),
            ),
            _FACTOR_OF_ANOTHER_METHOD,
            same_method=False,
        )
        return
    is_radau = solution.integrator.get("method") == "Radau"
    order = _ORDER_OF_RADAU if is_radau else solution.integrator.get("max_order", _LIMITED_ORDER)
    tight = max(_TIGHTENING_FACTOR * value, _MIN_RTOL)
    loose = min(_LOOSENING_FACTOR * value, _MAX_RTOL)
    limits: dict[str, Any] = {
        "max_step": getattr(integrator, "max_step", None),
        "max_steps": max_steps,
    }
    limits["time_limit"] = getattr(integrator, "time_limit", None)
    same = _SecondRun(
        _with_accuracy(integrator, tight, max_steps), _FACTOR_OF_THE_SAME_METHOD, order
    )
    if order > _LIMITED_ORDER:
        yield same
    # Imported here because one second run usually suffices.
    from beamdae.integrators import GeneralizedAlpha, Ida

    another = _SecondRun(
        Ida(tight, **limits) if is_radau else Radau(tight, **limits),
        _FACTOR_OF_ANOTHER_METHOD,
        same_method=False,
    )
    yield another
    if order <= _LIMITED_ORDER:
        yield same
    factor = _FACTOR_OF_A_LOOSER_RUN / (_LOOSENING_FACTOR**integrator.order - 1.0)
    yield _SecondRun(
        _with_accuracy(integrator, loose, max_steps), min(factor, _MAX_DIFFERENCE_FACTOR)
    )
    yield replace(another, integrator=GeneralizedAlpha(rtol=tight, max_steps=max_steps))


def _with_accuracy(integrator: Integrator, value: float, max_steps: int | None = None) -> Any:
    """Return a copy with `value` as step or rtol, and with `max_steps` if this setting exists."""
    changes: dict[str, Any] = {integrator.accuracy.name: value}
    if max_steps is not None and hasattr(integrator, "max_steps"):
        changes["max_steps"] = max_steps
    return replace(integrator, **changes)  # type: ignore[type-var]


def find_excessive_errors(
    solution: Solution, errors: Mapping[str, Any], requested: Collection[str] = ()
) -> dict[str, float]:
    """Return the errors above the bound of `accuracy_warning` by header; see this function."""
    name, value = solution.made_by.accuracy
    if not solution.status.success:
        return {}
    has_fixed_steps = name == "step"
    bound = _MAX_ERROR_OF_FIXED_STEPS if has_fixed_steps else _guaranteed_ratio(solution) * value
    rows = zip(
        np.asarray(errors[RELATIVE_ERROR]).tolist(),
        solution.columns,
        mark_negligible_columns(solution, errors).tolist(),
        strict=True,
    )
    return {
        column: error
        for error, column, is_small in rows
        if (has_fixed_steps or _is_controlled(column))
        and error > bound
        and (column in requested or not is_small)
    }


def accuracy_warning(
    solution: Solution, errors: Mapping[str, Any], requested: Collection[str] = ()
) -> str:
    """Return a warning if the error of a column is too large, or "".

    The bound on the error of positions, angles and deflections relative to half the range is 30
    rtol if the mechanism has beams and all of them have material damping, otherwise 100 rtol. With
    fixed steps, the bound is 0.15 for all columns. Columns whose half range is below a thousandth
    of the largest one of their kind are negligible and have no warning.

    Parameters
    ----------
    solution
        The run. There is no warning if it stopped early, because the bound refers to the range of
        the whole motion.
    errors
        The result of `estimate_errors` or `error_estimate`.
    requested
        Headers of columns that have a warning even if they are negligible.

    Raises
    ------
    BeamdaeError
        If `solution` is not a solution or does not contain its integrator.
    """
    integrator = _require_own_integrator("accuracy_warning", solution)
    excessive = find_excessive_errors(solution, errors, requested)
    if not excessive:
        return ""
    largest, column = max((error, column) for column, error in excessive.items())
    if np.isinf(largest):
        return (
            f"{column}: the error is unknown, because all second runs, with other tolerances and "
            "methods, stopped early, took the same steps, or are not finite in this column; check "
            "the model and use another method."
        )
    if integrator.accuracy.name == "step":
        return describe_step_errors(excessive, integrator)
    return (
        f"{column}: the estimated error is {largest:.2g} of half the range, more than "
        f"{_guaranteed_ratio(solution):g} times rtol; reduce rtol by a factor of ten, or use "
        "another method."
    )


def describe_step_errors(errors: Mapping[str, float], integrator: Integrator) -> str:
    """Return the warning about the estimated errors of columns (by header) with fixed steps."""
    step = integrator.accuracy.value
    worst, *others = sorted(errors, key=lambda header: -errors[header])
    largest = errors[worst]
    if largest < _UNRELATED_ERROR:
        shorter = step * (_RECOMMENDED_ERROR / largest) ** (1.0 / integrator.order)
        size, remedy = f"up to {format_percent(largest)}", f"a step of {shorter:.1g} s"
    else:
        shorter = _STEP_RATIO_WITHOUT_ESTIMATE * step
        size, remedy = "more than 100 %", f"at first a step of {shorter:.1g} s"
    return (
        f"{name_with_others(remove_unit(worst), [remove_unit(x) for x in others], _MAX_NAMES)}: "
        f"the error with fixed steps of {step:.3g} s is estimated at {size} of half its range; use "
        f"{remedy}, or an integrator with rtol."
    )


def mark_negligible_columns(solution: Solution, errors: Mapping[str, Any]) -> Array:
    """Return True where half the range is below a thousandth of the largest one of its kind.

    Parameters
    ----------
    solution, errors
        As for `accuracy_warning`.
    """
    half_range = np.asarray(errors[HALF_RANGE])
    largest = largest_of_kind(solution.columns, half_range, solution.equations.length)
    return half_range < _NEGLIGIBLE_SHARE * largest


def _guaranteed_ratio(solution: Solution) -> float:
    """Return the bound on errors of positions and angles, divided by half the range and by rtol."""
    beams = beams_of(solution.equations.mechanism)
    if beams and all(beam.section.at(0.5 * beam.length).damping > 0.0 for beam in beams):
        return _ALLOWED_ERROR_OF_DAMPED_BEAMS
    return _ALLOWED_ERROR


@interruptible
def verify(solution: Solution, integrator: Integrator | None = None) -> pd.DataFrame:
    """Verify a run by a second run with a different method and a tighter tolerance.

    Parameters
    ----------
    solution
        The run.
    integrator
        Integrator of the second run. Defaults to `Radau`, or to `GeneralizedAlpha` if Radau made
        the run, with a tenth of the tolerance, but at least 1e-10. If the run has fixed steps, the
        tolerance is 1e-6.

    Returns
    -------
    pandas.DataFrame
        One row per observed column: half of its range [unit of the column]; the largest difference
        relative to half the range [-]; the allowed difference of positions and angles [-], 100
        times the looser rtol (NaN for other columns); and the verdict. A run with fixed steps has
        an allowed difference of at least 1e-3. The verdict is "agrees" or "differs", or "not
        verified" if the second run stopped early, the run has a single row or the column is not
        finite. For columns in other units, whose errors rtol
        does not control, and for all columns if the first run stopped early, the verdict is
        "time error ..." with the difference, which contains no error of the mesh or the model.

    Raises
    ------
    BeamdaeError
        If `solution` is not a solution or does not contain its integrator, or `integrator` is
        not an integrator.
    Interrupted
        If the second run is interrupted.
    """
    return _tabulate(solution, compare_methods(solution, integrator))


def compare_methods(
    solution: Solution, integrator: Integrator | None = None, progress: Progress | None = None
) -> ErrorColumns:
    """Return the columns of `verify` as arrays and lists by header.

    Parameters
    ----------
    solution, integrator
        As for `verify`.
    progress
        Progress function of the second run; see `simulate`.

    Raises
    ------
    BeamdaeError, Interrupted
        See `verify`.
    """
    name, value = _require_own_integrator("verify", solution).accuracy
    has_rtol = name == "rtol"
    allowed_error = _ALLOWED_ERROR * value if has_rtol else _ALLOWED_ERROR_WITHOUT_RTOL
    if integrator is None:
        rtol = max(_TIGHTENING_FACTOR * value, _MIN_RTOL) if has_rtol else _RTOL_FOR_FIXED_STEPS
        is_radau = solution.integrator.get("method") == "Radau"
        from beamdae.integrators import GeneralizedAlpha

        integrator = GeneralizedAlpha(rtol=rtol) if is_radau else Radau(rtol)
    other_name, other_value = require_integrator("verify", integrator).accuracy
    if other_name == "rtol":
        allowed_error = max(allowed_error, _ALLOWED_ERROR * other_value)
    other = run_again(solution, integrator, progress)
    rtol = value if has_rtol else 0.0
    columns = _compare(solution, other, np.nan if other is None else 1.0, rtol)
    del columns[SIGNED_ERROR]
    # The allowed difference refers to half the range of a complete run.
    is_whole = solution.status.success
    is_judged = [is_whole and _is_controlled(column) for column in solution.columns]
    limits = np.where(is_judged, allowed_error, np.nan)
    verdicts = [
        _judge(error, limit) for error, limit in zip(columns[RELATIVE_ERROR], limits, strict=True)
    ]
    return {**columns, "allowed": limits, "verdict": verdicts}


def _judge(error: float, allowed_error: float) -> str:
    if np.isnan(error):
        return "not verified"
    if np.isnan(allowed_error):
        return f"time error {round(100.0 * error, 1):g} %"
    return "agrees" if error <= allowed_error else "differs"


def _is_controlled(column: str) -> bool:
    """Return True if the column is a position or an angle, whose error rtol controls."""
    return Header.of(column).unit in ("m", "rad")


def _tabulate(solution: Solution, columns: ErrorColumns) -> pd.DataFrame:
    # Imported here because the import takes as long as a short run and the command line does not
    # need it.
    import pandas as pd

    return pd.DataFrame(columns, index=pd.Index(list(solution.columns)))


def _require_own_integrator(name: str, solution: Any) -> Integrator:
    """Return the integrator of the solution; `name` is the calling function, for messages."""
    if not isinstance(solution, Solution):
        raise BeamdaeError(
            f"{name}: solution must be a Solution of a run, got {short_repr(solution)}."
        )
    if not isinstance(solution.made_by, Integrator):
        raise BeamdaeError(
            f"{name}: made_by of the solution must be the integrator of the run, got "
            f"{short_repr(solution.made_by)}; pass the solution returned by simulate."
        )
    return require_integrator(name, solution.made_by)


def run_again(
    solution: Solution,
    integrator: Integrator,
    progress: Progress | None,
    equations: EquationsOfMotion | None = None,
    motion: Trajectory | None = None,
) -> Solution | None:
    """Repeat the run; return None if it has a single row or the repeated run is not completed.

    `equations` default to those of the run. With a similar `motion`, see `reuse_motion`, there are
    no pilot runs.
    """
    if len(solution.t) < 2:
        return None
    # The rows of `Solution.at_times` may begin later than the run.
    begin = solution.trajectory.start
    is_later = solution.t[0] > begin
    times = np.append(begin, solution.t) if is_later else solution.t
    with reuse_motion(motion):
        other = integrator.integrate(equations or solution.equations, times, progress)
    if is_later:
        other = replace(other, t=other.t[1:])
    if other.status.kind == "interrupted":
        raise Interrupted(other.status.sentence)
    return other if other.status.success else None


def is_refuted(solution: Solution, suspected: SuspectedError) -> bool:
    """Return True if a run with sufficient settings has nearly the same columns.

    Differences of the output rows and of the extremes over the steps of less than 2 % of half the
    range are small. Long runs are not repeated.

    Parameters
    ----------
    solution
        A completed run.
    suspected
        A suspected error of the run.
    """
    integrator: Any = solution.made_by
    settings: dict[str, Any] = dict(suspected.settings)
    if not settings or not all(hasattr(integrator, name) for name in settings):
        return False
    motion, n = solution.trajectory, solution.equations.n
    work = np.clip(_MAX_STEPS_OF_PROOF * motion.steps * n, _MAX_WORK, _MAX_WORK_OF_PROOF)
    limit = int(work / n)
    if max(motion.steps, (motion.end - motion.start) / settings.get("max_step", np.inf)) > limit:
        return False
    if hasattr(integrator, "max_steps"):
        settings["max_steps"] = limit
    other = run_again(solution, replace(integrator, **settings), None, motion=motion)
    if other is None:
        return False
    of_rows = dict(
        zip(solution.columns, _compare(solution, other, 1.0)[RELATIVE_ERROR], strict=True)
    )
    for header in suspected.columns:
        extremes, accurate = solution.step_extremes[header], other.step_extremes[header]
        change = max(abs(extremes.min - accurate.min), abs(extremes.max - accurate.max))
        if not max(of_rows[header], change / extremes.half_range) < _SMALL_DIFFERENCE:
            return False
    return True


def _compare(
    solution: Solution, other: Solution | None, fraction: float, rtol: float = 0.0
) -> ErrorColumns:
    """Return half the range, the relative error and the signed error of each column.

    For columns that are constant but for errors, the largest magnitude replaces half the range; see
    `measure_amplitudes`. The signed error is the largest difference of the runs over half the
    range, with its sign; the relative error is its magnitude times `fraction`, or `fraction`
    without `other`. `rtol` is the tolerance of the run, 0 for fixed steps.
    """
    if other is not None and other.t[-1] < solution.t[-1]:
        # An event may end the second run slightly earlier.
        common = solution.t[solution.t <= other.t[-1]]
        solution, other = replace(solution, t=common), replace(other, t=common)
    rows = _stack_columns(solution)
    rows = np.where(np.isfinite(rows).all(axis=0), rows, np.nan)
    headers, length = list(solution.columns), solution.equations.length
    half_range = 0.5 * np.ptp(rows, axis=0)
    amplitude, _ = measure_amplitudes(solution.equations, rows, rtol)
    error = np.full(len(half_range), fraction)
    signed = np.full(len(half_range), np.nan)
    mechanism = solution._sizes_of_mechanism
    is_at_rest = mark_resting_columns(headers, rows, half_range, length, others=mechanism)
    if other is not None:
        differences = rows - _stack_columns(other)
        worst = np.argmax(np.abs(differences), axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            difference = np.take_along_axis(differences, worst[None], axis=0)[0]
            signed = difference / amplitude
        error = fraction * np.abs(signed)
        runs = (solution, other)
        is_at_rest |= mark_unresolved_columns(
            headers,
            half_range,
            np.abs(difference),
            length,
            rtol,
            map(find_drift, runs),
            mechanism,
        )
        rounding = rounding_limits(solution.equations, headers, solution.trajectory.mean_step)
        is_at_rest |= np.maximum(half_range, 0.5 * np.abs(difference)) <= rounding
    error = np.where(np.isfinite(half_range), error, np.nan)
    if not np.isnan(fraction):
        error, signed = (np.where(is_at_rest, 0.0, x) for x in (error, signed))
    amplitude = np.where(is_at_rest, half_range, amplitude)
    return {HALF_RANGE: amplitude, RELATIVE_ERROR: error, SIGNED_ERROR: signed}


def _stack_columns(solution: Solution) -> Array:
    """Return the observed columns, (k, number of columns)."""
    columns = solution.columns.values()
    return np.stack(list(columns), axis=1) if columns else np.zeros((len(solution.t), 0))
