"""`bd.sweep`: run a model over values of its parameters, or define a sweep in a file."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from beamdae import deferred
from beamdae.errors import (
    BeamdaeError,
    as_real,
    is_valid_path,
    path_as_text,
    require_choice,
    require_entries,
    require_mapping,
    require_positive,
    require_progress,
    set_fields,
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
from beamdae.results.solution import Solution
from beamdae.studies.case import (
    FINGERPRINT_LENGTH,
    Case,
    DigestCache,
    cached_digest,
)
from beamdae.studies.definition import Study, call_definition
from beamdae.studies.executors import SerialPool, create_executor
from beamdae.studies.fingerprints import FingerprintError, digest
from beamdae.studies.run_values import MEASURED_ERROR_COLUMN, WALL_TIME_COLUMN
from beamdae.studies.study_run import StudyResults, run_study
from beamdae.studies.sweeps.parameter_grid import GridAxis, ParameterGrid, expand_values
from beamdae.studies.tasks import StudyProgress, Task

Output = Callable[[Solution], Any]
# Function of a model whose defaults are the parameters of the case.
Measure = Callable[[Model], Any]

# Columns of every table of responses.
STATUS = "status"
REASON = "reason"
TRAJECTORY = "trajectory"
WARNINGS = "warnings"
_MAX_ANIMATED_CASES = 25  # 5 x 5 for two parameters; a recorded motion takes 0.2 MB
_FRAMES = 60  # of a recorded motion
RESERVED_COLUMNS = (STATUS, REASON, MEASURED_ERROR_COLUMN, WALL_TIME_COLUMN, TRAJECTORY, WARNINGS)


@read_only_data
@dataclass(frozen=True)
class Sweep(Study):
    """Runs of one model over values of its parameters; created by `bd.sweep` as a decorator.

    A sweep is a study without references. To run a sweep from Python, call the sweep or its method
    `run`; on the command line, use `beamdae sweep FILE.py`.

    Attributes
    ----------
    columns
        Observed columns in the table. Defaults to all observed columns.
    outputs
        Functions of a `Solution`, or of the model if `is_measured` is true, by column name.
    is_measured
        True if the outputs are functions of the model, which is not run.
    settings
        Parameter values of each case as displayed: numbers, booleans and strings; other values,
        and values with a name, are displayed as strings.

    Raises
    ------
    BeamdaeError
        If `outputs` is not a dict of functions by name, a name is blank or already a column of the
        table, or another setting is invalid; see `Study`.
    """

    references: tuple[Integrator, ...] | None = ()
    outputs: Mapping[str, Output | Measure] = field(default_factory=dict)
    is_measured: bool = False
    settings: tuple[Mapping[str, Any], ...] = ()

    def __post_init__(self) -> None:
        columns = {*RESERVED_COLUMNS, *self.parameters, *map(self.header, self.parameters)}
        set_fields(self, outputs=_require_outputs(self.name, self.outputs, columns))
        super().__post_init__()

    @property
    def parameters(self) -> list[str]:
        """Names of the swept parameters."""
        return list(dict.fromkeys(name for setting in self.settings for name in setting))

    @cached_property
    def axes(self) -> dict[str, GridAxis]:
        """Values of the parameters with more than one value, by name."""
        axes = (GridAxis.of(name, self.settings) for name in self.parameters)
        return {axis.name: axis for axis in axes if len(axis.values) > 1}

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the parameters with more than one value."""
        return tuple(self.axes)

    @cached_property
    def units(self) -> dict[str, str]:
        """Units of the swept parameters by name; "" if unknown, "-" without dimension."""
        described = self.cases[0].model.parameter_info
        return {name: described[name].unit for name in self.parameters if name in described}

    def header(self, name: str) -> str:
        """Return the header of a parameter in tables, with its unit, such as "speed [rad/s]"."""
        prefix = "parameter " if name in RESERVED_COLUMNS else ""
        return prefix + self.cases[0].model.header(name)

    @cached_property
    def grid(self) -> ParameterGrid:
        """Arrangement of the cases by the values of the varied parameters."""
        return ParameterGrid.of(self.settings, tuple(self.axes.values()))

    @cached_property
    def _animated_cases(self) -> set[int]:
        """Cases whose motion is recorded, by their `id`."""
        return {id(self.cases[row]) for row in self.grid.sample(_MAX_ANIMATED_CASES)}

    @cached_property
    def _setting_by_case(self) -> dict[int, Mapping[str, Any]]:
        return {id(case): x for case, x in zip(self.cases, self.settings, strict=True)}

    def tag(self, case: Case) -> str:
        """Return a label with the values of the varied parameters.

        If no parameter varies, the label contains the values of all parameters.
        """
        setting = self._setting_by_case[id(case)]
        values = [f"{x}={format_setting(setting[x])}" for x in self.varied or setting]
        return ", ".join(values) or self.name

    def task(self, case: Case, reference: bool = False, digests: DigestCache | None = None) -> Task:
        """Return the task of a case, including outputs and animation; see `Study.task`.

        The motion is recorded for at most 25 cases that span the parameters.
        """
        digests = {} if digests is None else digests
        task = super().task(case, reference, digests)
        if id(case) in self._animated_cases and not self.is_measured:
            task = replace(task, frames=_FRAMES)
        if not self.outputs:
            return task
        content = [task.key, cached_digest(digests, self.outputs, self._digest_outputs)]
        key = digest([*content, "measured"] if self.is_measured else content)[:FINGERPRINT_LENGTH]
        return replace(task, key=key, outputs=self.outputs, is_measured=self.is_measured)

    def _digest_outputs(self) -> str:
        try:
            return digest(dict(self.outputs))
        except FingerprintError as problem:
            raise BeamdaeError(
                f"{self.name}: outputs must be functions that another process can "
                f"reproduce, but {problem.location} has the type {problem.kind}; create it "
                "inside the function."
            ) from None

    @interruptible
    def run(
        self,
        folder: str | Path | None = None,
        jobs: int | None = 1,
        scheduler: str | Executor | None = None,
        progress: Callable[[StudyProgress], None] | None = None,
        *,
        partial: PartialResult = "raise",
    ) -> Any:
        """Run all cases that are not yet stored in `folder`, and return the `SweepResults`.

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
        for sentence in swept.all_warnings:
            if is_complete:
                warn_user(sentence)
            else:
                warn_of_incomplete_result(sentence)
        return swept

    __call__ = run


def _create_results(results: StudyResults, folder: Path | None) -> Any:
    """Return the `SweepResults`, whose module imports this one; `folder` receives their table."""
    sweep_results = deferred.module("studies.sweeps.sweep_results")
    swept = sweep_results.create_sweep_results(results)
    if folder is None:
        return replace(swept, table=swept.table.drop(columns=TRAJECTORY))
    swept.to_csv(folder / sweep_results.TABLE_FILE)
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
    measure: Any = None,
    *,
    of: Any = (),
    integrator: Any = None,
    outputs: Any = None,
    start: Any = None,
    **times: Any,
) -> Sweep:
    """Return a sweep without running it; see `sweep` for parameters and errors.

    `times` are its time limit, end time and output step.
    """
    if measure is not None:
        options = {"of": of, "outputs": outputs, "integrator": integrator, "start": start}
        outputs = _require_measure(measure, options | times)
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
        outputs={} if outputs is None else outputs,
        is_measured=measure is not None,
        settings=tuple({x: entry.label for x, entry in each.items()} for each in combinations),
        **{"time_limit": None, **times},
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
    parameters: Mapping[str, Any] | None = None,
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
    parameters
        Values of other parameters of the model that differ from the defaults.
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
    if parameters is not None:
        values = require_mapping("sweep", "parameters", parameters, "a dict of values by name")
        study_model = replace(study_model, parameters=study_model.complete(dict(values)))
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
        values = call_definition("sweep", function, "values")
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


def _require_outputs(part: str, value: Any, columns: Collection[str]) -> dict[str, Any]:
    allowed = "a dict of functions of a solution by name"
    outputs = require_entries(part, "outputs", value, allowed)
    for name, function in outputs.items():
        if not isinstance(name, str) or not name.isprintable() or not name.strip():
            raise BeamdaeError(
                f"{part}: names of outputs must be printable, non-blank strings, "
                f"got {short_repr(name)}."
            )
        if name in columns:
            raise BeamdaeError(
                f"{part}: the table already has a column {name!r}; rename the output."
            )
        if not callable(function):
            raise BeamdaeError(f"{part}: outputs must be {allowed}, got {short_repr(function)}.")
    return outputs


def format_setting(value: Any) -> str:
    """Format a displayed parameter value; floats have six significant digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


# Model, further arguments and values of the last call of each analysis. The columns of a row share
# one call.
_last_calls: dict[str, tuple[Model, tuple[Any, ...], list[float]]] = {}


def natural_frequencies(n: int, about: Any) -> dict[str, Measure]:
    """Return functions of the first n natural frequencies [Hz] of a model, as of `modes`."""
    select = partial(_measure_model, "frequencies", (about, n))
    return {f"frequency {k} [Hz]": partial(select, k) for k in range(1, n + 1)}


def buckling_factors(n: int) -> dict[str, Measure]:
    """Return functions of the first n load factors of a model, as of `buckling`."""
    select = partial(_measure_model, "factors", (n,))
    return {f"buckling factor {k} [-]": partial(select, k) for k in range(1, n + 1)}


def _measure_model(name: str, arguments: tuple[Any, ...], k: int, model: Model) -> float | None:
    """Return the k-th value of an analysis, or None if there are fewer."""
    last = _last_calls.get(name)
    if last is None or last[0] is not model or last[1] != arguments:
        from beamdae.analysis.linear_dynamics.natural_modes import compute_modes
        from beamdae.analysis.statics.linear_buckling import buckling

        analyze: Callable[..., Any] = compute_modes if name == "frequencies" else buckling
        result = analyze(model, *arguments)
        for sentence in result.warnings:
            warn_user(sentence)
        last = _last_calls[name] = model, arguments, getattr(result, name).tolist()
    values = last[2]
    return values[k - 1] if k <= len(values) else None
