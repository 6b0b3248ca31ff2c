"""Simulation of models, and loading of saved runs."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import partial as bind
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae import deferred, integrators
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.smooth_intervals import SAME_TIME
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    format_distinct,
    is_valid_path,
    path_as_text,
    require_choice,
    require_positive,
    require_progress,
    short_repr,
    warn_of_incomplete_result,
    warn_of_result,
    warnings_are_ignored,
)
from beamdae.integrators.integrator import Integrator, require_integrator
from beamdae.integrators.limits import Progress
from beamdae.integrators.step_thinning import keep_all_steps
from beamdae.interrupts import (
    PARTIAL_RESULTS,
    Interrupted,
    PartialResult,
    acknowledge,
    attach_partial,
    interruptible,
)
from beamdae.linear.blas_threads import single_threaded
from beamdae.memory import is_out_of_memory, require_memory
from beamdae.model_functions import HasOrigin, Model
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM, Mechanism, require_start
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution

# Imported by the functions that need them: their import takes 5 % of the time of a short command.
if TYPE_CHECKING:
    from beamdae.equations.assembly.constrained_system import ConstrainedSystem
    from beamdae.parts.rotation import Rotation
    from beamdae.results.equilibrium import Equilibrium
    from beamdae.results.storage.checkpoint import Checkpoint
    from beamdae.results.storage.saved_run import SavedRun

_MAX_ROWS = 1e7  # in a result
_DEFAULT_ROWS = 1000
_ROUNDING_OF_ROWS = 1e-9  # tolerance of the number of output steps


@interruptible
@single_threaded
def simulate(
    model: Model | Mechanism | ConstrainedSystem | EquationsOfMotion,
    integrator: Integrator | None = None,
    t_end: float | None = None,
    output_step: float | None = None,
    progress: Progress | None = None,
    start: Solution | Equilibrium | Rotation | Path | str | Mapping[str, float] | None = None,
    accept_changes: bool = False,
    *,
    inputs: Mapping[str, Any] | None = None,
    keep_steps: bool = False,
    partial: PartialResult = "raise",
    sensitivities: Sequence[str] | str | None = None,
    accuracy: float | None = None,
    accuracy_columns: Sequence[str] | str | None = None,
) -> Solution:
    """Integrate a model from t = 0, or from the end of an earlier run.

    Parameters
    ----------
    model
        A model function (run with its default parameters), a mechanism, a constrained system or
        equations of motion.
    integrator
        `Auto`, `Ida`, `Radau`, `GeneralizedAlpha` or any other `Integrator`. Defaults to `Auto()`.
    t_end
        End time [s]. Defaults to the model's end time.
    output_step
        Time between rows of the result [s]. Defaults to a thousandth of the end time. The last row
        is at the end of the run.
    progress
        Function called repeatedly with the time reached [s], or with the start time during a pilot
        run. Return a string to stop the run; it becomes the reason.
    start
        Start of the run. Defaults to the start of the model.

        - "as drawn": the reference configuration, with the initial velocities of the parts;
        - "equilibrium": at rest under the loads at t = 0;
        - a steady `rotation` of the whole mechanism, for turning beams;
        - positions and velocities by name, such as {"crank.angle": 0.3, "crank.angle_dot": 5.0};
        - a `Solution` of the same model, or the path of a saved one (see `Solution.save`):
          the run resumes from the last state, and `Solution.followed_by` joins the two runs;
        - an `Equilibrium`: at rest at the end of its path, under the loads of the model.
    accept_changes
        True to resume from a run of a model with the same coordinates but different parameters,
        numbers or formulas; the differences are reported as a warning.
    inputs
        Numbers or time laws that replace the values of inputs of the mechanism, by name of the
        input; see `Mechanism.input`.
    keep_steps
        True to store all steps. By default, a run whose steps would take more than 0.4 GB stores
        only the rows at the output times, as many evenly spaced rows between them as fit, and the
        energies of all steps. Results at the output times do not change, but `Solution.at`,
        `at_times` and `section_forces` at other times interpolate between the stored rows, and
        sensitivities of the run are not available.
    accuracy
        Largest error of a required column [-], from 1e-6 to 0.1, see `Errors`. The run is repeated,
        up to five times, with smaller steps, finer meshes and exact strains, by what contributes,
        until its measured errors are small enough; `errors.status` says what was reached.
        `time_limit` of the integrator applies to all runs together. The run must begin at t = 0.
    accuracy_columns
        Observed columns, or names of observables, that must be accurate. Defaults to all positions,
        angles and deflections [m, rad] or, if there are none, to all columns.
    partial
        "return" to return the solution so far if the run is interrupted, with the status
        "interrupted", instead of raising `Interrupted`. Before the run has begun, `Interrupted` is
        raised in any case. With `accuracy`, the solution so far is the last one with known errors.
    sensitivities
        Names of float parameters of the model function. The solution then contains the derivatives
        of its columns with respect to them: `Solution.sensitivity` returns them, and tables, files
        and pages contain columns such as "d(tip.y)/d(E) [m per unit of E]". `model` must be a model
        function or a mechanism that one has built, `Auto` is replaced by `Radau`, and all steps are
        stored. See `beamdae.sensitivities` for the method, its limits and the further runs that
        estimate the errors of the derivatives.

    Returns
    -------
    Solution
        The result up to the time reached. If the run fails after it has begun, no exception is
        raised; `status` gives the reason. A completed run is repeated with everything refined, to
        warn of errors above 4 %, unless this takes long; see `Solution.errors`.

    Raises
    ------
    BeamdaeError
        If the model or a setting is invalid, the run cannot begin (for example, because the joints
        cannot be closed), the run that is resumed does not fit the model, or the run needs more
        memory than is available.
    Interrupted
        If Ctrl-C ends the run; `Interrupted.solution` is the solution so far. It is None if the run
        had not started.
    Exception
        Exceptions of `progress`. Their attribute `solution` is the solution so far.

    Warns
    -----
    BeamdaeWarning
        If the run was not completed (with the reason), and for each of `Solution.warnings`.
        If filters of `warnings` ignore this category, the latter are evaluated only when they are
        read, which saves the time of a short run.
    KernelWarning
        If machine code cannot be compiled or cached, so that runs are slower, or if `Auto` replaces
        `Ida` because a package cannot be imported; once per process and message.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 0.2, at=(0.0, 1.0), velocity=(3.0, 0.0)))
    >>> mech.observe("ball", ball.point)
    >>> solution = bd.simulate(mech, bd.Radau(rtol=1e-6), t_end=0.4)
    >>> print(f"{solution['ball.x'].iloc[-1]:.6f}")
    1.200000
    """
    require_choice("simulate", "partial", partial, PARTIAL_RESULTS)
    if sensitivities is not None:
        if accuracy is not None:
            raise BeamdaeError(
                "simulate: sensitivities are not supported with accuracy; pass the mechanism of "
                "the accurate run, solution.equations.mechanism, without accuracy."
            )
        differentiate = deferred.module("analysis.sensitivities.sensitivities").simulate_with
        solution: Solution = differentiate(
            sensitivities,
            model,
            integrator,
            t_end,
            output_step,
            progress=progress,
            start=start,
            inputs=inputs,
            partial=partial,
        )
        return solution
    model, t_end, description = unpack_model("simulate", model, t_end)
    if inputs is not None:
        if not isinstance(model, Mechanism):
            raise BeamdaeError(
                f"simulate: inputs require a mechanism, got {short_repr(model)}; change the "
                "numbers of the model instead."
            )
        model = model.with_inputs(inputs)
    method = integrators.Auto() if integrator is None else integrator
    require_integrator("simulate", method)
    require_progress("simulate", progress)
    checkpoint = _read_checkpoint(start)
    if checkpoint is None and start is not None:
        require_start("simulate", start, ", a solution, an equilibrium or the path of a run")
    if accuracy is not None and checkpoint is not None:
        raise BeamdaeError(
            "simulate: accuracy requires a run that does not resume another one, got start = "
            f"{short_repr(start)}; omit one of the arguments."
        )
    begin = 0.0 if checkpoint is None else checkpoint.t
    request = _Request(
        description,
        compute_output_times("simulate", t_end, output_step, begin),
        start,
        checkpoint,
        require_choice("simulate", "accept_changes", accept_changes, (True, False)),
        require_choice("simulate", "keep_steps", keep_steps, (True, False)),
        progress,
    )
    try:
        if accuracy is None and accuracy_columns is None:
            solution = request.integrate(model, method)
        else:
            solution = _reach_accuracy(request, model, method, accuracy, accuracy_columns)
    except Interrupted as problem:
        if not isinstance(problem.partial, Solution):
            raise
        acknowledge()
        solution = problem.partial
    except (MemoryError, RuntimeError) as problem:
        if not is_out_of_memory(problem):
            raise
        raise BeamdaeError(
            f"{request.name}: the run needs more memory than is available; use fewer elements."
        ) from None
    solution, sentences = _collect_warnings(request.name, solution)
    if solution.status.kind == "interrupted" and partial == "raise":
        raise Interrupted(solution.status.sentence, solution, "simulate")
    if not solution.status.success:
        warn_of_incomplete_result(_describe_early_end(request.name, solution))
    warn_of_result(sentences, solution.equations.build_warnings)
    return solution


@dataclass(frozen=True)
class _Request:
    """A run as it was requested.

    Attributes
    ----------
    description
        Name, parameters and units of the model, see `unpack_model`.
    times
        Output times [s].
    start, checkpoint
        Start that replaces that of the model, or the state from which the run resumes.
    accepts_changes, keeps_steps, progress
        See `simulate`.
    require_columns
        Check of the observed columns before a run, which may take hours.
    """

    description: dict[str, Any]
    times: np.ndarray
    start: Any
    checkpoint: Checkpoint | None
    accepts_changes: bool
    keeps_steps: bool
    progress: Progress | None
    require_columns: Callable[[Sequence[str]], None] | None = None

    @property
    def name(self) -> str:
        """Name of the model in messages."""
        return self.description.get("name", "simulate")

    def integrate(self, model: Any, method: Integrator) -> Solution:
        """Run a model, or its copy with a finer mesh, by a method."""
        equations, resume_warnings = self._build(model)
        if self.require_columns is not None:
            self.require_columns(equations.observed_headers)
        bytes_per_row = 8.0 * (3 * equations.n + equations.m)
        rows = len(self.times)
        require_memory(
            "simulate", f"output of {rows} rows", bytes_per_row * rows, "use a longer output_step"
        )
        description = self.description | {"t_end": float(self.times[-1])}

        def describe(solution: Solution) -> Solution:
            return replace(solution, model=description, resume_warnings=resume_warnings)

        try:
            with keep_all_steps(self.keeps_steps):
                solution = method.integrate(equations, self.times, progress=self.progress)
        except (Interrupted, Exception) as problem:
            if isinstance(so_far := getattr(problem, "partial", None), Solution):
                attach_partial(problem, describe(so_far))
            raise
        if not isinstance(solution, Solution):
            raise BeamdaeError(
                f"simulate: {method.method}.integrate must return a Solution, got "
                f"{short_repr(solution)}."
            )
        return describe(solution)

    def _build(self, model: Any) -> tuple[EquationsOfMotion, tuple[str, ...]]:
        """Return the equations with their start, and warnings about an earlier run."""
        if self.checkpoint is None:
            return as_equations("simulate", model, self.start, sampled=True), ()
        drawn_equations = as_equations("simulate", model, AS_DRAWN, sampled=True)
        equations = self.checkpoint.start_equations(drawn_equations)
        parameters = self.description.get("parameters", {})
        changes = self.checkpoint.describe_changes(drawn_equations, parameters)
        if changes and not self.accepts_changes:
            raise BeamdaeError(
                f"{self.name}: the start belongs to a run with {changes}; use the same model, "
                "or pass accept_changes=True."
            )
        warnings = []
        if self.checkpoint.doubt:
            warnings.append(
                f"{self.name}: the run resumes from an unreliable state because the earlier run "
                f"ended early ({self.checkpoint.doubt}); repeat the earlier run first."
            )
        if changes:
            warnings.append(
                f"{self.name}: the earlier run had {changes}; check that resuming with this model "
                "is intended."
            )
        return equations, tuple(warnings)


def _reach_accuracy(
    request: _Request, model: Any, method: Integrator, accuracy: float | None, columns: Any
) -> Solution:
    """Repeat a run until its measured errors are small; see `accuracy` of `simulate`."""
    until = deferred.module("accuracy.until")
    if accuracy is not None:
        request = replace(request, require_columns=bind(until.require_columns, "simulate", columns))
    runs = until.Analysis(
        "simulate",
        request.integrate,
        method,
        request.start,
        observed=lambda run: run.columns,
        is_run=True,
        progress=request.progress,
    )
    solution: Solution = until.reach_accuracy(runs, model, accuracy, columns)
    return solution


def unpack_model(caller: str, model: Any, t_end: float | None) -> tuple[Any, float, dict[str, Any]]:
    """Return the built model, its end time [s], and a dict with its name and parameters.

    `t_end` defaults to the end time of the model; `caller` is the calling function, for messages.
    The dict is empty if the model does not come from a model function.

    Raises
    ------
    BeamdaeError
        If there is no end time.
    """
    description: dict[str, Any] = {}
    origin = model.origin if isinstance(model, (Model, HasOrigin)) else None
    if origin is not None:
        t_end = origin.t_end if t_end is None else t_end
        description = {"name": origin.name, "parameters": origin.parameters}
        if origin.units:
            description["units"] = origin.units
    if isinstance(model, Model):
        model = model()
    if t_end is None:
        raise BeamdaeError(f"{caller}: the model has no end time; pass t_end=.")
    return model, t_end, description


def load(path: str | Path, model: Any = None) -> Solution | SavedRun:
    """Load a run that `Solution.save` wrote.

    Parameters
    ----------
    path
        Path of the file.
    model
        Model function, mechanism, constrained system or equations of motion of the run.

    Returns
    -------
    Solution or SavedRun
        With `model`, the `Solution` including all steps. Without `model`, a `SavedRun` with the
        tables, status and statistics of the run.

    Raises
    ------
    BeamdaeError
        If the file does not exist, is damaged, has another version, or contains a run of a model
        other than `model`.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    >>> mech.observe("ball", ball.point)
    >>> path = bd.simulate(mech, t_end=1.0).save("fall.beamdae")
    >>> print(f"{bd.load(path)['ball.y'].min():.3f} m")
    -2.905 m
    >>> print(f"{bd.load(path, mech).at(0.5).state.q[1]:.3f} m")
    0.774 m
    """
    from beamdae.results.storage.saved_run import load_saved_run

    equations = None
    if model is not None:
        equations = as_equations("load", model, AS_DRAWN, sampled=True)
    return load_saved_run(path, equations)


def as_mechanism(name: str, model: Any) -> Mechanism:
    """Return a mechanism, or the mechanism that a model builds; `name` begins the message.

    Raises
    ------
    BeamdaeError
        If `model` is neither a mechanism nor a model function.
    """
    if isinstance(model, Model):
        model = model()
    if not isinstance(model, Mechanism):
        raise BeamdaeError(f"{name}: expected a model or a mechanism, got {short_repr(model)}.")
    return model


def as_equations(
    name: str, model: Any, start: Any = None, *, sampled: bool = False
) -> EquationsOfMotion:
    """Return the equations of motion of a model.

    Parameters
    ----------
    name
        Name of the calling function, for messages.
    model
        A model function, mechanism, constrained system or equations of motion.
    start
        Start that replaces the start of the model: "as drawn", "equilibrium", a `Rotation`, or
        positions and velocities by name.
    sampled
        True for runs, which call the laws of sampled controllers.

    Raises
    ------
    BeamdaeError
        If `model` has none of these types, its equations cannot be assembled, or it has a sampled
        controller and `sampled` is False.
    """
    if isinstance(model, Model):
        return as_equations(name, model(), start, sampled=sampled)
    if isinstance(model, Mechanism):
        equations = equations_of_motion(model, start)
        if equations.controllers and not sampled:
            raise BeamdaeError(
                f"{name}: the sampled controller {equations.controllers[0].controller.name!r} is "
                "called only in runs; omit it, or replace it by states (mech.state). For poles of "
                "its loop, use bd.linearize(plant).state_space(every) of the mechanism without it."
            )
        return equations
    from beamdae.equations.assembly.constrained_system import ConstrainedSystem
    from beamdae.equations.starts.initial_conditions import apply_initial_conditions

    if isinstance(model, ConstrainedSystem):
        equations = model.equations
        if model.build_warnings:
            equations = replace(equations, build_warnings=model.build_warnings)
        model = equations
    if isinstance(model, EquationsOfMotion):
        return model if start is None else apply_initial_conditions(model, start)
    raise BeamdaeError(f"{name}: expected a model or a mechanism, got {short_repr(model)}.")


def _read_checkpoint(start: Any) -> Checkpoint | None:
    """Return a checkpoint from a result, a checkpoint or a file path; None for other starts."""
    if start is None:
        return None
    from beamdae.results.equilibrium import Equilibrium
    from beamdae.results.storage.checkpoint import Checkpoint

    if isinstance(start, Solution):
        return Checkpoint.of(start)
    if isinstance(start, Equilibrium):
        return start.to_checkpoint()
    name = path_as_text(start)
    if name is not None and is_valid_path(name):
        # A misspelled "equilibrium" has no suffix.
        is_file = isinstance(start, Path) or Path(name).suffix != "" or os.path.isfile(name)
        if is_file and name not in (AS_DRAWN, EQUILIBRIUM):
            return Checkpoint.read(Path(name))
    return start if isinstance(start, Checkpoint) else None


def compute_output_times(name: str, t_end: Any, output_step: Any, begin: float = 0.0) -> np.ndarray:
    """Return `begin`, the multiples of the output step between `begin` and `t_end`, and `t_end`.

    The output step defaults to a thousandth of `t_end`. `name` is the calling function, for
    messages. All times are in s.

    Raises
    ------
    BeamdaeError
        If `t_end` or `output_step` is not positive, `t_end` is not later than `begin`, or there are
        more than 1e7 rows.
    """
    t_end = require_positive(name, "t_end", t_end)
    if not t_end > begin:
        end, start = format_distinct(t_end, begin)
        raise BeamdaeError(f"{name}: t_end = {end} s must be later than the start, t = {start} s.")
    if output_step is None:
        step = t_end / _DEFAULT_ROWS
    else:
        step = require_positive(name, "output_step", output_step)
    if t_end / step > _MAX_ROWS:
        raise BeamdaeError(
            f"{name}: output_step = {step:g} s gives more than {_MAX_ROWS:.0e} rows up to "
            f"t = {t_end:g} s; use a longer output_step."
        )
    rows = max(int(np.ceil(t_end / step - _ROUNDING_OF_ROWS)), 1)
    times = np.minimum(step * np.arange(rows + 1), t_end)
    times[-1] = t_end
    return np.append(begin, times[times > begin * (1.0 + SAME_TIME)])


_is_unchecked: ContextVar[bool] = ContextVar("is_unchecked", default=False)


@contextmanager
def unchecked() -> Iterator[None]:
    """Within the context, the errors of results are measured only when they are read."""
    token = _is_unchecked.set(True)
    try:
        yield
    finally:
        _is_unchecked.reset(token)


@contextmanager
def silenced() -> Iterator[None]:
    """Within the context, analyses issue no warnings and measure no errors, as in searches."""
    with warnings.catch_warnings(action="ignore", category=BeamdaeWarning), unchecked():
        yield


def is_unchecked() -> bool:
    """Return True in `with unchecked()`."""
    return _is_unchecked.get()


def _collect_warnings(name: str, solution: Solution) -> tuple[Solution, tuple[str, ...]]:
    """Return the solution and its warnings; Ctrl-C skips the checks and changes the status."""
    sentences: tuple[str, ...] = ()
    try:
        # After an interrupt, no further evaluations delay the return.
        is_checked = not warnings_are_ignored()
        if solution.status.kind != "interrupted" and is_checked:
            sentences = solution.warnings
    except KeyboardInterrupt:
        acknowledge()
        reason = f"interrupted at t = {solution.trajectory.end:.6g} s, while the run was checked"
        solution = replace(solution, status=Status("interrupted", reason))
    except (MemoryError, RuntimeError) as problem:
        if not is_out_of_memory(problem):
            raise
        sentences = (
            f"{name}: the run could not be checked because no memory is left; use "
            "fewer elements, larger steps or fewer rows.",
        )
    return solution, sentences


def _describe_early_end(name: str, solution: Solution) -> str:
    status, t_end = solution.status, solution.model["t_end"]
    return (
        f"{name}: the run was not finished ({status.kind}) and results cover t = "
        f"{solution.t[0]:.6g} to {solution.trajectory.end:.6g} s of {t_end:g} s; "
        f"{status.sentence}."
    )
