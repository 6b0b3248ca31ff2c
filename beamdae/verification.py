"""Error estimate of a run from a second run, and verification by a different method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError, short_repr
from beamdae.integrators import GeneralizedAlpha, Integrator, Radau
from beamdae.integrators.integrator import Progress, require_integrator
from beamdae.results.columns import Header
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Error estimate.
_COARSENING_FACTORS = {"rtol": 10.0, "step": 2.0}  # tolerance or step: second run / first run
_MAX_COARSENED_RTOL = 3e-4  # at larger rtol, errors do not yet follow the order
_SAFETY_FACTOR = 4.5  # applied to the error predicted by the order; stiff errors decrease slowly
_MAX_DIFFERENCE_FACTOR = 3.0  # largest error estimate / difference of the two runs
# If the ratio of the numbers of steps is larger, the difference of two runs shows no errors.
_MAX_STEP_COUNT_RATIO = 0.95

# Verification.
_ALLOWED_ERROR = 100.0  # allowed difference of positions and angles / looser rtol
_ALLOWED_ERROR_WITHOUT_RTOL = 1e-3
_TIGHTENING_FACTOR = 0.1  # tolerance: second run / first run
_MIN_RTOL = 1e-10
_RTOL_FOR_FIXED_STEPS = 1e-6  # of the second run, if the first run has fixed steps

# Columns whose half range is below either of these are at rest.
_REST_TO_OTHERS_RATIO = 1e-9  # relative to the largest half range of a column with the same unit
_REST_TO_VALUES_RATIO = 1e-12  # relative to the largest value of the column: rounding errors

# Columns of the tables.
HALF_RANGE = "half the range"
RELATIVE_ERROR = "error over half the range"

# Columns of a table with one row per observed column, by header.
ErrorColumns = dict[str, Any]


def error_estimate(solution: Solution) -> pd.DataFrame:
    """Estimate the error of each observed column, including forces and reactions.

    The integrator runs again with ten times the tolerance rtol, or twice the step h. If errors are
    proportional to rtol^order or h^order, the largest difference d of the two runs is
    (c^order - 1) times the error of the finer run, with c = 10 or 2. The estimate is
    4.5 d / (c^order - 1), but at most 3 d. The factor 4.5 allows for stiff mechanisms, whose errors
    decrease more slowly (validation/tolerances counts how often the estimate covers the true
    error).

    In two cases, the second run has a tenth of the tolerance instead, and the estimate is 3 d: with
    Radau, because neither the run nor a coarser run resolves fast vibrations; and with rtol above
    3e-4, where errors do not yet follow the order.

    Parameters
    ----------
    solution
        The run.

    Returns
    -------
    pandas.DataFrame
        One row per observed column: half of its range [unit of the column], and the estimated
        largest error relative to half the range [-]. The error is NaN if the second run stopped
        early or the numbers of steps of the two runs differ by less than 5 %, and for columns that
        are not finite. Otherwise, the error is 0 for columns at rest.

    Raises
    ------
    BeamdaeError
        If `solution` is not a solution or does not contain its integrator.
    KeyboardInterrupt
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
    return _tabulate(solution, estimate_errors(solution))


def estimate_errors(solution: Solution, progress: Progress | None = None) -> ErrorColumns:
    """Return the columns of `error_estimate` as arrays.

    Parameters
    ----------
    solution
        The run.
    progress
        Progress function of the second run; see `simulate`.

    Raises
    ------
    BeamdaeError, KeyboardInterrupt
        See `error_estimate`.
    """
    integrator = _require_own_integrator("error_estimate", solution)
    name, value = integrator.accuracy
    factor = _COARSENING_FACTORS[name]
    fraction = min(_SAFETY_FACTOR / (factor**integrator.order - 1.0), _MAX_DIFFERENCE_FACTOR)
    is_loose = name == "rtol" and value > _MAX_COARSENED_RTOL
    if is_loose or solution.integrator.get("method") == "Radau":
        factor, fraction = _TIGHTENING_FACTOR, _MAX_DIFFERENCE_FACTOR
    refined: Any = replace(integrator, **{name: factor * value})  # type: ignore[type-var]
    other = _run_again(solution, refined, progress)
    if other is not None:
        steps = solution.trajectory.steps, other.trajectory.steps
        # If the numbers of steps are nearly equal, the tolerance does not determine the steps.
        if min(steps) > _MAX_STEP_COUNT_RATIO * max(steps):
            other = None
    return _compare(solution, other, fraction)


def accuracy_warning(solution: Solution, errors: Mapping[str, Any]) -> str:
    """Return a warning if the relative error of a position or angle exceeds 100 rtol, else "".

    Parameters
    ----------
    solution
        The run. There is no warning if the integrator has no rtol or the run stopped early, because
        the limit refers to the range of the whole motion.
    errors
        The result of `estimate_errors` or `error_estimate`.

    Raises
    ------
    BeamdaeError
        If `solution` is not a solution or does not contain its integrator.
    """
    name, value = _require_own_integrator("accuracy_warning", solution).accuracy
    if not solution.status.success or name != "rtol":
        return ""
    rows = zip(np.asarray(errors[RELATIVE_ERROR]).tolist(), solution.columns, strict=True)
    excessive = [
        (error, column)
        for error, column in rows
        if _is_controlled(column) and error > _ALLOWED_ERROR * value
    ]
    if not excessive:
        return ""
    largest, column = max(excessive, key=lambda row: row[0])
    return (
        f"{column}: the estimated error is {largest:.2g} of half the range, more than "
        f"{_ALLOWED_ERROR:g} times rtol; reduce rtol by a factor of ten, or use "
        "another method."
    )


def verify(solution: Solution, by: Integrator | None = None) -> pd.DataFrame:
    """Verify a run by a second run with a different method and a tighter tolerance.

    Parameters
    ----------
    solution
        The run.
    by
        Integrator of the second run. Defaults to `Radau`, or to `GeneralizedAlpha` if Radau made
        the run, with a tenth of the tolerance, but at least 1e-10. If the run has fixed steps, the
        tolerance is 1e-6.

    Returns
    -------
    pandas.DataFrame
        One row per observed column: half of its range [unit of the column]; the largest difference
        relative to half the range [-]; the allowed difference of positions and angles [-], 100
        times the looser rtol; and the verdict. A run with fixed steps has an allowed difference of
        at least 1e-3. The verdict is "agrees" or "differs", or "not verified" if the second run
        stopped early or the column is not finite. For columns in other units, whose errors rtol
        does not control, and for all columns if the first run stopped early, the verdict is
        "known to ..." with the difference.

    Raises
    ------
    BeamdaeError
        If `solution` is not a solution or does not contain its integrator, or `by` is not an
        integrator.
    KeyboardInterrupt
        If the second run is interrupted.
    """
    return _tabulate(solution, compare_methods(solution, by))


def compare_methods(
    solution: Solution, by: Integrator | None = None, progress: Progress | None = None
) -> ErrorColumns:
    """Return the columns of `verify` as arrays.

    Parameters
    ----------
    solution, by
        As for `verify`.
    progress
        Progress function of the second run; see `simulate`.

    Raises
    ------
    BeamdaeError, KeyboardInterrupt
        See `verify`.
    """
    name, value = _require_own_integrator("verify", solution).accuracy
    has_rtol = name == "rtol"
    allowed_error = _ALLOWED_ERROR * value if has_rtol else _ALLOWED_ERROR_WITHOUT_RTOL
    if by is None:
        rtol = max(_TIGHTENING_FACTOR * value, _MIN_RTOL) if has_rtol else _RTOL_FOR_FIXED_STEPS
        is_radau = solution.integrator.get("method") == "Radau"
        by = GeneralizedAlpha(rtol=rtol) if is_radau else Radau(rtol)
    other_name, other_value = require_integrator("verify", by).accuracy
    if other_name == "rtol":
        allowed_error = max(allowed_error, _ALLOWED_ERROR * other_value)
    columns = _compare(solution, _run_again(solution, by, progress), 1.0)
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
        return f"known to {error:.1%}"
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


def _run_again(
    solution: Solution, integrator: Integrator, progress: Progress | None
) -> Solution | None:
    """Repeat the run with `integrator`; return None if the repeated run is not completed."""
    if len(solution.t) < 2:
        return None
    other = integrator.integrate(solution.equations, solution.t, progress)
    if other.status.kind == "interrupted":
        raise KeyboardInterrupt
    return other if other.status.success else None


def _compare(solution: Solution, other: Solution | None, fraction: float) -> ErrorColumns:
    """Return half the range of each column, and `fraction` times the difference relative to it."""
    if other is not None and other.t[-1] < solution.t[-1]:
        # An event may end the second run slightly earlier.
        common = solution.t[solution.t <= other.t[-1]]
        solution, other = replace(solution, t=common), replace(other, t=common)
    rows = _stack_columns(solution)
    rows = np.where(np.isfinite(rows).all(axis=0), rows, np.nan)
    half_range = 0.5 * np.ptp(rows, axis=0)
    error = np.full(len(half_range), np.nan)
    if other is not None:
        difference = np.max(np.abs(rows - _stack_columns(other)), axis=0)
        largest = np.max(np.abs(rows), axis=0)
        is_at_rest = half_range <= _rest_limits(solution, half_range, largest)
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.where(is_at_rest, 0.0, fraction * difference / half_range)
    return {HALF_RANGE: half_range, RELATIVE_ERROR: error}


def _stack_columns(solution: Solution) -> Array:
    """Return the observed columns, (k, number of columns)."""
    columns = solution.columns.values()
    return np.stack(list(columns), axis=1) if columns else np.zeros((len(solution.t), 0))


def _rest_limits(solution: Solution, half_range: Array, largest: Array) -> Array:
    """Return the half range of each column at or below which the column is at rest."""
    kinds = [Header.of(name).kind for name in solution.columns]
    of_kind = dict.fromkeys(kinds, 0.0)
    for kind, value in zip(kinds, np.nan_to_num(half_range, posinf=np.inf).tolist(), strict=True):
        of_kind[kind] = max(of_kind[kind], value)
    return np.maximum(
        _REST_TO_OTHERS_RATIO * np.array([of_kind[kind] for kind in kinds]),
        _REST_TO_VALUES_RATIO * largest,
    )
