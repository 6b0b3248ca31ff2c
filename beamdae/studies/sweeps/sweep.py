"""`bd.sweep`: run a model over values of its parameters, or define a sweep in a file."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from beamdae.errors import (
    BeamdaeError,
    as_real,
    is_valid_path,
    path_as_text,
    require_choice,
    require_entries,
    require_positive,
    require_progress,
    short_repr,
    warn_of_incomplete_result,
    warn_user,
)
from beamdae.integrators import Auto, Integrator
from beamdae.integrators.integrator import require_integrator
from beamdae.interrupts import (
    PARTIAL_RESULTS,
    Interrupted,
    PartialResult,
    attach_partial,
    interruptible,
)
from beamdae.model_functions import Model
from beamdae.model_functions import model as create_model
from beamdae.parts.rotation import Rotation
from beamdae.read_only import read_only_data
from beamdae.results.columns import require_column_names
from beamdae.studies.case import Case
from beamdae.studies.definition import call_definition
from beamdae.studies.execution.executors import SerialPool, create_executor
from beamdae.studies.execution.study_progress import StudyProgress
from beamdae.studies.execution.study_run import StudyResults, run_study
from beamdae.studies.sweeps.parameter_study import (
    STATUS,
    TRAJECTORY,
    Measure,
    Output,
    ParameterStudy,
    expand_values,
)
from beamdae.studies.sweeps.sweep_results import (
    TABLE_FILE,
    SweepResults,
    create_sweep_results,
    list_warnings,
)


@read_only_data
@dataclass(frozen=True)
class Sweep(ParameterStudy):
    """Runs of one model over values of its parameters; created by `bd.sweep` as a decorator.

    A sweep is a study without references. To run a sweep from Python, call the sweep or its method
    `run`; on the command line, use `beamdae sweep FILE.py`.

    Attributes
    ----------
    columns
        Observed columns in the table. Defaults to all observed columns.
    outputs
        Functions of a `Solution`, by column name.
    settings
        Parameter values of each case as displayed: numbers, booleans and strings; other values,
        and values with a name, are displayed as strings.
    """

    @interruptible
    def run(
        self,
        folder: str | Path | None = None,
        jobs: int | None = 1,
        scheduler: str | Executor | None = None,
        progress: Callable[[StudyProgress], None] | None = None,
        *,
        partial: PartialResult = "raise",
    ) -> SweepResults:
        """Run all cases that are not yet stored in `folder`, and return the results.

        Parameters
        ----------
        folder, jobs, scheduler, progress, partial
            See `bd.sweep`.

        Raises
        ------
        BeamdaeError
            If an argument is invalid, a column does not exist, or `folder` cannot be written.
        Interrupted
            If Ctrl-C ends the sweep; `Interrupted.partial` contains the results so far.
        Exception
            Any exception of `progress`, with the results so far as the attribute `partial`.

        Warns
        -----
        BeamdaeWarning
            If runs were not successful or have warnings, or stored results are damaged.
        """
        require_choice(self.name, "partial", partial, PARTIAL_RESULTS)
        serial = scheduler is None and as_real(jobs) == 1.0
        require_progress(self.name, progress)
        path = None if folder is None else require_folder(self.name, folder)
        # A connection to a scheduler is closed by `run_study`.
        executor = SerialPool() if serial else create_executor(self.name, "", jobs, scheduler)
        try:
            results = run_study(self, path, executor, progress)
        except Exception as problem:
            if isinstance(so_far := getattr(problem, "partial", None), StudyResults):
                attach_partial(problem, _create_results(so_far, path))
            raise
        swept = _create_results(results, path)
        if swept.interrupted and partial == "raise":
            raise Interrupted("interrupted", swept, "run")
        is_complete = bool((swept.table[STATUS] == "ok").all())
        for sentence in list_warnings(swept):
            if is_complete:
                warn_user(sentence)
            else:
                warn_of_incomplete_result(sentence)
        return swept

    __call__ = run


def _create_results(results: StudyResults, folder: Path | None) -> SweepResults:
    """Return the results of a sweep, whose table is written to `folder`."""
    swept = create_sweep_results(results)
    if folder is None:
        return replace(swept, table=swept.table.drop(columns=TRAJECTORY))
    swept.to_csv(folder / TABLE_FILE)
    return swept


def require_folder(part: str, folder: Any) -> Path:
    """Return the path of a results folder; messages begin with `part`."""
    text = path_as_text(folder)
    if text is None or not is_valid_path(text) or not text.strip():
        raise BeamdaeError(
            f"{part}: folder must be the path of a results folder, got {short_repr(folder)}."
        )
    return Path(text)


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
    start: Any = None,
    measure: Any = None,
) -> Sweep:
    """Return a sweep without running it; see `sweep` for parameters and errors."""
    if measure is not None:
        outputs = _require_measure(
            measure,
            {
                "of": of,
                "outputs": outputs,
                "integrator": integrator,
                "time_limit": time_limit,
                "t_end": t_end,
                "output_step": output_step,
                "start": start,
            },
        )
    method = require_integrator("sweep", Auto() if integrator is None else integrator)
    combinations = expand_values(name, model, over)
    cases = [
        Case(model, {x: entry.value for x, entry in combination.items()}, method, start)
        for combination in combinations
    ]
    return Sweep(
        name,
        tuple(cases),
        columns=require_column_names(name, (of,) if isinstance(of, str) else of),
        time_limit=time_limit,
        outputs={} if outputs is None else outputs,
        is_measured=measure is not None,
        settings=tuple({x: entry.label for x, entry in each.items()} for each in combinations),
        t_end=t_end,
        output_step=output_step,
    )


def _require_measure(measure: Any, run_options: Mapping[str, Any]) -> dict[str, Measure]:
    """Return `measure`, or raise an error, also if an option of runs is set."""
    allowed = "a dict of functions of a model by name"
    functions = require_entries("sweep", "measure", measure, allowed)
    if not functions or not all(map(callable, functions.values())):
        raise BeamdaeError(f"sweep: measure must be {allowed}, got {short_repr(measure)}.")
    for name, value in run_options.items():
        if not (value is None or (isinstance(value, tuple) and len(value) == 0)):
            raise BeamdaeError(
                f"sweep: {name} is an option of runs, but with measure the model is not run; omit "
                f"{name} or measure."
            )
    return functions


# Values by parameter, or a list of combinations.
Over = Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]]


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
    start: str | Rotation | Mapping[str, float] | None = None,
    measure: Mapping[str, Measure] | None = None,
    folder: str | Path | None = None,
    jobs: int | None = 1,
    scheduler: str | Executor | None = None,
    progress: Callable[[StudyProgress], None] | None = None,
    partial: PartialResult = "raise",
) -> Any:
    """Run a model over values of its parameters; without `over`, return a decorator.

    The table has one row per run, with the final value, maximum, minimum and root mean square over
    time of the observed columns, and the values of functions of the solution. With `measure`, it
    has the values of functions of the model instead, such as natural frequencies, buckling loads,
    and amplitudes of periodic motions. The row of a failed run contains the reason. With `over`,
    the sweep runs immediately. Without `over`, `sweep` decorates a function without arguments that
    returns the values; call the decorated sweep, or run it with `beamdae sweep FILE.py`.

    Parameters
    ----------
    model
        A model function, see `bd.model`, or another function that builds a mechanism and has a
        default for each parameter. Without `bd.model`, `t_end` is required.
    over
        Values by parameter name; all combinations are run: `{"elements": [4, 8]}`. A dict can name
        values that are not numbers: `{"section": {"thin": thin, "thick": thick}}`. Alternatively, a
        list of combinations, each of which is a dict of parameters; see `bd.grid`.
    of
        Observed columns to tabulate, by header with or without unit ("tip.y") or by observable
        ("tip"). Defaults to all observed columns.
    outputs
        Functions of a `Solution` that return a number, a bool, a string or None, by column name,
        for example `{"peak [m]": lambda run: run["tip.y"].abs().max()}`.
    integrator
        Integrator of all runs. Defaults to `Auto()`.
    t_end, output_step
        End time and time between rows [s]. The defaults are the end time of the model, and the end
        time / 400. Events of the model can stop runs earlier.
    time_limit
        Maximum wall time of a run [s]. Defaults to no limit.
    start
        Initial state of all runs, in the forms accepted by `Mechanism`: "equilibrium", a
        `rotation`, or values by coordinate. Defaults to the start of the model.
    measure
        Functions of a model that replace the runs, by column name. The defaults of the model are
        the parameters of the case: `{"first [Hz]": lambda model: bd.modes(model).frequencies[0]}`.
        They return a number, a bool, a string or None. Arguments that concern runs must be omitted.
    folder
        Folder for the table and the results of all runs. Runs that are already stored there are not
        repeated, so an interrupted sweep resumes. By default, nothing is stored.
    jobs
        Number of processes. With 1, all cases run in the current process; None starts one process
        per core.
    scheduler
        Address of a Dask scheduler whose workers run the cases, or an executor of
        `concurrent.futures` with worker processes, for example of mpi4py or loky.
    progress
        Function that is called with a `StudyProgress` (`done`, `total`, `failed`, ...) at the start
        and after each run.
    partial
        "return" to return the results so far if the sweep is interrupted, with
        `SweepResults.interrupted` set to True, instead of raising `Interrupted`.

    Returns
    -------
    SweepResults or callable
        Results of the sweep or, without `over`, a decorator that returns a `Sweep`.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, a parameter is unknown, has no values or values of the wrong
        type, a column does not exist, or `folder` cannot be written. If the model rejects a value,
        no error is raised; the row of the run contains the reason.
    Interrupted
        If Ctrl-C ends the sweep; `Interrupted.partial` contains the results so far. Call the sweep
        again with the same `folder` to resume.
    Exception
        Any exception of `progress`, with the results so far as the attribute `partial`.

    Warns
    -----
    BeamdaeWarning
        If runs were not successful or have warnings, or stored results are damaged.

    Examples
    --------
    >>> import beamdae as bd
    >>> def swing(length=1.0, mass=2.0):
    ...     mech = bd.Mechanism(gravity=(0.0, -9.81))
    ...     bob = mech.add(bd.PointMass("bob", mass, at=(length, 0.0)))
    ...     mech.add(bd.Distance("rope", mech.ground.at(0.0, 0.0), bob.point))
    ...     mech.observe("bob", bob.point)
    ...     return mech
    >>> results = bd.sweep(swing, {"length": [0.5, 1.0, 2.0]}, of="bob.y", t_end=1.0)
    >>> print(results.table[["length", "bob.y min [m]"]].round(3).to_string(index=False))
     length  bob.y min [m]
        0.5           -0.5
        1.0           -1.0
        2.0           -2.0
    >>> path = results.plot("bob.y").save("bob.png")
    """
    study_model = _require_model(model, t_end, measure)
    if time_limit is not None:
        require_positive("sweep", "time_limit", time_limit)
    options: dict[str, Any] = {
        "of": of,
        "outputs": outputs,
        "integrator": integrator,
        "t_end": t_end,
        "output_step": output_step,
        "time_limit": time_limit,
        "start": start,
        "measure": measure,
    }
    if over is not None:
        definition = create_sweep(study_model, over, f"{study_model.name}_sweep", **options)
        return definition.run(folder, jobs, scheduler, progress, partial=partial)
    if (folder, jobs, scheduler, progress, partial) != (None, 1, None, None, "raise"):
        raise BeamdaeError(
            "sweep: folder, jobs, scheduler, progress and partial are not arguments of the "
            "decorator; pass them to the decorated sweep, or call sweep(model, over=...)."
        )

    def decorate(function: Callable[[], Over]) -> Sweep:
        if not callable(function) or not hasattr(function, "__name__"):
            raise BeamdaeError(
                f"sweep: the decorated object must be a function, got {short_repr(function)}."
            )
        values = call_definition(function, "values")
        return create_sweep(study_model, values, function.__name__, **options)

    return decorate


def _require_model(model: Any, t_end: float | None, measure: Any) -> Model:
    if isinstance(model, Model):
        return model
    if not inspect.isfunction(model):
        raise BeamdaeError(
            "sweep: model must be a function that returns a mechanism (see bd.model), "
            f"got {short_repr(model)}."
        )
    if t_end is None and measure is not None:
        t_end = 1.0  # not used
    if t_end is None:
        raise BeamdaeError(f"sweep: {model.__name__} has no default end time; pass t_end=.")
    try:
        return create_model(t_end=t_end)(model)
    except BeamdaeError as problem:
        raise BeamdaeError(f"sweep: model must have named parameters: {problem}") from None
