"""Studies: many runs, one row each, measured against a reference."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from beamdae.deviation import compared_columns, deviation
from beamdae.errors import BeamdaeError
from beamdae.integrators import GeneralizedAlpha, Ida
from beamdae.model import Model
from beamdae.simulation import simulate
from beamdae.solution import Solution

Progress = Callable[[str, float], None]

# Two methods that differ by more than this share of a column's amplitude make no reference.
_DISAGREEMENT = 1e-2
_REFERENCE_TIME_LIMIT = 120.0
_REFERENCE = GeneralizedAlpha(step=2.5e-4, newton_tolerance=1e-9, time_limit=_REFERENCE_TIME_LIMIT)
_WITNESS = Ida(rtol=1e-7, time_limit=_REFERENCE_TIME_LIMIT)


@dataclass(frozen=True)
class Case:
    """One run of a study.

    Parameters
    ----------
    model
        A model function.
    parameters
        Values in place of its defaults.
    integrator
        Ida(...) or GeneralizedAlpha(...).
    """

    model: Model
    parameters: Mapping[str, Any] = field(default_factory=dict)
    integrator: Any = field(default_factory=Ida)

    @property
    def label(self) -> str:
        """The integrator's label with whatever else differs from its defaults."""
        label = self.integrator.label
        settings = {f.name: getattr(self.integrator, f.name) for f in fields(self.integrator)}
        defaults = {f.name: f.default for f in fields(self.integrator)}
        more = [
            f"{name}={value}"
            for name, value in settings.items()
            if value != defaults[name] and f"{name}=" not in label
        ]
        return ", ".join([label.removesuffix(")"), *more]) + ")" if more else label

    def solve(
        self, t_end: float | None = None, output_step: float | None = None, progress: Any = None
    ) -> Solution:
        """Run it; see `simulate`."""
        model = replace(self.model, parameters=self.model.complete(dict(self.parameters)))
        return simulate(model, self.integrator, t_end, output_step, progress)


@dataclass(frozen=True)
class Reference:
    """A solution to measure others against, and how well it is known.

    Attributes
    ----------
    uncertainty
        Difference to the solution by another method, in the measure of `deviation`; NaN if there
        is none.
    """

    solution: Solution
    uncertainty: float = np.nan


@dataclass(frozen=True)
class Comparison:
    """What became of the cases of a study.

    Attributes
    ----------
    table
        One row a case.
    solutions
        One a case, None where the model has no consistent start.
    deviations
        One table a case, None where there is no solution or no reference.
    """

    cases: tuple[Case, ...]
    table: pd.DataFrame
    solutions: tuple[Solution | None, ...]
    deviations: tuple[pd.DataFrame | None, ...]
    reference: Reference | None

    @property
    def finished(self) -> list[tuple[str, Solution, pd.DataFrame | None]]:
        """Label, solution and deviation of the cases that have a solution."""
        rows = zip(self.cases, self.solutions, self.deviations, strict=True)
        return [(case.label, s, d) for case, s, d in rows if s is not None]

    def to_csv(self, folder: Path, name: str) -> list[Path]:
        """Write the table, the reference and one trajectory a case; returns the paths.

        Raises
        ------
        BeamdaeError
            If the folder cannot be written.
        """
        tables = {folder / f"{name}.csv": self.table}
        if self.reference is not None:
            tables[folder / f"{name}_reference.csv"] = trajectory(self.reference.solution)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for path, table in tables.items():
                table.to_csv(path, index=False)
        except OSError as problem:
            raise BeamdaeError(f"{folder}: it cannot be written, {problem.strerror}.") from problem
        written = list(tables)
        for number, (label, solution, _) in enumerate(self.finished, start=1):
            slug = re.sub(r"[^A-Za-z0-9.-]+", "_", label).strip("_")
            written.append(solution.to_csv(folder / f"{name}_{number}_{slug}.csv"))
        return written


def trajectory(solution: Solution) -> pd.DataFrame:
    """Time and the observed columns: `Solution.table` without the cost of its energy ledger."""
    return pd.concat([pd.DataFrame({"t [s]": solution.t}), solution.observed], axis=1)


def default_integrators() -> tuple[Any, ...]:
    """The integrators a model is compared with unless others are named."""
    return (
        Ida(rtol=1e-4),
        Ida(rtol=1e-6),
        GeneralizedAlpha(step=1e-3),
        GeneralizedAlpha(step=5e-4),
    )


def grid(**lists: Iterable[Any]) -> list[dict[str, Any]]:
    """All combinations of parameter values, the last name varying fastest.

    Examples
    --------
    >>> grid(elements=[4, 8], strain=["linear"])
    [{'elements': 4, 'strain': 'linear'}, {'elements': 8, 'strain': 'linear'}]
    """
    for name, values in lists.items():
        if isinstance(values, str) or not isinstance(values, Iterable):
            raise BeamdaeError(f"grid: {name} must be a list of values, got {values!r}.")
    return [dict(zip(lists, values, strict=True)) for values in product(*lists.values())]


def compare(
    cases: Iterable[Case],
    reference: Case | Solution | Reference | None = None,
    columns: Sequence[str] = (),
    t_end: float | None = None,
    output_step: float | None = None,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Run cases and tabulate cost and quality, one row a case; a failed run is a row as well.

    Parameters
    ----------
    cases
        What to run.
    reference
        What errors are measured against: a case to run, a solution, or an `agreed_reference`.
    columns
        Observed columns the error is taken over; default: all positions and angles that move.
    t_end, output_step
        As in `simulate`, for all cases.
    progress
        Called now and then with the label of a case and the time it has reached.

    Returns
    -------
    DataFrame
        "error [-]" is the largest `deviation` over the run (as far as it got) and the columns.

    Raises
    ------
    BeamdaeError
        If the reference fails or a column is unknown.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=0.1)
    ... def swing(mass=2.0):
    ...     mech = bd.Mechanism(gravity=(0.0, -9.81))
    ...     bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    ...     mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    ...     return mech
    >>> cases = [bd.Case(swing, p, bd.Ida(rtol=1e-4)) for p in bd.grid(mass=[1.0, 2.0])]
    >>> list(bd.compare(cases)["mass"])
    [1.0, 2.0]
    """
    return comparison(cases, reference, columns, t_end, output_step, progress).table


def comparison(
    cases: Iterable[Case],
    reference: Case | Solution | Reference | None = None,
    columns: Sequence[str] = (),
    t_end: float | None = None,
    output_step: float | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """The table of `compare` together with the solutions it was made from."""
    cases = tuple(cases) if isinstance(cases, Iterable) else (cases,)
    if not cases or not all(isinstance(case, Case) for case in cases):
        raise BeamdaeError(f"compare: give a list of at least one Case, got {cases!r:.120}.")
    known = _as_reference(reference, t_end, output_step, progress)
    if known is not None:
        compared_columns(known.solution, columns)
    parameters = list(dict.fromkeys(name for case in cases for name in case.parameters))
    rows, solutions, deviations = [], [], []
    interrupted = False
    for case in cases:
        solution, deviant = None, None
        status = "not run, the study was interrupted"
        if not interrupted:
            try:
                solution = case.solve(t_end, output_step, _named(progress, case.label))
                status = "ok" if solution.status.success else solution.status.message
            except BeamdaeError as problem:
                status = str(problem)
        if solution is not None:
            interrupted = solution.status.message.startswith("interrupted")
            if known is not None:
                deviant = deviation(solution, known.solution, columns)
        values = {name: case.parameters.get(name) for name in parameters}
        rows.append(
            {"model": case.model.name, **values, "integrator": case.label, "status": status}
            | _measured(solution, deviant, known)
        )
        solutions.append(solution)
        deviations.append(deviant)
    counts = dict.fromkeys(_COUNTS, "Int64")
    table = pd.DataFrame(rows).astype(counts)
    return Comparison(cases, table, tuple(solutions), tuple(deviations), known)


_COUNTS = {
    "steps": "steps",
    "rejected steps": "rejected_steps",
    "residual calls": "residual_calls",
    "Jacobian calls": "jacobian_calls",
    "factorizations": "factorizations",
    "Newton failures": "newton_failures",
}
_MEASURES = {
    "setup time [s]": "setup_time",
    "wall time [s]": "wall_time",
    "max position drift": "max_position_drift",
    "max velocity drift": "max_velocity_drift",
    "max residual [-]": "max_residual",
    "energy imbalance [-]": "energy_imbalance",
}


def _measured(
    solution: Solution | None, deviant: pd.DataFrame | None, reference: Reference | None
) -> dict[str, Any]:
    summary = {} if solution is None else solution.summary()
    finished = solution is not None and solution.status.success
    moved = solution is not None and solution.statistics.steps > 0
    error = float(deviant.to_numpy().max()) if moved and deviant is not None else np.nan
    row = {"reached [s]": summary.get("last_time", np.nan)}
    row |= {column: summary.get(name) for column, name in _COUNTS.items()}
    row |= {column: summary.get(name, np.nan) for column, name in _MEASURES.items()}
    if reference is not None:
        row |= {
            "error [-]": error,
            "below uncertainty": bool(finished and error <= reference.uncertainty),
        }
    return row


def agreed_reference(
    model: Model,
    parameters: Mapping[str, Any] | None = None,
    columns: Sequence[str] = (),
    t_end: float | None = None,
    output_step: float | None = None,
    progress: Progress | None = None,
) -> Reference:
    """A reference two methods agree on.

    Generalized-alpha at a quarter of its default step, with Ida at rtol 1e-7 as the witness: the
    deviation between them is the uncertainty.

    Raises
    ------
    BeamdaeError
        If one of them fails, or they differ by more than a hundredth.
    """
    solution, witness = (
        _solved(Case(model, parameters or {}, integrator), t_end, output_step, progress)
        for integrator in (_REFERENCE, _WITNESS)
    )
    uncertainty = float(deviation(witness, solution, columns).to_numpy().max())
    if not uncertainty <= _DISAGREEMENT:
        raise BeamdaeError(
            f"{model.name}: the reference failed, {_REFERENCE.label} and {_WITNESS.label} "
            f"differ by {uncertainty:.2g} of the amplitude, "
            f"more than {_DISAGREEMENT:g}."
        )
    return Reference(solution, uncertainty)


def _as_reference(
    reference: Case | Solution | Reference | None,
    t_end: float | None,
    output_step: float | None,
    progress: Progress | None,
) -> Reference | None:
    if isinstance(reference, Case):
        return Reference(_solved(reference, t_end, output_step, progress))
    if isinstance(reference, Solution):
        return Reference(reference)
    if reference is None or isinstance(reference, Reference):
        return reference
    raise BeamdaeError(f"compare: reference must be a Case or a Solution, got {reference!r}.")


def _solved(
    case: Case, t_end: float | None, output_step: float | None, progress: Progress | None
) -> Solution:
    label = case.integrator.label
    solution = case.solve(t_end, output_step, _named(progress, f"reference {label}"))
    if not solution.status.success:
        raise BeamdaeError(
            f"{case.model.name}: the reference failed, {label}: {solution.status.message}."
        )
    return solution


def _named(progress: Progress | None, label: str) -> Callable[[float], None] | None:
    return None if progress is None else partial(progress, label)
