"""`fit`: parameters of a model function from measured columns, by least squares."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from beamdae import deferred
from beamdae.analysis.fit.problem import FitProblem, Scaling
from beamdae.analysis.fit.result import Fit, create_fit
from beamdae.analysis.fit.search import SearchResult, search
from beamdae.analysis.parameter_bounds import MAX_SEED, MAX_STARTS
from beamdae.errors import (
    require_choice,
    require_count,
    warn_of_incomplete_result,
    warn_of_result,
    warn_user,
)
from beamdae.integrators import Integrator
from beamdae.interrupts import (
    PARTIAL_RESULTS,
    Interrupted,
    PartialResult,
    acknowledge,
    interruptible,
)
from beamdae.model_functions import Model
from beamdae.results.outcome import Status


@interruptible
def fit(
    model: Model,
    data: Any,
    by: Sequence[str] | str,
    integrator: Integrator | None = None,
    *,
    data_columns: Mapping[str, str] | None = None,
    sigma: float | str | Mapping[str, float | str] | None = None,
    parameters: Mapping[str, Any] | None = None,
    experiments: Mapping[str, Mapping[str, Any]] | None = None,
    bounds: Mapping[str, Any] | None = None,
    log: Sequence[str] = (),
    scale: Any = (),
    offset: Any = (),
    shift: Any = (),
    clock: Any = (),
    start: Any = None,
    max_evaluations: int = 100,
    starts: int = 1,
    seed: int = 0,
    folder: str | Path | None = None,
    jobs: int | None = 1,
    progress: Callable[..., None] | None = None,
    partial: PartialResult = "raise",
) -> Fit:
    """Estimate parameters of a model function from measured columns.

    The sum of the squares of (model - data) / sigma is minimized by a trust-region method
    (`scipy.optimize.least_squares`, method "dogbox"; Voglis & Lagaris, WSEAS Conference on Applied
    Mathematics, Corfu 2004) with the exact Jacobian of `sensitivities`. Scales and offsets of
    sensors are eliminated by variable projection (Golub & Pereyra, Inverse Problems 19 (2003) R1,
    doi:10.1088/0266-5611/19/2/201). A search is local: start near the solution, or use several
    `starts`.

    Parameters
    ----------
    model
        Model function.
    data
        A wide table, a long table, tables by experiment, or the path of a CSV file. A table is a
        DataFrame or a dict of columns; its rows may have any order. A wide table contains the times
        "t [s]" of the data, from 0 on up to at most ten times the end time of the model, and
        measured columns with names of observed columns, such as "tip.y [m]" or "tip.y"; missing
        values are NaN. A long table contains one value per row: the columns "observable" (name of
        an observed column), "t [s]", "value", and optionally "experiment" and "sigma". Columns in
        other units, such as "t [ms]" or "tip.y (mm)", are converted; their results are in the units
        of the model. Columns that the model does not observe are omitted with a warning. CSV files
        may be separated by commas, semicolons or tabs, the last two also with decimal commas; lines
        that begin with "#", "%" or "//" are comments, and empty rows and columns are skipped.
    by
        Names of the parameters to estimate. They must be floats.
    integrator
        Integrator whose runs can be differentiated; see `sensitivities`. Defaults to
        `Radau(rtol=1e-5)`. One more run with half the step or a tenth of `rtol` checks the accuracy
        at the estimates.
    data_columns
        Names of columns of the model for columns of the data with other names, by the latter, with
        or without their units: {"Laser [mm]": "tip.y", "Zeit": "t [ms]"} maps times to "t". Units
        in the headers of the data precede those of the names given here. Other arguments name these
        columns as in the model or as in the data.
    sigma
        Standard deviation of the errors of the data, in the units of the columns of `data`, for
        example in mm for a column "tip.y [mm]" although the model is in m: a number for all
        columns, or a dict by the names used in `data`, with or without their units. Texts such as
        "0.1 mm" are converted. Required if there are several columns, unless a long table contains
        it. Defaults to an estimate from the residuals.
    parameters
        Values of parameters that differ from the defaults. For those in `by`, the search begins
        with these values.
    experiments
        For each experiment of the data, values of parameters that differ in this experiment, such
        as another tip mass. All experiments are fitted together.
    bounds
        (lower, upper) by name, for some of the parameters; numbers, None for no bound, or texts
        with units such as "6 mm" for parameters with a unit.
    log
        Names of parameters whose logarithms are varied. They and their intervals stay positive.
    scale, offset
        Columns whose sensors have an unknown scale or offset: the recorded value is
        scale * y + offset for the observed column y. An entry is the name of a column, with one
        unknown in all experiments, or a pair (experiment, column), also as "experiment:column".
        The column "*" stands for all columns, which then have one unknown in common.
    shift
        Columns with an unknown delay of the recorded times: the value recorded at t belongs to
        t - shift. Entries as in `scale`, or a dict of bounds (lower, upper) by entry, in s or as
        texts such as "5 ms". Bounds default to the first time of the data in both directions. It
        replaces larger upper bounds, with a warning, because the run starts at 0 s: omit earlier
        data for larger shifts.
    clock
        Columns with an unknown ratio of recorded to true times: the value recorded at t belongs to
        (t - shift) / clock. Entries as in `shift`, with bounds of the ratio, by default 0.9 to 1.1.
    start
        Start of the runs, see `simulate`.
    max_evaluations
        Maximum number of evaluations of a search, each with one run with derivatives per
        experiment.
    starts
        Number of searches. The first one begins with the values in `parameters`, and the others at
        points of a Latin hypercube between the bounds, which all parameters need; in `log`, the
        logarithms are distributed evenly. The best result is returned.
    seed
        Seed of the random starts.
    folder
        Folder that stores the results of finished searches if `starts` is above 1: call `fit` with
        the same arguments again to resume. Defaults to no stored results.
    jobs
        Number of processes for several starts; None means one per core.
    progress
        Function that is called with a progress object after each of several searches; see
        `bd.sweep`.
    partial
        "return" to return the best estimates so far if the call is interrupted, with the status
        "interrupted", instead of raising `Interrupted`.

    Returns
    -------
    Fit
        Estimates with covariance and the runs that fit best.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the first run fails, or the model cannot be differentiated (see
        `sensitivities`).
    Interrupted
        If Ctrl-C ends the fit; `Interrupted.partial` contains the best estimates so far, or None
        during the first run. Finished searches are stored in `folder`.
    Exception
        Any exception of `progress`. Finished searches are stored in `folder`.

    Warns
    -----
    BeamdaeWarning
        Before the search, if columns of the data are not observed, have no unit in a file or have
        times without a unit; if the search did not converge or explains less than half of the
        variation of the data, with the reason, for each sentence in `Fit.warnings`, which include
        those of the runs, and for each sentence in `Fit.undetermined` if a standard deviation is
        infinite.

    Examples
    --------
    >>> import beamdae as bd, numpy as np
    >>> @bd.model(t_end=1.0)
    ... def oscillator(stiffness=30.0):
    ...     mech = bd.Mechanism()
    ...     mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0), velocity=(0.2, 0.0)))
    ...     mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), mass.point, stiffness))
    ...     mech.observe("mass", mass.point)
    ...     return mech
    >>> t = np.linspace(0.0, 1.0, 21)
    >>> data = {"t [s]": t, "mass.x": 1.0 + 0.2 / 40.0**0.5 * np.sin(40.0**0.5 * t)}
    >>> result = bd.fit(oscillator, data, "stiffness")
    >>> print(f"{result.parameters['stiffness']:.2f} N/m")
    40.00 N/m
    """
    require_choice("fit", "partial", partial, PARTIAL_RESULTS)
    max_evaluations = require_count("fit", "max_evaluations", max_evaluations)
    starts = require_count("fit", "starts", starts, most=MAX_STARTS)
    seed = require_count("fit", "seed", seed, least=0, most=MAX_SEED)
    problem = FitProblem(
        model,
        data,
        by,
        integrator,
        sigma,
        parameters,
        start,
        experiments,
        {"shift": shift, "clock": clock, "scale": scale, "offset": offset},
        data_columns,
    )
    scaling = Scaling(problem, bounds, log)
    first, table, best = np.ones(len(scaling.first)), None, None
    points = scaling.draw_starts(starts - 1, seed) if starts > 1 else ()
    try:
        if starts > 1:
            run_starts: Any = deferred.module("studies.fit_starts").run_starts
            first, table, is_interrupted = run_starts(
                problem, scaling, max_evaluations, points, folder, jobs, progress
            )
            best = table.loc[table["chi-square"].astype(float).idxmin()]
            if is_interrupted:
                last = problem.evaluate(scaling.values(first))
                status = Status("interrupted", "interrupted before the end of all searches")
                nowhere = np.zeros(len(first), bool)
                raise Interrupted(status.sentence, SearchResult(last, 1, status, nowhere), "fit")
        end = search(problem, scaling, first, max_evaluations)
    except Interrupted as interrupt:
        if not isinstance(interrupt.partial, SearchResult):
            raise  # Interrupted in the first run.
        acknowledge()
        end = interrupt.partial
    if best is not None:
        # Those of the search from the best start, whose end is evaluated again.
        end = replace(end, evaluations=int(best["evaluations"]))
    result = create_fit(problem, scaling, end, table)
    if result.status.kind == "interrupted":
        if partial == "raise":
            raise Interrupted(result.status.sentence, result, "fit")
        return result
    if not result.status.success:
        warn_of_incomplete_result(f"fit: {result.status.sentence}.")
    is_arbitrary = np.isinf(result.standard_deviations).any()
    own = [x for x in result.warnings if x not in result.run_warnings]
    for sentence in [*own, *(result.undetermined if is_arbitrary else ())]:
        warn_user(f"fit: {sentence}", merges=False)
    builds = [x for run in result.solutions.values() for x in run.equations.build_warnings]
    warn_of_result(result.run_warnings, builds)
    return result
