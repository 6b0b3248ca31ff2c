"""One run: a model, an integrator, an end time."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.assembly.constrained_system import ConstrainedSystem
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.model_hash import hash_model
from beamdae.equations.starts.initial_conditions import apply_initial_conditions
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    is_valid_path,
    require_choice,
    require_positive,
    short_repr,
)
from beamdae.integrators import Auto, Integrator
from beamdae.integrators.integrator import Progress, require_integrator
from beamdae.memory import require_memory
from beamdae.model_functions import HasOrigin, Model
from beamdae.parts.mechanism import AS_DRAWN, Mechanism, require_start
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution
from beamdae.results.storage.checkpoint import Checkpoint
from beamdae.results.storage.files import require_file_path
from beamdae.results.storage.packed_run import PackedRun, unpack_run
from beamdae.results.storage.saved_run import SavedRun, read_saved_run, saved_run_from_arrays

_MOST_ROWS = 1e7
_SAME_TIME = 1e-12


def simulate(
    model: Model | Mechanism | ConstrainedSystem | EquationsOfMotion,
    integrator: Integrator | None = None,
    t_end: float | None = None,
    output_step: float | None = None,
    progress: Progress | None = None,
    start: Solution | Equilibrium | Path | str | Mapping[str, float] | None = None,
    accept_changes: bool = False,
) -> Solution:
    """Integrate a model from t = 0, or on from where another run ended.

    Parameters
    ----------
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
    integrator
        Auto(...), Ida(...), Radau(...), GeneralizedAlpha(...) or any other `Integrator`; default
        Auto().
    t_end
        End time [s]; default the model's own, also of what it built with other parameters.
    output_step
        Time between rows of the result [s]; default a thousandth of the run.
    progress
        Called now and then with the time reached, that of the start while a scout goes ahead; a
        text it answers ends the run there.
    start
        "as drawn", "equilibrium" (under the loads at t = 0, at rest), or positions and velocities
        by name such as {"crank.angle": 0.3, "crank.angle_dot": 5.0}; default the model's own. A run
        of the same model, or the path of a checkpoint, see `Solution.checkpoint`: the run goes on
        from its last state. `Solution.followed_by` makes one of the two. An `Equilibrium`: at rest
        where that ends, under the loads the model has.
    accept_changes
        Whether it may go on from a run of a model with other parameters, numbers or formulas on the
        same coordinates; it warns of that.

    Returns
    -------
    Solution
        Also where the run failed: `status` says why, what was computed until then is kept.

    Raises
    ------
    BeamdaeError
        If the model or a setting is wrong.

    Warns
    -----
    BeamdaeWarning
        Of a run that did not reach its end, with the reason, and of what is not to be trusted as
        it stands, see `Solution.warnings`.

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
    information: dict[str, Any] = {}
    name = "simulate"
    origin = model.origin if isinstance(model, (Model, HasOrigin)) else None
    if origin is not None:
        t_end = origin.t_end if t_end is None else t_end
        name = origin.name
        information = {"name": name, "parameters": origin.parameters}
    if isinstance(model, Model):
        model = model()
    if t_end is None:
        raise BeamdaeError("simulate: a mechanism has no end time of its own, give t_end=.")
    begun = _end_of_another(start)
    if begun is None and start is not None:
        require_start("simulate", start, ", a solution, an equilibrium or the path of a checkpoint")
    times = _output_times(t_end, output_step, 0.0 if begun is None else begun.t)
    method = Auto() if integrator is None else integrator
    require_integrator("simulate", method)
    if progress is not None and not callable(progress):
        raise BeamdaeError(f"simulate: progress must be a function, got {short_repr(progress)}.")
    told: list[str] = []
    try:
        if begun is None:
            equations = as_equations("simulate", model, start)
        else:
            equations, told = _going_on(name, begun, model, information, accept_changes)
        _require_room(equations, len(times))
        solution = method.integrate(equations, times, progress=progress)
    except (MemoryError, RuntimeError) as problem:
        if not _is_for_memory(problem):
            raise
        raise BeamdaeError(
            f"{name}: it needs more memory than there is; take fewer elements."
        ) from None
    if not isinstance(solution, Solution):
        raise BeamdaeError(
            f"simulate: {method.method}.integrate must return a Solution, got {short_repr(solution)}."
        )
    information["t_end"] = float(times[-1])
    solution = replace(solution, model=information, resume_warnings=tuple(told))
    solution, sentences = _looked_through(name, solution)
    for sentence in sentences:
        warnings.warn(sentence, BeamdaeWarning, stacklevel=2)
    return solution


def _going_on(
    name: str, begun: Checkpoint, model: Any, information: dict[str, Any], accept: bool
) -> tuple[EquationsOfMotion, list[str]]:
    """The equations to go on with, and what there is to warn of."""
    drawn = as_equations("simulate", model, AS_DRAWN)
    equations = begun.starting(drawn)
    told: list[str] = []
    changed = begun.difference(drawn, information.get("parameters", {}))
    if changed and not require_choice("simulate", "accept_changes", accept, (True, False)):
        raise BeamdaeError(
            f"{name}: start is the end of a run with {changed}; go on with the same, or say "
            "accept_changes=True (--accept-changes)."
        )
    if begun.doubt:
        told.append(f"{name}: it begins in doubt, the run before was {begun.doubt}.")
    if changed:
        told.append(f"{name}: it goes on from a run with {changed}.")
    return equations, told


def _end_of_another(start: Any) -> Checkpoint | None:
    """The end of another run, if that is what a start is."""
    if isinstance(start, Solution):
        return Checkpoint.of(start)
    if isinstance(start, Equilibrium):
        return start.starting()
    # Words have no suffix.
    named = isinstance(start, str) and Path(start).suffix != ""
    if (named or isinstance(start, Path)) and is_valid_path(str(start)):
        return Checkpoint.read(start)
    return start if isinstance(start, Checkpoint) else None


def _output_times(t_end: Any, output_step: Any, begin: float) -> np.ndarray:
    """Times of the rows to `t_end` [s]: `begin`, and those after it that a run from 0 has."""
    t_end = require_positive("simulate", "t_end", t_end)
    if not t_end > begin:
        raise BeamdaeError(
            f"simulate: t_end = {t_end:g} s must be later than the start, t = {begin:g} s."
        )
    step = (
        t_end / 1000
        if output_step is None
        else require_positive("simulate", "output_step", output_step)
    )
    if t_end / step > _MOST_ROWS:
        raise BeamdaeError(
            f"simulate: output_step {step:g} s gives more than {_MOST_ROWS:.0e} rows "
            f"in {t_end:g} s."
        )
    rows = max(int(np.ceil(t_end / step - 1e-9)), 1)
    times = np.minimum(step * np.arange(rows + 1), t_end)
    times[-1] = t_end
    return np.append(begin, times[times > begin * (1.0 + _SAME_TIME)])


def _require_room(equations: EquationsOfMotion, rows: int) -> None:
    """Refuse more rows of output than there is memory for."""
    each = 8.0 * (3 * equations.n + equations.m)
    require_memory("simulate", f"output in {rows} rows", each * rows, "take a longer output_step")


def _looked_through(name: str, solution: Solution) -> tuple[Solution, tuple[str, ...]]:
    """The solution, and what to warn of."""
    found: tuple[str, ...] = ()
    try:
        # Whoever interrupts a run does not wait for more.
        if solution.status.kind != "interrupted":
            found = solution.warnings
    except KeyboardInterrupt:
        told = f"interrupted at t = {solution.trajectory.end:.6g} s, when its warnings were sought"
        solution = replace(solution, status=Status("interrupted", told))
    except (MemoryError, RuntimeError) as problem:
        if not _is_for_memory(problem):
            raise
        found = (
            f"{name}: nothing is known of how good the run is, for there is no memory left to look "
            "at it; take fewer elements, longer steps or fewer rows.",
        )
    if solution.status.success:
        return solution, found
    status, t_end = solution.status, solution.model["t_end"]
    unfinished = (
        f"{name}: the run was not finished ({status.kind}), its rows end at "
        f"t = {solution.trajectory.end:.6g} s of {t_end:g} s; {status.sentence}."
    )
    return solution, (unfinished, *found)


def _is_for_memory(problem: Exception) -> bool:
    """Whether there is no memory left, as NumPy or as CasADi says it."""
    return isinstance(problem, MemoryError) or "bad_alloc" in str(problem)


def as_equations(name: str, model: Any, start: Any = None) -> EquationsOfMotion:
    """Equations of motion of whatever can state them; `start` stands for the model's own.

    `name` is that of the function that was given the model.
    """
    if isinstance(model, Model):
        return as_equations(name, model(), start)
    if isinstance(model, Mechanism):
        return equations_of_motion(model, start)
    if isinstance(model, ConstrainedSystem):
        model = model.equations
    if isinstance(model, EquationsOfMotion):
        return model if start is None else apply_initial_conditions(model, start)
    raise BeamdaeError(f"{name}: expected a model or a mechanism, got {short_repr(model)}.")


def load(path: str | Path, model: Any = None) -> Solution | SavedRun:
    """A run from a file of `Solution.save`.

    Parameters
    ----------
    path
        Of the file.
    model
        The model function, mechanism, system or equations that ran. With it the run is a `Solution`
        again, all steps of it; without it there are its tables, see `SavedRun`.

    Raises
    ------
    BeamdaeError
        If there is no such file, it is damaged or of another version, or the run is one of another
        model.

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
    file = require_file_path("load", path)
    arrays, told = read_saved_run(file)
    equations = None if model is None else as_equations("load", model, AS_DRAWN)
    if equations is not None and hash_model(equations) != told.get("identity"):
        raise BeamdaeError(f"{file}: it is a run of another model, of other parts or numbers.")
    try:
        if equations is None:
            return saved_run_from_arrays(file, arrays, told)
        return unpack_run(equations, PackedRun(arrays, told["plain"]))
    except (KeyError, TypeError, ValueError, IndexError):
        raise BeamdaeError(f"{file}: the saved run is damaged.") from None
