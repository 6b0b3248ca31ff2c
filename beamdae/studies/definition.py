"""Definition of a study: cases with common settings, and the decorator `study`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

from beamdae.errors import (
    BeamdaeError,
    plain_text,
    require_count,
    require_positive,
    set_fields,
    short_repr,
)
from beamdae.integrators import Integrator
from beamdae.integrators.integrator import require_integrator
from beamdae.model_functions import Model, require_file_name
from beamdae.read_only import read_only_data
from beamdae.results.columns import require_column_names
from beamdae.studies.case import MAX_CASES, Case, DigestCache, list_entries
from beamdae.studies.tasks import Task, describe_exception

_DEFAULT_OUTPUT_ROWS = 400
_DEFAULT_TIME_LIMIT = 120.0  # seconds
_REFERENCE_TIME_LIMIT_FACTOR = 10.0  # relative to the time limit of a case
_REFERENCE_FRAMES = 120  # of the animation recorded with a reference
_MAX_REPETITIONS = 1000


@read_only_data
@dataclass(frozen=True)
class Study:
    """Cases with common settings; created by the decorator `bd.study`.

    Attributes
    ----------
    name
        Name of the study and of its results folder.
    cases
        Cases to run.
    references
        Two integrators with different methods, or an empty tuple. Defaults to `Radau(rtol=1e-7)`
        and `GeneralizedAlpha(step=1e-4, newton_tolerance=1e-9)`. The first integrator computes the
        reference of each group of cases that differ only in their integrator; the difference
        between the two results is the uncertainty of the reference. An integrator with a fixed step
        is also run with half the step, and the results are extrapolated (Richardson). With an empty
        tuple, no errors are computed. Otherwise, all groups have errors if `references`, `columns`
        or `over` are given, and by default those with several different cases.
    columns
        Observed columns used for the errors. Defaults to all columns in m or rad that vary or, if
        no column has these units, to all columns that vary.
    t_end, output_step
        End time and time between rows of all cases [s]. The defaults are the end time of the model,
        and the end time / 400.
    time_limit
        Maximum wall time of each repetition of a case [s]. Defaults to 120 s; None means no limit.
    repetitions
        Number of runs of each case; the wall time of the case is the median of all runs.
    over
        Parameter that is refined in a mesh study, such as "elements". The reference of each group
        of cases that differ only in this parameter is the case with its largest value, and its
        uncertainty the difference from the second largest; `references` are not run.

    Raises
    ------
    BeamdaeError
        If a setting is invalid, two different models have the same name, or a value cannot be
        reproduced in other processes.
    """

    name: str
    cases: tuple[Case, ...]
    references: tuple[Integrator, ...] | None = None
    columns: tuple[str, ...] = ()
    t_end: float | None = None
    output_step: float | None = None
    time_limit: float | None = _DEFAULT_TIME_LIMIT
    repetitions: int = 1
    over: str | None = None

    def __post_init__(self) -> None:
        set_fields(self, name=require_file_name("study", self.name))
        set_fields(
            self,
            cases=_require_cases(self.name, self.cases),
            references=_require_references(self.name, self.references),
            columns=require_column_names(self.name, self.columns),
            repetitions=require_count(
                self.name, "repetitions", self.repetitions, most=_MAX_REPETITIONS
            ),
            over=plain_text(self.over),
        )
        for setting in ("t_end", "output_step", "time_limit"):
            value = getattr(self, setting)
            if value is not None:
                set_fields(self, **{setting: require_positive(self.name, setting, value)})
        self._check_cases()

    def _check_cases(self) -> None:
        models: dict[str, Model] = {}
        digests: DigestCache = {}
        for case in self.cases:
            if self.over is not None:
                if not isinstance(self.over, str) or self.over not in case.parameters:
                    raise BeamdaeError(
                        f"{self.name}: over must be a parameter that every case sets, got "
                        f"{short_repr(self.over)}."
                    )
                require_positive(self.name, self.over, case.parameters[self.over])
            case.mechanism_fingerprint(digests)
            model = models.setdefault(case.model.name, case.model)
            if model is case.model:
                continue
            fingerprints = {Case(x).mechanism_fingerprint(digests) for x in (model, case.model)}
            if len(fingerprints) > 1:
                raise BeamdaeError(
                    f"{self.name}: two different models have the name "
                    f"{case.model.name!r}; rename one model."
                )

    def computes_errors(self, runs: int) -> bool:
        """Return True if errors are computed for a group with `runs` different runs."""
        requested = self.over or self.references or self.columns
        return self.references != () and bool(requested or runs > 1)

    @property
    def over_header(self) -> str | None:
        """Header of the refined parameter in the case table; None unless meshes are refined."""
        return None if self.over is None else self.cases[0].model.header(self.over)

    def tag(self, case: Case) -> str:
        """Return the label that distinguishes a case from others with the same reference."""
        return case.label if self.over is None else f"{self.over}={case.parameters[self.over]}"

    def task(self, case: Case, reference: bool = False, digests: DigestCache | None = None) -> Task:
        """Return the task of a case.

        If `reference` is True, the task has ten times the time limit, one repetition and an
        animation. See `Case.mechanism_fingerprint` for `digests`.
        """
        t_end = case.model.t_end if self.t_end is None else self.t_end
        output_step = t_end / _DEFAULT_OUTPUT_ROWS if self.output_step is None else self.output_step
        limit = self.time_limit
        digests = {} if digests is None else digests
        if reference and limit is not None:
            limit = _REFERENCE_TIME_LIMIT_FACTOR * limit
        return Task(
            case.fingerprint(t_end, output_step, digests),
            case,
            t_end,
            output_step,
            limit,
            1 if reference else self.repetitions,
            frames=_REFERENCE_FRAMES if reference else 0,
            mechanism_fingerprint=case.mechanism_fingerprint(digests),
        )


def _require_cases(name: str, value: Any) -> tuple[Case, ...]:
    allowed = "a list of at least one Case"
    cases = list_entries(name, "cases", value, allowed)
    if not cases:
        raise BeamdaeError(f"{name}: cases must be {allowed}, got {short_repr(value)}.")
    invalid = [case for case in cases if not isinstance(case, Case)]
    if invalid:
        raise BeamdaeError(
            f"{name}: cases must be {allowed}, but one entry is {short_repr(invalid[0])}."
        )
    return tuple(cases)


def _require_references(name: str, value: Any) -> tuple[Integrator, ...] | None:
    if value is None:
        return None
    allowed = "two integrators with different methods, or () for no errors"
    references = list_entries(name, "references", value, allowed)
    if not references and isinstance(value, (tuple, list)):
        return ()
    if not references or not all(isinstance(x, Integrator) for x in references):
        raise BeamdaeError(f"{name}: references must be {allowed}, got {short_repr(value)}.")
    methods = [require_integrator(name, x).method for x in references]
    if len(methods) != 2 or methods[0] == methods[1]:
        raise BeamdaeError(f"{name}: references must be {allowed}, got {', '.join(methods)}.")
    return tuple(references)


def study(
    *,
    references: tuple[Integrator, ...] | None = None,
    columns: Iterable[str] = (),
    t_end: float | None = None,
    output_step: float | None = None,
    time_limit: float | None = _DEFAULT_TIME_LIMIT,
    repetitions: int = 1,
    over: str | None = None,
) -> Callable[[Callable[[], Iterable[Case]]], Study]:
    """Return a decorator that turns a function returning cases into a study.

    Parameters
    ----------
    references, columns, t_end, output_step, time_limit, repetitions, over
        See `Study`.

    Returns
    -------
    Callable
        Decorator that returns a `Study` with the name of the function.

    Raises
    ------
    BeamdaeError
        If the time limit is not positive. The decorator raises this error if it is not applied to
        a function, the function fails or returns no cases, or another setting is invalid (see
        `Study`).
    """
    if time_limit is not None:
        require_positive("study", "time_limit", time_limit)

    def decorate(function: Callable[[], Iterable[Case]]) -> Study:
        cases = call_definition("study", function, "cases")
        return Study(
            function.__name__,
            cases,
            references,
            columns,  # type: ignore[arg-type]
            t_end,
            output_step,
            time_limit,
            repetitions,
            over,
        )

    return decorate


def call_definition(part: str, function: Callable[[], Any], entries: str) -> Any:
    """Call the function that `part`, "study" or "sweep", decorates, and return its result.

    `entries` ("cases" or "values") describes the result in the error message. Iterators are
    converted to lists of at most 1 000 001 entries.

    Raises
    ------
    BeamdaeError
        If it is no function, or raises an exception other than KeyboardInterrupt, such as
        `SystemExit`.
    """
    if not callable(function) or not hasattr(function, "__name__"):
        raise BeamdaeError(
            f"{part}: the decorated object must be a function, got {short_repr(function)}."
        )
    try:
        listed = function()
        # A generator function runs only when it is iterated.
        return list(islice(listed, MAX_CASES + 1)) if isinstance(listed, Iterator) else listed
    except (BeamdaeError, KeyboardInterrupt):
        raise
    except BaseException as problem:
        raise BeamdaeError(
            f"{function.__name__}: creating the {entries} failed: "
            f"{describe_exception(problem, 'the function')}."
        ) from problem
