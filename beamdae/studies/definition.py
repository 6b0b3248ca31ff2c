"""A study: a function that lists cases, and what is common to them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from beamdae.errors import BeamdaeError, count, positive
from beamdae.integrators import GeneralizedAlpha, Integrator, Radau
from beamdae.studies.case import Case
from beamdae.studies.work import Limits, Task

# Two methods of different kind; what they agree on is what both mean.
REFERENCES = (Radau(rtol=1e-7), GeneralizedAlpha(step=1e-4, newton_tolerance=1e-9))
_ROWS = 400


@dataclass(frozen=True)
class Study:
    """Cases and how they are run and measured; made by `bd.study`.

    Attributes
    ----------
    name
        Name of the folder of its results.
    cases
        What to run.
    references
        Two integrators of different kind. The first gives the reference of each group of cases
        that differ in their integrator alone; how far the second is from it is its uncertainty.
        One that goes by its step is run with half of it as well and extrapolated (Richardson).
    columns
        Observed columns errors are taken over; default: positions and angles that move.
    t_end, output_step
        Of all cases [s]; default the model's end time and a 400th of it.
    limits
        Time, memory and patience of a case.
    repetitions
        Runs of a case; its wall time is their median.
    over
        For a study of meshes: the parameter that is refined, such as "elements". Cases that
        differ in it alone are measured against the largest value with the same integrator; errors
        in space and in time are never mixed.
    """

    name: str
    cases: tuple[Case, ...]
    references: tuple[Integrator, Integrator] = REFERENCES
    columns: tuple[str, ...] = ()
    t_end: float | None = None
    output_step: float | None = None
    limits: Limits = field(default_factory=lambda: Limits(time=120.0))
    repetitions: int = 1
    over: str | None = None

    def __post_init__(self) -> None:
        if not self.cases or not all(isinstance(case, Case) for case in self.cases):
            raise BeamdaeError(f"{self.name}: a study lists at least one Case.")
        count(self.name, "repetitions", self.repetitions)
        for setting in ("t_end", "output_step"):
            if getattr(self, setting) is not None:
                positive(self.name, setting, getattr(self, setting))
        methods = [integrator.method for integrator in self.references]
        if len(methods) != 2 or methods[0] == methods[1]:
            raise BeamdaeError(
                f"{self.name}: references must be two integrators of different kind, "
                f"got {', '.join(methods)}."
            )
        self._check_cases()

    def _check_cases(self) -> None:
        builds: dict[str, Any] = {}
        for case in self.cases:
            case.model.complete(dict(case.parameters))
            if self.over is not None:
                if self.over not in case.parameters:
                    raise BeamdaeError(
                        f"{self.name}: every case of a study over {self.over!r} has to give it a "
                        "value."
                    )
                positive(self.name, self.over, case.parameters[self.over])
            plain = replace(case, parameters={}).mechanism()
            if builds.setdefault(case.model.name, plain) != plain:
                raise BeamdaeError(
                    f"{self.name}: two different models are called {case.model.name!r}, "
                    "give one of them another name."
                )

    def tag(self, case: Case) -> str:
        """What tells a case from the others of its group."""
        return case.label if self.over is None else f"{self.over}={case.parameters[self.over]}"

    def task(self, case: Case, reference: bool = False) -> Task:
        """A case as a task; references take as long as they need, ten times a case's limit."""
        t_end = case.model.t_end if self.t_end is None else self.t_end
        output_step = t_end / _ROWS if self.output_step is None else self.output_step
        limits = self.limits
        if reference and limits.time is not None:
            limits = Limits(10.0 * limits.time, limits.memory, limits.patience)
        return Task(
            case.fingerprint(t_end, output_step),
            case,
            t_end,
            output_step,
            limits,
            1 if reference else self.repetitions,
            animated=reference,
        )


def study(
    *,
    references: tuple[Integrator, Integrator] = REFERENCES,
    columns: Iterable[str] = (),
    t_end: float | None = None,
    output_step: float | None = None,
    time_limit: float | None = 120.0,
    memory_limit: float | None = None,
    patience: float | None = None,
    repetitions: int = 1,
    over: str | None = None,
) -> Callable[[Callable[[], Iterable[Case]]], Study]:
    """Decorate a function without arguments that lists cases; see `Study`.

    Parameters
    ----------
    time_limit
        Wall time a case may take [s]; None: no limit.
    memory_limit
        Memory its process may take [GB].
    patience
        Wall time without progress [s] after which it is given up.
    """
    for name, value in (
        ("time_limit", time_limit),
        ("memory_limit", memory_limit),
        ("patience", patience),
    ):
        if value is not None:
            positive("study", name, value)

    def decorate(function: Callable[[], Iterable[Case]]) -> Study:
        return Study(
            function.__name__,
            tuple(function()),
            references,
            tuple(columns),
            t_end,
            output_step,
            Limits(time_limit, memory_limit, patience),
            repetitions,
            over,
        )

    return decorate
