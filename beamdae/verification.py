"""How far a run is off: by another run of its like, or by another method."""

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

# The coarser run: so many times the tolerance, or the step.
_COARSER = {"rtol": 10.0, "step": 2.0}
_LOOSE = 3e-4
# The difference is that of errors which fall as the order says, or by less than that.
_SAFETY = 4.5
# The finer run is off as well.
_OF_FINER = 3.0
# Runs of so nearly as many steps say nothing of their errors.
_ALIKE = 0.95
# What columns may differ by, over rtol, in a verification.
_PROMISED = 100.0
_TIGHTER = 0.1
_TIGHTEST = 1e-10
# A column that moves less, beside others in its unit, moves by rounding alone; and one that moves
# less beside its own size.
_AT_REST, _ROUNDING = 1e-9, 1e-12

HALF_RANGE, RELATIVE_ERROR = "half the range", "error over half the range"

# Columns of a table with a row for each observed column.
ErrorColumns = dict[str, Any]


def error_estimate(solution: Solution) -> pd.DataFrame:
    """Estimate of the error of each observed column, forces and reactions among them.

    The same integrator goes again with ten times the tolerance, or twice the step. With errors
    that fall as accuracy^order, the difference d of the two runs is (c^order - 1) times the error
    of the finer one, c = 10 or 2; 4.5 times d / (c^order - 1), at most 3 d, is told, for errors
    of stiff mechanisms fall more slowly (validation/tolerances counts how often it covers the true
    one). Radau passes over vibrations, and coarser steps would pass over the same; and where rtol
    is above 3e-4 errors do not fall yet as they should: there it goes again with a tenth of the
    tolerance, and 3 d is told.

    Returns
    -------
    DataFrame
        By column: half its range [its unit], and the estimate of its largest error over that [-];
        NaN where the other run did not end or took as many steps, and of columns that are not
        finite; 0 where a column is at rest.

    Raises
    ------
    BeamdaeError
        If the solution does not know its integrator.
    KeyboardInterrupt
        If the other run is interrupted.

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
    return _table(solution, estimate_errors(solution))


def estimate_errors(solution: Solution, progress: Progress | None = None) -> ErrorColumns:
    """The columns of `error_estimate`, as arrays; `progress` is that of the other run."""
    integrator = _integrator_of("error_estimate", solution)
    name, value = integrator.accuracy
    factor = _COARSER[name]
    fraction = min(_SAFETY / (factor**integrator.order - 1.0), _OF_FINER)
    too_loose = name == "rtol" and value > _LOOSE
    if too_loose or solution.integrator.get("method") == "Radau":
        factor, fraction = _TIGHTER, _OF_FINER
    other = _again(solution, _with(integrator, factor), progress)
    alike = other is not None and _alike(solution.trajectory.steps, other.trajectory.steps)
    return _difference(solution, None if alike else other, fraction)


def _alike(steps: int, others: int) -> bool:
    """Whether something else than the tolerance limits steps: both runs are as far off then."""
    return min(steps, others) > _ALIKE * max(steps, others)


def accuracy_warning(solution: Solution, errors: Mapping[str, Any]) -> str:
    """A sentence on the position or angle whose error exceeds 100 rtol, if there is one.

    `errors` are those of `error_estimate`, a row for each observed column in their order.
    Of a run that was cut short nothing is promised: half the range is that of the whole motion.
    """
    name, value = _integrator_of("exceeded", solution).accuracy
    if not solution.status.success:
        return ""
    told = zip(np.asarray(errors[RELATIVE_ERROR]).tolist(), solution.columns, strict=True)
    promised = [(error, column) for error, column in told if _is_promised(column)]
    beyond = [both for both in promised if both[0] > _PROMISED * value]
    if name != "rtol" or not beyond:
        return ""
    most, worst = max(beyond, key=lambda both: both[0])
    return (
        f"{worst}: its error is put at {most:.2g} of half its range, more than "
        f"the {_PROMISED:g} rtol that are promised; take a tenth of rtol, or another method."
    )


def _with(integrator: Integrator, factor: float) -> Integrator:
    """The same with another accuracy."""
    name, value = integrator.accuracy
    other: Any = replace(integrator, **{name: factor * value})  # type: ignore[type-var]
    return other


def verify(solution: Solution, by: Integrator | None = None) -> pd.DataFrame:
    """Compare a run with one of another method at a tighter tolerance.

    Parameters
    ----------
    solution
        The run.
    by
        The other integrator; default Radau at a tenth of the tolerance, or GeneralizedAlpha(rtol)
        where the run was made by Radau.

    Returns
    -------
    DataFrame
        By observed column: half its range, the largest difference over that, what positions and
        angles may differ by (100 rtol of the looser run, or 1e-3 without one), and the verdict:
        "agrees", "differs",
        "known to ..." for rates, forces and moments, of which rtol promises nothing, and for all
        columns of a run that was cut short, and "not verified" where the other run did not end.

    Raises
    ------
    BeamdaeError
        If the solution does not know its integrator.
    KeyboardInterrupt
        If the other run is interrupted.
    """
    return _table(solution, compare_methods(solution, by))


def compare_methods(
    solution: Solution, by: Integrator | None = None, progress: Progress | None = None
) -> ErrorColumns:
    """The columns of `verify`, as arrays; `progress` is that of the other run."""
    name, value = _integrator_of("verify", solution).accuracy
    allowed = _PROMISED * value if name == "rtol" else 1e-3
    if by is None:
        rtol = max(_TIGHTER * value, _TIGHTEST) if name == "rtol" else 1e-6
        radau = solution.integrator.get("method") == "Radau"
        by = GeneralizedAlpha(rtol=rtol) if radau else Radau(rtol)
    other, loosest = require_integrator("verify", by).accuracy
    if other == "rtol":
        allowed = max(allowed, _PROMISED * loosest)
    found = _difference(solution, _again(solution, by, progress), 1.0)
    # Half the range is that of a whole run, or nothing is promised.
    whole = solution.status.success
    promised = [whole and _is_promised(column) for column in solution.columns]
    most = np.where(promised, allowed, np.nan)
    verdicts = [
        _verdict(error, bound) for error, bound in zip(found[RELATIVE_ERROR], most, strict=True)
    ]
    return {**found, "allowed": most, "verdict": verdicts}


def _is_promised(column: str) -> bool:
    """Whether rtol promises anything of a column: it does of positions and angles."""
    return Header.of(column).unit in ("m", "rad")


def _table(solution: Solution, found: ErrorColumns) -> pd.DataFrame:
    # Here, for importing it takes as long as a short run, which does without.
    import pandas as pd

    return pd.DataFrame(found, index=pd.Index(list(solution.columns)))


def _verdict(error: float, allowed: float) -> str:
    if np.isnan(error):
        return "not verified"
    if np.isnan(allowed):
        return f"known to {error:.1%}"
    return "agrees" if error <= allowed else "differs"


def _integrator_of(asked: str, solution: Any) -> Integrator:
    if not isinstance(solution, Solution):
        raise BeamdaeError(f"{asked}: solution must be that of a run, got {short_repr(solution)}.")
    if not isinstance(solution.made_by, Integrator):
        raise BeamdaeError(
            f"{asked}: made_by of the solution must be the integrator of its run, "
            f"got {short_repr(solution.made_by)}."
        )
    return require_integrator(asked, solution.made_by)


def _again(
    solution: Solution, integrator: Integrator, progress: Progress | None
) -> Solution | None:
    """Another run over what this one reached; None if it does not end.

    An interrupt ends both: there is nothing to tell.
    """
    if len(solution.t) < 2:
        return None
    other = integrator.integrate(solution.equations, solution.t, progress)
    if other.status.kind == "interrupted":
        raise KeyboardInterrupt
    return other if other.status.success else None


def _difference(solution: Solution, other: Solution | None, fraction: float) -> ErrorColumns:
    """Half the range of each column, and this fraction of the largest difference over it."""
    if other is not None and other.t[-1] < solution.t[-1]:
        # An event ended it a little earlier.
        common = solution.t[solution.t <= other.t[-1]]
        solution, other = replace(solution, t=common), replace(other, t=common)
    rows = _rows(solution)
    rows = np.where(np.isfinite(rows).all(axis=0), rows, np.nan)
    amplitude = 0.5 * np.ptp(rows, axis=0)
    error = np.full(len(amplitude), np.nan)
    if other is not None:
        most = np.max(np.abs(rows - _rows(other)), axis=0)
        at_rest = amplitude <= _rest(solution, amplitude, np.max(np.abs(rows), axis=0))
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.where(at_rest, 0.0, fraction * most / amplitude)
    return {HALF_RANGE: amplitude, RELATIVE_ERROR: error}


def _rows(solution: Solution) -> Array:
    """The observed columns, side by side."""
    columns = solution.columns.values()
    return np.stack(list(columns), axis=1) if columns else np.zeros((len(solution.t), 0))


def _rest(solution: Solution, amplitude: Array, largest: Array) -> Array:
    """What columns with these amplitudes and largest values move by at rest."""
    kinds = [Header.of(name).kind for name in solution.columns]
    beside = dict.fromkeys(kinds, 0.0)
    for kind, moved in zip(kinds, np.nan_to_num(amplitude, posinf=np.inf).tolist(), strict=True):
        beside[kind] = max(beside[kind], moved)
    return np.maximum(_AT_REST * np.array([beside[kind] for kind in kinds]), _ROUNDING * largest)
