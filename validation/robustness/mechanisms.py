"""Random mechanisms: runs with default settings are accurate, or warn, or end with a reason.

Two tight runs with short steps are the references. Mechanisms on which they disagree, because the
motion is chaotic or discontinuous, are reported as skipped.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import beamdae as bd
from beamdae.results.columns import Header
from robustness.random_parts import describe_mechanism, end_time, random_mechanism
from robustness.trial_class import SKIPPED, TrialClass

RTOL = 1e-5  # of all runs: the default of the adaptive integrators
RUN_TIME_LIMIT = 20.0  # s
# A mechanism takes four runs, four error estimates and two references.
MECHANISM_TIME_LIMIT = 600.0  # s
SEED_COUNT = 300
SAMPLE_SIZE = 10
QUICK_SEED_COUNT = 4
MAX_ERROR = 100.0  # over rtol, of positions and angles; the guaranteed bound of undamped models
MAX_ENERGY_IMBALANCE = 0.1  # relative to the energy exchanged
INTEGRATORS: dict[str, Callable[[], bd.Integrator]] = {
    "Auto": lambda: bd.Auto(RTOL, time_limit=RUN_TIME_LIMIT),
    "Ida": lambda: bd.Ida(RTOL, time_limit=RUN_TIME_LIMIT),
    "Radau": lambda: bd.Radau(RTOL, time_limit=RUN_TIME_LIMIT),
    "GeneralizedAlpha": lambda: bd.GeneralizedAlpha(rtol=RTOL, time_limit=RUN_TIME_LIMIT),
}
_REFERENCE_TIME_LIMIT = 30.0  # s
# Steps of the references: they do not pass over short contacts and crossings.
_MIN_REFERENCE_STEPS = 1000
_ROWS = 400  # of a run
_LARGE_ERROR = 0.04  # of columns that runs name
# Parts of warnings that do not concern the errors of the integration.
_OTHER_WARNINGS = (
    "output rows miss",
    "where its value is held",
)
# Largest disagreement of two references relative to half the range.
_MAX_DISAGREEMENT = 0.1 * MAX_ERROR * RTOL
# Columns are at rest if their half range is below this fraction of the largest one with their unit.
_RESTING_SHARE = 1e-6
_MIN_HALF_RANGE = 1e-7  # m or rad; columns with a smaller half range are at rest
# Errors of a run below this multiple of rtol are not counted in the coverage of estimates.
_MIN_COUNTED_ERROR = 0.01
_MAX_EXCEPTION_LENGTH = 200  # characters


@dataclass(frozen=True)
class MechanismRow:
    """Row of the table of mechanisms: one mechanism and integrator.

    Attributes
    ----------
    trial, mechanism, integrator
        Seed, base and additions, and integrator.
    ended, reason
        Kind of the status and its sentence; "skipped: ..." without a reference.
    error, column
        Largest error of the positions and angles over rtol, and its column.
    warnings
        Warnings of the run about errors of its integration.
    columns, covered, miss
        Number of columns with an error estimate, number of those whose error it covers, and largest
        error over estimate.
    imbalance, wall
        Energy imbalance, and wall time of the run [s].
    complaint
        Reason why the run is not accepted.
    """

    trial: str
    mechanism: str
    integrator: str
    ended: str
    reason: str = ""
    error: float = np.nan
    column: str = ""
    warnings: str = ""
    columns: int = 0
    covered: int = 0
    miss: float = np.nan
    imbalance: float = np.nan
    wall: float = np.nan
    complaint: str = ""


def try_seed(name: str) -> list[MechanismRow]:
    """Run the random mechanism of a seed by all integrators and return its rows."""
    seed = int(name)
    base, additions = describe_mechanism(seed)
    mechanism = " + ".join([base, *additions])
    results = {method: _run(seed, integrator()) for method, integrator in INTEGRATORS.items()}
    reference, disagreement = _compute_reference(seed)
    rows = []
    for method, result in results.items():
        row = MechanismRow(name, mechanism, method, "raised", str(result))
        if isinstance(result, str):
            rows.append(replace(row, complaint="it raised"))
            continue
        row = replace(
            row,
            ended=result.status.kind,
            reason=result.status.sentence,
            warnings=describe_warnings(result),
            imbalance=result.quality.energy_imbalance,
            wall=result.statistics.wall_time,
        )
        if result.status.success and reference is not None:
            row = replace(row, **measure_errors(result, reference, disagreement))
        row = replace(row, complaint=find_run_complaint(row))
        if result.status.success and not row.complaint and reference is None:
            row = replace(row, ended=f"{SKIPPED}: references differ by {disagreement:.2g}")
        rows.append(row)
    return rows


def _run(seed: int, integrator: bd.Integrator) -> bd.results.Solution | str:
    t_end = end_time(seed)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bd.BeamdaeWarning)
            return bd.simulate(
                random_mechanism(seed=seed), integrator, t_end=t_end, output_step=t_end / _ROWS
            )
    except Exception as error:  # Any exception is a wrong outcome, which the row reports.
        return f"{type(error).__name__}: {error}"[:_MAX_EXCEPTION_LENGTH]


def _compute_reference(seed: int) -> tuple[bd.results.Solution | None, float]:
    """Return a reference and its disagreement with another one; None if they differ too much."""
    limits: dict[str, Any] = {
        "max_step": end_time(seed) / _MIN_REFERENCE_STEPS,
        "time_limit": _REFERENCE_TIME_LIMIT,
    }
    first = _run(seed, bd.Radau(1e-8, **limits))
    if isinstance(first, str) or not first.status.success:
        return None, np.inf
    smallest = np.inf
    for other in (bd.Ida(1e-8, **limits), bd.Radau(1e-10, **limits)):
        second = _run(seed, other)
        if isinstance(second, str) or not second.status.success:
            continue
        smallest = min(smallest, max(compare_columns(second, first).values(), default=0.0))
        if smallest <= _MAX_DISAGREEMENT:
            return first, smallest
    return None, smallest


def describe_warnings(solution: bd.results.Solution) -> str:
    """Return the warnings of a run that concern the errors of its integration.

    Warnings about output rows and the validity of laws do not, and neither do errors by elements
    and strains.
    """
    sentences = [
        warning
        for warning in solution.model_warnings
        if not any(x in warning for x in _OTHER_WARNINGS)
    ]
    if np.nanmax(solution.errors.table()["time"], initial=0.0) > _LARGE_ERROR:
        sentences += solution.errors.sentences()
    return " ".join(sentences)


def compare_columns(
    solution: bd.results.Solution, reference: bd.results.Solution
) -> dict[str, float]:
    """Return the largest error of each moving position and angle relative to half its range."""
    return {
        header: error
        for header, error in _compare_all(solution, reference).items()
        if Header.of(header).unit in ("m", "rad")
    }


def _compare_all(solution: bd.results.Solution, reference: bd.results.Solution) -> dict[str, float]:
    rows = min(len(solution.t), len(reference.t))
    exact = {header: np.asarray(x)[:rows] for header, x in reference.columns.items()}
    half_range = {header: 0.5 * float(np.ptp(x)) for header, x in exact.items()}
    largest: dict[str, float] = {}
    for header, x in half_range.items():
        unit = Header.of(header).unit
        largest[unit] = max(largest.get(unit, 0.0), x)
    return {
        header: float(np.max(np.abs(np.asarray(solution.columns[header])[:rows] - exact[header])))
        / half
        for header, half in half_range.items()
        if half > max(_RESTING_SHARE * largest[Header.of(header).unit], _MIN_HALF_RANGE)
    }


def measure_errors(
    solution: bd.results.Solution, reference: bd.results.Solution, disagreement: float
) -> dict[str, Any]:
    """Return the fields of a row that compare a run and its error estimate with a reference."""
    errors = compare_columns(solution, reference)
    column = max(errors, key=lambda header: errors[header], default="")
    estimates = solution.errors.table()["time"]
    floor = max(_MIN_COUNTED_ERROR * RTOL, 3.0 * disagreement)
    counted = {header: error for header, error in errors.items() if error > floor}
    ratios = [error / max(float(estimates[header]), 1e-300) for header, error in counted.items()]
    return {
        "error": errors.get(column, 0.0) / RTOL,
        "column": column,
        "columns": len(ratios),
        "covered": sum(ratio <= 1.0 for ratio in ratios),
        "miss": max(ratios, default=0.0),
    }


def find_run_complaint(row: MechanismRow) -> str:
    """Return the reason why a run is not accepted, or an empty text."""
    if row.ended != "ok":
        is_right = row.ended in ("failed", "limited") and row.reason
        return "" if is_right else f"it ended {row.ended}, {row.reason!r}"
    if row.warnings:
        return ""
    if not row.imbalance < MAX_ENERGY_IMBALANCE:
        return f"energies do not close, by {row.imbalance:.2g}, without a warning"
    if row.error > MAX_ERROR:
        return f"{row.column} is {row.error:.3g} rtol off without a warning"
    return ""


TRIALS = TrialClass(
    "mechanisms",
    collect=lambda: [str(seed) for seed in range(SEED_COUNT)],
    attempt=try_seed,
    time_limit=MECHANISM_TIME_LIMIT,
    quick_size=QUICK_SEED_COUNT,
)
