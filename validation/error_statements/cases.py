"""Cases: runs that are too coarse in one respect, and accurate ones, with their references.

`cases.csv` lists them. Seeds from 300 on were drawn after errors were measured in the present way.
"""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pandas as pd
from error_statements.mechanisms import EXACT

import beamdae as bd

FOLDER = Path(__file__).parent
CASES, REFERENCES = FOLDER / "cases.csv", FOLDER / "results" / "references.npz"
ROWS = 1000  # rows of a run, and of all references
STRIDE = 10  # every tenth row of a reference is stored
REFINEMENT, SHARPNESS, RTOL = 4, 30.0, 1e-7
# A second reference shows the uncertainty of the first; its friction is sharper, because errors by
# the friction speed decrease in proportion.
CHECK = (2, 90.0, 1e-6)


@dataclass(frozen=True)
class ErrorCase:
    """A run whose stated errors are compared with true ones.

    Attributes
    ----------
    name
        Name, with the respect in which the run is coarse after a colon, or "accurate".
    model
        Model; its parameters `elements`, `formulation` and `friction_speed` are refined.
    settings
        Parameters of the run.
    integrator
        Integrator of the run.
    rows
        Number of intervals between output rows, a divisor of `ROWS`.
    """

    name: str
    model: bd.results.Model
    settings: dict[str, Any]
    integrator: bd.Integrator
    rows: int

    @property
    def kind(self) -> str:
        """What is too coarse, or "accurate"."""
        return self.name.partition(": ")[2].partition(",")[0]

    def run(self) -> bd.results.Solution:
        """Return the run, whose checks are evaluated when its warnings are read."""
        return self._simulate(self.settings, self.integrator, self.rows)

    def refine(self, factor: int, sharpness: float, rtol: float) -> pd.DataFrame:
        """Return all rows of a refined run; a run that does not end raises RuntimeError."""
        settings, known = dict(self.settings), self.model.parameters
        if "elements" in known:
            settings["elements"] = factor * max(settings.get("elements", known["elements"]), 2)
        if "formulation" in known:
            settings["formulation"] = EXACT
        if "friction_speed" in known:
            speed = settings.get("friction_speed", known["friction_speed"])
            settings["friction_speed"] = speed / sharpness
        method = bd.Radau(rtol, time_limit=240.0)
        solution = self._simulate(settings, method, ROWS)
        if not solution.status.success:
            raise RuntimeError(f"{self.name}: {solution.status.sentence}")
        return solution.observed

    def _simulate(
        self, settings: dict[str, Any], method: bd.Integrator, rows: int
    ) -> bd.results.Solution:
        t_end = self.model.t_end
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bd.BeamdaeWarning)
            mechanism = self.model(**settings)
            return bd.simulate(mechanism, method, t_end=t_end, output_step=t_end / rows)

    @cached_property
    def reference(self) -> StoredReference:
        """The stored reference."""
        with np.load(REFERENCES) as file:
            return StoredReference(*(file[f"{self.name}/{key}"] for key in StoredReference.KEYS))


@dataclass(frozen=True)
class StoredReference:
    """Thinned rows of a reference, (rows, columns), its extremes, (2, columns), and uncertainty."""

    columns: np.ndarray
    rows: np.ndarray
    extremes: np.ndarray
    uncertainty: np.ndarray

    KEYS = ("columns", "rows", "extremes", "uncertainty")


def compare_rows(observed: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """Return root mean square, largest and peak errors of the columns [-], see `measure_errors`."""
    difference = (observed - exact).abs()
    ends = [(getattr(observed, x)() - getattr(exact, x)()).abs() for x in ("max", "min")]
    half_range = 0.5 * (exact.max() - exact.min())
    return pd.DataFrame(
        {
            "rms": np.sqrt((difference**2).mean()) / exact.std(ddof=0),
            "largest": difference.max() / half_range,
            "peak": np.maximum(*ends) / half_range,
        }
    )


def measure_errors(observed: pd.DataFrame, reference: StoredReference) -> pd.DataFrame:
    """Return root mean square, largest and peak errors of the columns [-].

    All are relative: "rms" to the root mean square of the deviations from the mean, "largest" and
    "peak", the larger error of both extremes, to half the range.
    """
    count = len(observed) - 1
    step = max(count * STRIDE // ROWS, 1)
    rows = observed[list(reference.columns)].to_numpy()
    exact = reference.rows[:: max(ROWS // STRIDE // count, 1)]
    difference = rows[::step] - exact
    half_range = 0.5 * np.ptp(reference.extremes, axis=0)
    extremes = np.stack([rows.min(axis=0), rows.max(axis=0)])
    with np.errstate(divide="ignore", invalid="ignore"):
        table = pd.DataFrame(
            {
                "rms": np.sqrt(np.mean(difference**2, axis=0)) / reference.rows.std(axis=0),
                "largest": np.abs(difference).max(axis=0) / half_range,
                "peak": np.abs(extremes - reference.extremes).max(axis=0) / half_range,
                "uncertainty": reference.uncertainty,
            },
            index=pd.Index(reference.columns, name="column"),
        )
    return table.replace([np.inf, -np.inf], np.nan)


def _read_cases() -> tuple[ErrorCase, ...]:
    table, cases = pd.read_csv(CASES, dtype=str, keep_default_na=False), []
    for row in table.to_dict("records"):
        accuracy = {x: float(row[x]) for x in ("rtol", "step") if row[x]}
        method = getattr(bd, row["integrator"])(**accuracy)
        settings = json.loads(row["settings"] or "{}")
        model = resolve_name(row["model"])
        cases.append(ErrorCase(row["case"], model, settings, method, int(row["rows"])))
    return tuple(cases)


ALL = _read_cases()
