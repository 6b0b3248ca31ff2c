"""`bd.sweep`: run a model over values of its parameters, or state a sweep for a file."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from beamdae.errors import BeamdaeError, require_positive, short_repr
from beamdae.integrators import Integrator
from beamdae.model_functions import Model
from beamdae.model_functions import model as model_of
from beamdae.studies.definition import call_definition
from beamdae.studies.sweeps.sweep import Output, Sweep, sweep_of

if TYPE_CHECKING:
    from beamdae.studies.execution.study_progress import StudyProgress
    from beamdae.studies.sweeps.results import SweepResults

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
        stated = sweep_of(chosen, over, f"{chosen.name}_sweep", **said)
        return stated.run(folder, jobs, scheduler, progress)
    if (folder, jobs, scheduler, progress) != (None, 1, None, None):
        raise BeamdaeError(
            "sweep: folder, jobs, scheduler and progress say how it is run, and are arguments of "
            "the sweep that this decorates, or of sweep(model, over=...)."
        )

    def decorate(function: Callable[[], Over]) -> Sweep:
        if not callable(function) or not hasattr(function, "__name__"):
            raise BeamdaeError(f"sweep: it must decorate a function, got {short_repr(function)}.")
        return sweep_of(chosen, call_definition(function, "values"), function.__name__, **said)

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
