"""Errors over rtol of the adaptive integrators."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pandas as pd

import beamdae as bd
from tolerances.references import SUMMARY
from tolerances.tolerance_case import ToleranceCase

TIME_LIMIT = 10.0  # wall time of a run [s]
INTEGRATORS: dict[str, Callable[[float], bd.Integrator]] = {
    "Ida": lambda rtol: bd.Ida(rtol, time_limit=TIME_LIMIT),
    "Radau": lambda rtol: bd.Radau(rtol, time_limit=TIME_LIMIT),
    "GeneralizedAlpha": lambda rtol: bd.GeneralizedAlpha(rtol=rtol, time_limit=TIME_LIMIT),
    "Auto": lambda rtol: bd.Auto(rtol, time_limit=TIME_LIMIT),
}


@cache
def reference_uncertainties() -> pd.Series:
    """Return the disagreement of the two reference methods by case and column."""
    table = pd.read_csv(SUMMARY)
    compared = table[table["method 1"] != "stored reference"]
    return compared.set_index(["case", "column"])["disagreement"]


def measure_errors(case: ToleranceCase, solution: bd.results.Solution) -> pd.DataFrame:
    """Return error and uncertainty of the guaranteed columns, relative to their amplitudes.

    The uncertainty of the reference includes the rounding of its stored values.
    """
    columns = list(case.columns + case.deflections)
    uncertainty = reference_uncertainties()[case.name][columns] + case.reference_rounding(columns)
    errors = case.errors(solution, columns=columns)
    return pd.DataFrame({"error": errors, "uncertainty": uncertainty}, index=columns)
