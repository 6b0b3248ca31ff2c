"""A sweep: one model over values of its parameters, and what is told of each run."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from beamdae.errors import BeamdaeError, require_positive, set_fields, short_repr
from beamdae.integrators import Auto, Integrator
from beamdae.integrators.integrator import require_integrator
from beamdae.model_functions import Model
from beamdae.model_functions import model as model_of
from beamdae.results.solution import Solution
from beamdae.studies.case import Case, DigestCache, cached_digest
from beamdae.studies.definition import Study, call_definition
from beamdae.studies.deviations import require_column_names
from beamdae.studies.execution.case_run import Limits, Task
from beamdae.studies.store.fingerprints import FingerprintError, digest
from beamdae.studies.sweeps.parameter_study import expand_values

if TYPE_CHECKING:
    from beamdae.studies.execution.study_progress import StudyProgress
    from beamdae.studies.sweeps.sweep_results import SweepResults

Output = Callable[[Solution], Any]

# Columns of the table that are there whatever is swept.
RESERVED_COLUMNS = ("status", "reason", "wall time [s]", "trajectory", "warnings")


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
        set_fields(self, outputs=_require_outputs(self.name, self.outputs, self.parameters))
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
        return ", ".join(f"{x}={format_setting(told[x])}" for x in self.varied or told) or self.name

    def task(self, case: Case, reference: bool = False, digests: DigestCache | None = None) -> Task:
        """A case as a task, which tells the outputs; see `Study.task`."""
        digests = {} if digests is None else digests
        task = super().task(case, reference, digests)
        if not self.outputs:
            return task
        key = digest([task.key, cached_digest(digests, self.outputs, self._of_outputs)])[:20]
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
        from beamdae.studies.sweeps.sweep_results import run_sweep

        return run_sweep(self, folder, jobs, scheduler, progress)

    __call__ = run


def format_setting(value: Any) -> str:
    """What is told of a parameter, in few letters."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def create_sweep(
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
    found = expand_values(name, model, over)
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


def _require_outputs(part: str, given: Any, parameters: Iterable[str]) -> dict[str, Output]:
    wanted = "a dict of functions of a solution by name"
    if not isinstance(given, Mapping):
        raise BeamdaeError(f"{part}: outputs must be {wanted}, got {short_repr(given)}.")
    taken = {*RESERVED_COLUMNS, *parameters}
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


if TYPE_CHECKING:
    from beamdae.studies.execution.study_progress import StudyProgress
    from beamdae.studies.sweeps.sweep_results import SweepResults

# Values by parameter, or combinations of them.
Over = Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]]


@overload
def sweep(
    model: Model | Callable[..., Any],
    over: None = None,
    *,
    of: str | Iterable[str] = (),
    outputs: Mapping[str, Output] | None = None,
    integrator: Integrator | None = None,
    t_end: float | None = None,
    output_step: float | None = None,
    time_limit: float | None = None,
) -> Callable[[Callable[[], Over]], Sweep]: ...


@overload
def sweep(
    model: Model | Callable[..., Any],
    over: Over,
    *,
    of: str | Iterable[str] = (),
    outputs: Mapping[str, Output] | None = None,
    integrator: Integrator | None = None,
    t_end: float | None = None,
    output_step: float | None = None,
    time_limit: float | None = None,
    folder: str | Path | None = None,
    jobs: int | None = 1,
    scheduler: str | None = None,
    progress: Callable[[StudyProgress], None] | None = None,
) -> SweepResults: ...


def sweep(
    model: Model | Callable[..., Any],
    over: Over | None = None,
    *,
    of: str | Iterable[str] = (),
    outputs: Mapping[str, Output] | None = None,
    integrator: Integrator | None = None,
    t_end: float | None = None,
    output_step: float | None = None,
    time_limit: float | None = None,
    folder: str | Path | None = None,
    jobs: int | None = 1,
    scheduler: str | None = None,
    progress: Callable[[StudyProgress], None] | None = None,
) -> Any:
    """Run a model over values of its parameters; without `over`, a decorator.

    Of each run the table tells the last, largest and smallest value and the root mean square over
    time of observed columns, and what functions of the solution return; a run that fails is a row
    with its reason. With `over` it runs here and now. Without, it decorates a function without
    arguments that returns the values, for `beamdae sweep FILE.py`, or to be called.

    Parameters
    ----------
    model
        A model function, see `bd.model`, or any function with keyword defaults that builds a
        mechanism (then give `t_end`).
    over
        Values by parameter, all combinations of which are run: `{"elements": [4, 8]}`. Values that
        are no numbers have names as a dict, `{"section": {"thin": thin, "thick": thick}}`. Or a
        list of combinations, each a dict of parameters, see `bd.grid`.
    of
        Observed columns that are told of, by header, with or without unit ("tip.y"), or by
        observable ("tip"); default all.
    outputs
        Functions of a `Solution` that return a number, a truth value, a text or None, by the name
        of their column, such as `{"peak [m]": lambda run: run["tip.y"].abs().max()}`.
    integrator
        Of all runs; default `Auto()`.
    t_end, output_step
        End time and time between rows [s]; default the model's, and a 400th of it. Largest values
        and root mean squares are those of the rows.
    time_limit
        Wall time a run may take [s]; default no limit.
    folder
        Where the table and all runs are kept; those that are there already are not done again, so
        that an interrupted sweep goes on. Default nowhere.
    jobs
        Processes; 1: one run after the other in this process, None: one a core.
    scheduler
        Address of a Dask scheduler, whose workers do the runs.
    progress
        Called with a `StudyProgress` (`done`, `total`, `failed`, ...) after each run.

    Returns
    -------
    SweepResults or a decorator, which gives a Sweep

    Raises
    ------
    BeamdaeError
        If a parameter is unknown, has no values or such of a wrong type, or there is no such
        column. Values the model itself refuses are failed rows.

    Warns
    -----
    BeamdaeWarning
        Of runs that did not reach their end, and of those with warnings of their own.

    Examples
    --------
    >>> import beamdae as bd
    >>> def swing(length=1.0, mass=2.0):
    ...     mech = bd.Mechanism(gravity=(0.0, -9.81))
    ...     bob = mech.add(bd.PointMass("bob", mass, at=(length, 0.0)))
    ...     mech.add(bd.Distance("rope", mech.ground.at(0.0, 0.0), bob.point))
    ...     mech.observe("bob", bob.point)
    ...     return mech
    >>> found = bd.sweep(swing, {"length": [0.5, 1.0, 2.0]}, of="bob.y", t_end=1.0)
    >>> print(found.table[["length", "bob.y min [m]"]].round(3).to_string(index=False))
     length  bob.y min [m]
        0.5           -0.5
        1.0           -1.0
        2.0           -2.0
    >>> path = found.plot("bob.y").save("bob.png")
    """
    chosen = _model(model, t_end)
    if time_limit is not None:
        require_positive("sweep", "time_limit", time_limit)
    said: dict[str, Any] = {
        "of": of,
        "outputs": outputs,
        "integrator": integrator,
        "t_end": t_end,
        "output_step": output_step,
        "time_limit": time_limit,
    }
    if over is not None:
        stated = create_sweep(chosen, over, f"{chosen.name}_sweep", **said)
        return stated.run(folder, jobs, scheduler, progress)
    if (folder, jobs, scheduler, progress) != (None, 1, None, None):
        raise BeamdaeError(
            "sweep: folder, jobs, scheduler and progress say how it is run, and are arguments of "
            "the sweep that this decorates, or of sweep(model, over=...)."
        )

    def decorate(function: Callable[[], Over]) -> Sweep:
        if not callable(function) or not hasattr(function, "__name__"):
            raise BeamdaeError(f"sweep: it must decorate a function, got {short_repr(function)}.")
        return create_sweep(chosen, call_definition(function, "values"), function.__name__, **said)

    return decorate


def _model(given: Any, t_end: float | None) -> Model:
    if isinstance(given, Model):
        return given
    if not inspect.isfunction(given):
        raise BeamdaeError(
            "sweep: model must be a function with parameters that builds a mechanism, see "
            f"bd.model, got {short_repr(given)}."
        )
    if t_end is None:
        raise BeamdaeError(f"sweep: {given.__name__} has no end time of its own, give t_end=.")
    try:
        return model_of(t_end=t_end)(given)
    except BeamdaeError as problem:
        raise BeamdaeError(f"sweep: model must have named parameters, {problem}") from None
