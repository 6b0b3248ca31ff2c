"""One run of a model, and how far two runs are from each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

import beamdae as bd

# Half the paper's step, and Newton's iteration converged to rounding: the rows are the same on
# every machine.
SCHEME = bd.GeneralizedAlpha(step=5e-4, newton_tolerance=1e-11)
PAPER_SCHEME = bd.GeneralizedAlpha(step=1e-3, newton_tolerance=1e-11)
WITNESS = bd.Ida(rtol=1e-6)


def solved(mechanism: bd.Mechanism, t_end: float, rows: float, integrator: Any) -> bd.Solution:
    """A run that reached its end."""
    solution = bd.simulate(mechanism, integrator, t_end=t_end, output_step=rows)
    if not solution.status.success:
        raise RuntimeError(f"{integrator.label}: {solution.status.sentence}")
    return solution


def observed(
    mechanism: bd.Mechanism, t_end: float, rows: float, integrator: Any = SCHEME
) -> pd.DataFrame:
    """Observed columns of a run over time, every `rows` seconds."""
    return _over_time(solved(mechanism, t_end, rows, integrator))


def observed_until_failure(
    mechanism: bd.Mechanism, t_end: float, rows: float, integrator: Any = SCHEME
) -> pd.DataFrame:
    """The same as far as the run got."""
    return _over_time(bd.simulate(mechanism, integrator, t_end=t_end, output_step=rows))


def _over_time(solution: bd.Solution) -> pd.DataFrame:
    return solution.observed.set_index(pd.Index(solution.t, name="t [s]"))


def deviation(run: Any, reference: Any) -> float:
    """Largest difference over half the range of the reference, the largest over the columns."""
    run, reference = np.asarray(run, float), np.asarray(reference, float)
    return float(np.max(np.abs(run - reference)) / (0.5 * np.max(np.ptp(reference, axis=0))))


def second_method(pairs: dict[str, tuple[pd.Series, pd.Series]]) -> dict[str, pd.DataFrame]:
    """How far generalized-alpha and IDA are apart, by column."""
    lines = [
        {"column": name, "generalized-alpha against IDA [-]": deviation(one, other)}
        for name, (one, other) in pairs.items()
    ]
    return {"second_method": pd.DataFrame(lines)}


def span(values: Any, digits: int = 3) -> str:
    """Smallest and largest value as text."""
    low, high = np.min(values), np.max(values)
    return f"{low:.{digits}g} .. {high:.{digits}g}"
