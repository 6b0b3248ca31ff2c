"""A sweep: one model over values of its parameters, and what is told of each run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae.errors import BeamdaeError, set_fields, short_repr
from beamdae.integrators import Auto, Integrator
from beamdae.integrators.integrator import require_integrator
from beamdae.model_functions import Model
from beamdae.results.solution import Solution
from beamdae.studies.case import Case, DigestCache, cached_digest
from beamdae.studies.definition import Study
from beamdae.studies.deviations import require_column_names
from beamdae.studies.execution.case_run import Limits, Task
from beamdae.studies.store.fingerprints import FingerprintError, digest
from beamdae.studies.sweeps.parameter_values import combinations_of

if TYPE_CHECKING:
    from beamdae.studies.execution.study_progress import StudyProgress
    from beamdae.studies.sweeps.results import SweepResults

Output = Callable[[Solution], Any]

# Columns of the table that are there whatever is swept.
TAKEN = ("status", "reason", "wall time [s]", "trajectory", "warnings")


@dataclass(frozen=True)
class Sweep(Study):
    """Runs of one model over values of its parameters; made by `bd.sweep` as a decorator.

    It is a study without references. Called, it runs here and now, see `run`;
    `beamdae sweep FILE.py` runs it from the command line.

    Attributes
    ----------
    columns
        Observed columns that are told of; default all.
    outputs
        What else is told of each run: functions of a `Solution`, by name.
    settings
        The parameters of each case as they are told: numbers, texts, or names of other values.
    """

    references: tuple[Integrator, ...] | None = ()
    outputs: Mapping[str, Output] = field(default_factory=dict)
    settings: tuple[Mapping[str, Any], ...] = ()

    def __post_init__(self) -> None:
        set_fields(self, outputs=_outputs(self.name, self.outputs, self.parameters))
        super().__post_init__()

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that are given."""
        return list(dict.fromkeys(name for told in self.settings for name in told))

    @cached_property
    def varied(self) -> list[str]:
        """Names of the parameters that have several values."""
        names = self.parameters
        return [x for x in names if len({repr(told[x]) for told in self.settings}) > 1]

    @cached_property
    def _told(self) -> dict[int, Mapping[str, Any]]:
        return {id(c): told for c, told in zip(self.cases, self.settings, strict=True)}

    def tag(self, case: Case) -> str:
        """What tells a case from the others: its parameters that vary."""
        told = self._told[id(case)]
        return ", ".join(f"{x}={short(told[x])}" for x in self.varied or told) or self.name

    def task(self, case: Case, reference: bool = False, known: DigestCache | None = None) -> Task:
        """A case as a task, which tells the outputs; see `Study.task`."""
        known = {} if known is None else known
        task = super().task(case, reference, known)
        if not self.outputs:
            return task
        key = digest([task.key, cached_digest(known, self.outputs, self._of_outputs)])[:20]
        return replace(task, key=key, outputs=self.outputs)

    def _of_outputs(self) -> str:
        try:
            return digest(dict(self.outputs))
        except FingerprintError as problem:
            raise BeamdaeError(
                f"{self.name}: outputs must be functions another process can tell again, "
                f"{problem.place} is a {problem.kind}."
            ) from None

    def run(
        self,
        folder: str | Path | None = None,
        jobs: int | None = 1,
        scheduler: str | None = None,
        progress: Callable[[StudyProgress], None] | None = None,
    ) -> SweepResults:
        """Run all cases that are not in `folder` yet; see `bd.sweep`."""
        from beamdae.studies.sweeps.results import run_sweep

        return run_sweep(self, folder, jobs, scheduler, progress)

    __call__ = run


def short(value: Any) -> str:
    """What is told of a parameter, in few letters."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def sweep_of(
    model: Model,
    over: Any,
    name: str,
    of: Any = (),
    integrator: Any = None,
    outputs: Any = None,
    time_limit: float | None = None,
    t_end: float | None = None,
    output_step: float | None = None,
) -> Sweep:
    """A sweep that is not run yet; see `sweep`."""
    method = require_integrator("sweep", Auto() if integrator is None else integrator)
    found = combinations_of(name, model, over)
    values = [{key: one.value for key, one in each.items()} for each in found]
    return Sweep(
        name,
        tuple(Case(model, one, method) for one in values),
        columns=require_column_names(name, (of,) if isinstance(of, str) else of),
        limits=Limits(time=time_limit),
        outputs={} if outputs is None else outputs,
        settings=tuple({key: one.told for key, one in each.items()} for each in found),
        t_end=t_end,
        output_step=output_step,
    )


def _outputs(part: str, given: Any, parameters: Iterable[str]) -> dict[str, Output]:
    wanted = "a dict of functions of a solution by name"
    if not isinstance(given, Mapping):
        raise BeamdaeError(f"{part}: outputs must be {wanted}, got {short_repr(given)}.")
    taken = {*TAKEN, *parameters}
    for name, function in given.items():
        if not isinstance(name, str) or not name.isprintable() or not name.strip():
            raise BeamdaeError(
                f"{part}: outputs must be {wanted}, got the name {short_repr(name)}."
            )
        if name in taken:
            raise BeamdaeError(f"{part}: {name!r} is a column of its own, name the output another.")
        if not callable(function):
            raise BeamdaeError(f"{part}: outputs must be {wanted}, got {short_repr(function)}.")
    return dict(given)
