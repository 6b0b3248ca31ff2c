"""Certificate of the accuracy of a run: solution, error budget and settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.read_only import read_only_data
from beamdae.results.displays import load_views
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Largest accuracy that may be required; the ratios of error and difference hold for small errors.
MAX_ACCURACY = 0.1
_SCOPE = "estimated by comparison of runs; without errors of materials, joints and data"


class CertificateStatus:
    """Status and display of a certificate; a base class without fields."""

    accuracy: float
    status: Status

    def __repr__(self) -> str:
        name = type(self).__name__
        return f"<{name} of {self.accuracy:g}: {self.status.kind}, {self.status.sentence}>"

    def _repr_html_(self) -> str:
        return load_views().summarize_certificate_as_html(self)

    @property
    def _reason(self) -> tuple[str, ...]:
        return () if self.status.success else (f"not certified; {self.status.sentence}.",)


def describe_verdicts(errors: Array, accuracy: float, required: Array) -> list[str]:
    """Return "yes" or "no" for each error, in parentheses if its column is not required."""
    words = np.where(errors <= accuracy, "yes", "no").tolist()
    return [
        word if needed else f"({word})"
        for word, needed in zip(words, required.tolist(), strict=True)
    ]


@read_only_data
@dataclass(frozen=True, eq=False)
class ErrorBudget:
    """Estimated errors of the observed columns, relative to half their ranges [-].

    Attributes
    ----------
    columns
        Headers of the observed columns.
    half_range
        Half the range of each column in the unit of the column, (columns,). For columns that are
        constant but for errors, it is the largest magnitude.
    time
        Error of the time integration, (columns,), like all following arrays; NaN if it is not
        assessed.
    mesh
        Error of the meshes of the beams; NaN if it is not assessed.
    theory
        Error of floating frames compared with geometrically exact beams; 0 for exact beams, NaN if
        it is not assessed.
    theory_as_written
        Error of the formulations that the model specifies, which the solution may replace; NaN if
        it is not assessed.
    required
        True for columns that must be within the accuracy.
    """

    columns: tuple[str, ...]
    half_range: Array
    time: Array
    mesh: Array
    theory: Array
    theory_as_written: Array
    required: Array

    @property
    def total(self) -> Array:
        """Sum of the time error and the assessed mesh and theory errors, (columns,)."""
        assessed = np.nan_to_num(self.mesh) + np.nan_to_num(self.theory)
        return np.asarray(self.time + assessed)


class CertificateRun(NamedTuple):
    """One of the runs from which a certificate is derived.

    Attributes
    ----------
    formulation
        "exact", or "as written" for the formulations of the model.
    rtol
        Relative tolerance.
    elements
        Total number of elements of all beams.
    steps
        Number of steps.
    processor_time
        Processor time [s], including the assembly if the run needs new equations.
    """

    formulation: str
    rtol: float
    elements: int
    steps: int
    processor_time: float


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class Certificate(CertificateStatus):
    """Solution with an error budget; see `certify`.

    The budget is an estimate from the differences of several runs, not a proof. It refers to the
    model: planar Reissner beams with the given materials, joints and data.

    Attributes
    ----------
    solution
        Solution on the finest mesh, with the tightest tolerance used on this mesh.
    error_budget
        Estimated errors of the observed columns; `budget` returns them as a table.
    accuracy
        Required accuracy relative to half the range of a column [-].
    status
        "ok" if all required columns are certified, otherwise "limited", "failed" or "interrupted",
        with the reason.
    good_until
        Time [s] up to which all required columns are within the accuracy; the start time if the
        errors are not assessed.
    growth_rate
        Exponential growth rate of the error [1/s]; its inverse is the Lyapunov time. NaN if the
        accuracy is reached or no exponential growth is found.
    event_shift
        Largest difference [s] between the times of matching events in the last two runs that were
        compared, or 0 if events were not matched. Errors of columns that jump at events are
        measured at matching events.
    formulations, elements
        Formulation and number of elements of each beam in the solution, by name.
    runs
        The runs in chronological order, except that the run of the solution is the last one.
    notes
        Limits of the certificate, such as beams whose formulation could not be compared.
    """

    solution: Solution
    error_budget: ErrorBudget
    accuracy: float
    status: Status
    good_until: float
    growth_rate: float = np.nan
    event_shift: float = 0.0
    formulations: dict[str, str] = field(default_factory=dict)
    elements: dict[str, int] = field(default_factory=dict)
    runs: tuple[CertificateRun, ...] = ()
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str | Sequence[str]) -> pd.Series | pd.DataFrame:
        """Return columns of `solution` over time by name, see `Solution.__getitem__`."""
        return self.solution[name]

    def __contains__(self, name: object) -> bool:
        """Return True if `certificate[name]` selects columns."""
        return name in self.solution

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reason if the accuracy is not reached, and warnings of the run."""
        return (*self._reason, *self.solution.warnings)

    @property
    def cost(self) -> float:
        """Processor time of all runs / processor time of the last run [-]."""
        last = max(self.runs[-1].processor_time, np.finfo(float).tiny)
        return sum(run.processor_time for run in self.runs) / last

    @property
    def budget(self) -> pd.DataFrame:
        """Table with one row per observed column; errors are relative to half the range.

        The columns are half the range (in the unit of the column), the errors of time integration,
        mesh and theory, their total, the accuracy, "certified" ("yes" or "no", in parentheses if
        the certificate does not require the column), and the theory error of the formulations that
        the model specifies.
        """
        import pandas as pd

        rows = self.budget_columns()
        return pd.DataFrame(rows, index=pd.Index(list(self.error_budget.columns)))

    def budget_columns(self) -> dict[str, Any]:
        """Return the columns of `budget` as arrays and lists, by header."""
        errors = self.error_budget
        total = errors.total
        return {
            "half the range": errors.half_range,
            "time": errors.time,
            "mesh": errors.mesh,
            "theory": errors.theory,
            "total": total,
            "accuracy": np.full(len(total), self.accuracy),
            "certified": describe_verdicts(total, self.accuracy, errors.required),
            "theory as written": errors.theory_as_written,
        }

    def facts(self) -> dict[str, str]:
        """Return accuracy, status, settings, cost, scope and any notes as strings by name."""
        beams = [
            f"{name} {self.formulations[name]} with {count} elements"
            for name, count in self.elements.items()
        ]
        rows = {
            "accuracy": f"{self.accuracy:g} of half the range of a column",
            "certificate": f"{self.status.kind}: {self.status.sentence}",
            "settings": "; ".join([self.solution.label, *beams]),
            "cost": f"{len(self.runs)} runs, {self.cost:.2g} times the time of the last run",
            "scope": _SCOPE,
        }
        if self.event_shift > 0.0:
            rows["events"] = f"matched; they differ by up to {self.event_shift:.2g} s between runs"
        if self.notes:
            rows["notes"] = " ".join(self.notes)
        return rows

    def settings(self) -> dict[str, Any]:
        """Return accuracy, status, settings, runs and cost as a JSON-compatible dictionary."""
        return {
            "accuracy": self.accuracy,
            "status": self.status.kind,
            "reason": self.status.sentence,
            "good until [s]": self.good_until,
            "growth rate [1/s]": None if np.isnan(self.growth_rate) else self.growth_rate,
            "integrator": self.solution.label,
            "elements": dict(self.elements),
            "formulations": dict(self.formulations),
            "runs": [run._asdict() for run in self.runs],
            "cost in final runs": self.cost,
            "notes": list(self.notes),
        }
