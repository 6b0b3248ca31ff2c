"""A study: a function that lists cases, and what is common to them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from beamdae.errors import (
    BeamdaeError,
    require_choice,
    require_count,
    require_iterable,
    require_positive,
    set_fields,
    short_repr,
)
from beamdae.integrators import Integrator
from beamdae.integrators.integrator import require_integrator
from beamdae.model_functions import Model, require_file_name
from beamdae.studies.case import Case, DigestCache
from beamdae.studies.deviations import require_column_names
from beamdae.studies.execution.case_run import Limits, Task, describe_exception

_DEFAULT_OUTPUT_ROWS = 400
_MAX_REPETITIONS = 1000
_MAX_CASES = 1_000_000


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
        Two integrators of different kind; default: `Radau(1e-7)` and `GeneralizedAlpha(1e-4)`. The
        first gives the reference of each group of cases that differ in their integrator alone; how
        far the second is from it is its uncertainty. One that goes by its step is run with half of
        it as well and extrapolated (Richardson). (): as `errors=False`.
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
    errors
        Whether errors are asked for: of all cases, or of none, which need no references then.
        Default: where `references`, `columns` or `over` are given, and of cases that have
        another one to be compared with: the same model and parameters, another integrator.
    """

    name: str
    cases: tuple[Case, ...]
    references: tuple[Integrator, ...] | None = None
    columns: tuple[str, ...] = ()
    t_end: float | None = None
    output_step: float | None = None
    limits: Limits = field(default_factory=lambda: Limits(time=120.0))
    repetitions: int = 1
    over: str | None = None
    errors: bool | None = None

    def __post_init__(self) -> None:
        require_file_name("study", self.name)
        set_fields(
            self,
            cases=_require_cases(self.name, self.cases),
            references=_require_references(self.name, self.references),
            columns=require_column_names(self.name, self.columns),
            repetitions=require_count(
                self.name, "repetitions", self.repetitions, most=_MAX_REPETITIONS
            ),
            errors=require_choice(self.name, "errors", self.errors, (True, False, None)),
        )
        for setting in ("t_end", "output_step"):
            value = getattr(self, setting)
            if value is not None:
                set_fields(self, **{setting: require_positive(self.name, setting, value)})
        if not isinstance(self.limits, Limits):
            raise BeamdaeError(
                f"{self.name}: limits must be Limits(time=, memory=, patience=), "
                f"got {short_repr(self.limits)}."
            )
        if self.over is not None and not isinstance(self.over, str):
            raise BeamdaeError(
                f"{self.name}: over must be the name of a parameter, got {short_repr(self.over)}."
            )
        if self.errors and self.references == () and self.over is None:
            raise BeamdaeError(f"{self.name}: references must be two integrators for errors=True.")
        self._check_cases()

    def _check_cases(self) -> None:
        models: dict[str, Model] = {}
        digests: DigestCache = {}
        for case in self.cases:
            if self.over is not None:
                if self.over not in case.parameters:
                    raise BeamdaeError(
                        f"{self.name}: every case of a study over {short_repr(self.over)} has to give "
                        "it a value."
                    )
                require_positive(self.name, self.over, case.parameters[self.over])
            case.mechanism_fingerprint(digests)
            if models.setdefault(case.model.name, case.model) is case.model:
                continue
            one, other = (
                Case(x).mechanism_fingerprint(digests) for x in (models[case.model.name], case.model)
            )
            if one != other:
                raise BeamdaeError(
                    f"{self.name}: two different models are called {case.model.name!r}, "
                    "give one of them another name."
                )

    def measures(self, runs: int) -> bool:
        """Whether errors are asked for in a group of so many different runs."""
        if self.errors is not None:
            return self.errors
        if self.over is None and self.references == ():
            return False
        return bool(self.over or self.references or self.columns) or runs > 1

    def tag(self, case: Case) -> str:
        """What tells a case from the others that are measured against the same reference."""
        return case.label if self.over is None else f"{self.over}={case.parameters[self.over]}"

    def task(self, case: Case, reference: bool = False, digests: DigestCache | None = None) -> Task:
        """A case as a task; references take as long as they need, ten times a case's limit.

        Hashes in `digests` are taken as they are, see `Case.mechanism_fingerprint`.
        """
        t_end = case.model.t_end if self.t_end is None else self.t_end
        output_step = t_end / _DEFAULT_OUTPUT_ROWS if self.output_step is None else self.output_step
        limits = self.limits
        digests = {} if digests is None else digests
        if reference and limits.time is not None:
            limits = Limits(10.0 * limits.time, limits.memory, limits.patience)
        return Task(
            case.fingerprint(t_end, output_step, digests),
            case,
            t_end,
            output_step,
            limits,
            1 if reference else self.repetitions,
            animated=reference,
            mechanism_fingerprint=case.mechanism_fingerprint(digests),
        )


def _require_cases(name: str, value: Any) -> tuple[Case, ...]:
    cases = _require_entries(name, "cases", value, "a list of at least one Case", _MAX_CASES)
    if not cases:
        raise BeamdaeError(f"{name}: a study lists at least one Case, got {short_repr(value)}.")
    wrong = [case for case in cases if not isinstance(case, Case)]
    if wrong:
        raise BeamdaeError(
            f"{name}: a study lists at least one Case, got {short_repr(wrong[0])} in it."
        )
    if len(cases) > _MAX_CASES:
        raise BeamdaeError(f"{name}: a study lists at most {_MAX_CASES} cases, got more.")
    return cases


def _require_references(name: str, value: Any) -> tuple[Integrator, ...] | None:
    if value is None:
        return None
    wanted = "two integrators of different kind, or () for cases that are not measured"
    found = _require_entries(name, "references", value, wanted, 2)
    if found == () and isinstance(value, (tuple, list)):
        return ()
    allowed = f"{name}: references must be {wanted}"
    if not found or not all(isinstance(x, Integrator) for x in found):
        raise BeamdaeError(f"{allowed}, got {short_repr(value)}.")
    methods = [require_integrator(name, x).method for x in found]
    if len(methods) != 2 or methods[0] == methods[1]:
        raise BeamdaeError(f"{allowed}, got {', '.join(methods)}.")
    return found


def _require_entries(name: str, what: str, value: Any, wanted: str, most: int) -> tuple[Any, ...]:
    """The entries of whatever has an order, no more than can be and one."""
    unordered = isinstance(value, (str, bytes, set, frozenset))
    return tuple(require_iterable(name, what, None if unordered else value, wanted, most + 1))


def study(
    *,
    references: tuple[Integrator, ...] | None = None,
    columns: Iterable[str] = (),
    t_end: float | None = None,
    output_step: float | None = None,
    time_limit: float | None = 120.0,
    memory_limit: float | None = None,
    patience: float | None = None,
    repetitions: int = 1,
    over: str | None = None,
    errors: bool | None = None,
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
            require_positive("study", name, value)

    def decorate(function: Callable[[], Iterable[Case]]) -> Study:
        if not callable(function) or not hasattr(function, "__name__"):
            raise BeamdaeError(f"study: it must decorate a function, got {short_repr(function)}.")
        return Study(
            function.__name__,
            call_definition(function, "cases"),
            references,
            columns,  # type: ignore[arg-type]
            t_end,
            output_step,
            Limits(time_limit, memory_limit, patience),
            repetitions,
            over,
            errors,
        )

    return decorate


def call_definition(function: Callable[[], Any], what: str) -> Any:
    """What the function of a study or a sweep lists; its mistakes are told as such."""
    try:
        found = function()
        # A generator is a function still to be run.
        return list(islice(found, _MAX_CASES + 1)) if isinstance(found, Iterator) else found
    except (BeamdaeError, KeyboardInterrupt):
        raise
    except BaseException as problem:  # Whatever a user's function does, sys.exit included.
        raise BeamdaeError(
            f"{function.__name__}: it cannot list its {what}, {describe_exception(problem, 'it')}."
        ) from problem
