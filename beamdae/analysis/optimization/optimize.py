"""`optimize`: parameters of a model that minimize a quantity under constraints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from beamdae.analysis.gradients.objectives import Quantity
from beamdae.analysis.optimization.analyses import RunSettings
from beamdae.analysis.optimization.problem import create_problem
from beamdae.analysis.optimization.quantities import Limit
from beamdae.analysis.optimization.result import Optimization, create_optimization
from beamdae.analysis.optimization.search import SearchSettings, search_from_starts
from beamdae.analysis.optimization.solvers import METHODS, Method
from beamdae.analysis.parameter_bounds import MAX_SEED, MAX_STARTS
from beamdae.errors import (
    list_first,
    require_choice,
    require_count,
    require_positive,
    require_progress,
    warn_of_incomplete_result,
    warn_of_result,
    warn_user,
)
from beamdae.integrators import Integrator
from beamdae.interrupts import (
    PARTIAL_RESULTS,
    Interrupted,
    PartialResult,
    attach_partial,
    interruptible,
)
from beamdae.model_functions import Model


@interruptible
def optimize(
    model: Model,
    objective: Quantity,
    by: Sequence[str] | str,
    subject_to: Sequence[Limit] | Limit = (),
    bounds: Mapping[str, Any] | None = None,
    integrator: Integrator | None = None,
    t_end: float | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    start: Any = None,
    method: Method = "SLSQP",
    max_evaluations: int = 200,
    tolerance: float = 1e-7,
    starts: int = 1,
    seed: int = 0,
    progress: Callable[[int, float, float], object] | None = None,
    partial: PartialResult = "raise",
) -> Optimization:
    """Find parameters of a model that minimize a quantity under constraints.

    The search uses exact gradients: of runs by the adjoint (see `gradient`), of equilibria,
    critical loads and natural frequencies by their derivatives (see `equilibrium_sensitivities`
    and `mode_sensitivities`). Quantities of the same
    run, equilibrium path or modes share one analysis per design. The parameters are scaled by their
    first values or the widths of their bounds, the constraints by their limits, and the objective
    by its first value. To maximize a quantity, minimize -quantity.

    If an analysis fails, for example because a design has no equilibrium, the search shortens its
    step. If it finds no design that satisfies the constraints, it minimizes their violation, and
    names the limits that block. The search is local: use several `starts` to look for better
    designs.

    Parameters
    ----------
    model
        Model function.
    objective
        Quantity to minimize: an objective of a run (`EndValue`, `TimeIntegral`, `SmoothMaximum`,
        `SquaredErrors`), `EquilibriumValue`, `EquilibriumErrors`, `CriticalLoad`, `Frequency`,
        `Mass`, `ParameterFunction`, `LargestOf` several of them, or a weighted sum.
    by
        Names of the parameters to vary: floats, or tuples or lists of floats such as the
        coefficients of a thickness.
    subject_to
        Constraints `at_most(quantity, limit)` and `at_least(quantity, limit)`. An upper limit of a
        `SmoothMaximum` is that of the maximum over the run: the search is repeated from its end
        with the ratio of both until they agree within 0.1 %.
    bounds
        (lower, upper) by name, for some of the parameters; numbers, None for no bound, or texts
        with units such as "6 mm" if the model states the unit of the parameter, as `height` [m] in
        its docstring. For a list of floats, each of the two is such a number or text for all
        entries, or a list with one number per entry. All evaluated designs satisfy the bounds; a
        `ParameterFunction` may be evaluated 0.2 % beyond them.
    integrator, t_end, start
        Runs, see `gradient`. `start` is also that of equilibrium paths. One more run with half the
        step or a tenth of `rtol` checks the accuracy of the best design.
    parameters
        Values of parameters that differ from the defaults. For those in `by`, the search begins
        with these values.
    method
        "SLSQP": sequential quadratic programming (Kraft, ACM Trans. Math. Softw. 20 (1994) 262,
        doi:10.1145/192115.192124), for up to about a thousand numbers. "IPOPT": an
        interior-point method (Waechter & Biegler, Math. Program. 106 (2006) 25,
        doi:10.1007/s10107-004-0559-y), which usually needs more evaluations.
    max_evaluations
        Maximum number of evaluated designs of a search.
    tolerance
        A search ends if the scaled objective changes by less than this, or if its linearization
        could not decrease by more within a step of one size of the numbers.
    starts
        Number of searches. The first one begins with the values in `parameters`, and the others at
        points of a Latin hypercube between the bounds, which all parameters need. The result is
        that of the search with the best design; `Optimization.starts` lists all searches.
    seed
        Seed of the points.
    progress
        Function that is called after each analyzed design with the number of designs, the value of
        the objective, and the largest violation of a limit, relative to the limit; `print` lists
        the designs of a long search as they are analyzed.
    partial
        "return" to return the best design so far if the call is interrupted, with the status
        "interrupted", instead of raising `Interrupted`.

    Returns
    -------
    Optimization
        The best evaluated design that satisfies the constraints within 1e-6 of their limits; if
        there is none, the one with the smallest violation.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, an analysis of the first design (with several `starts`, of all
        first designs) fails, or its quantities cannot be differentiated.
    Interrupted
        If Ctrl-C ends the call; `Interrupted.partial` contains the best design so far, or None
        during the first analysis.
    Exception
        Any exception of `progress`, with the best design so far as the attribute `partial`.

    Warns
    -----
    BeamdaeWarning
        If the search did not converge, with the reason, for each sentence in
        `Optimization.warnings`, which contain those of the analyses of the best design.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=1.0)
    ... def cantilever(height=0.02):
    ...     mech = bd.Mechanism()
    ...     section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=height)
    ...     beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements=1))
    ...     mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    ...     mech.add(bd.Force("load", beam.end, (0.0, -50.0)))
    ...     mech.observe("tip", beam.end)
    ...     return mech
    >>> limit = bd.quantities.at_least(bd.quantities.EquilibriumValue("tip.y"), -0.01)
    >>> bounds = {"height": (0.005, 0.05)}
    >>> result = bd.optimize(cantilever, bd.quantities.Mass(), "height", limit, bounds)
    >>> print(f"{1e3 * result.parameters['height']:.1f} mm")
    16.8 mm
    """
    require_choice("optimize", "method", method, METHODS)
    require_choice("optimize", "partial", partial, PARTIAL_RESULTS)
    max_evaluations = require_count("optimize", "max_evaluations", max_evaluations)
    tolerance = require_positive("optimize", "tolerance", tolerance)
    starts = require_count("optimize", "starts", starts, most=MAX_STARTS)
    seed = require_count("optimize", "seed", seed, least=0, most=MAX_SEED)
    require_progress("optimize", progress, 3)
    run_settings = RunSettings(integrator, t_end, start)
    problem = create_problem(model, objective, by, subject_to, bounds, parameters, run_settings)
    settings = SearchSettings(method, max_evaluations, tolerance, progress)
    search, rows = search_from_starts(problem, settings, starts, seed)
    result = create_optimization(search, rows)
    if search.progress_error is not None:
        attach_partial(search.progress_error, result)
        raise search.progress_error
    if result.status.kind == "interrupted":
        if partial == "raise":
            raise Interrupted(result.status.sentence, result, "optimize")
    else:
        if search.idle:
            warn_user(
                "optimize: neither the objective nor a constraint depends on "
                f"{list_first(search.idle)} at the best design."
            )
        if not result.status.success:
            warn_of_incomplete_result(f"optimize: {result.status.sentence}.")
    warn_of_result(result.warnings)
    return result
