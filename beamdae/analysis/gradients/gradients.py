"""`gradient`: value and gradient of a scalar objective of a run, by a discrete adjoint."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from beamdae import deferred
from beamdae.analysis.gradients.flat_model import FlatModel, flatten_model
from beamdae.analysis.gradients.objectives import (
    Objective,
    Quantity,
    SampleGrid,
)
from beamdae.analysis.sensitivities.differentiable_run import (
    DifferentiableRun,
    assess_derivatives,
    require_differentiable_method,
)
from beamdae.analysis.sensitivities.linear_steps import Matrices, transpose_steps
from beamdae.analysis.sensitivities.neighbors import Difference, derivative_call, is_regular
from beamdae.analysis.sensitivities.observable_derivatives import (
    differentiate_column,
    differentiate_formula,
    differentiate_run_columns,
    group_times,
    join_points,
    locate_column,
    read_column,
    split_points,
)
from beamdae.analysis.sensitivities.restart_times import differentiate_event_time, find_stop
from beamdae.analysis.sensitivities.run_chain import (
    COPIES_OF_ROWS,
    differentiate_starts,
    node_state,
)
from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import (
    BeamdaeError,
    record_warnings,
    short_repr,
)
from beamdae.integrators import GeneralizedAlpha, Integrator
from beamdae.integrators.reaction_balance import bound_reactions
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.memory import require_memory
from beamdae.model_functions import Model, transform_mechanisms
from beamdae.read_only import read_only_data
from beamdae.results.solution import Solution

Array = np.ndarray


@dataclass
class ColumnSeeds:
    """Derivatives of an objective with respect to the states of a run, and directly to p.

    Attributes
    ----------
    states
        Derivatives with respect to (q, v, lam) at the nodes of each interval, (nodes, 2n + m).
    numbers
        Derivatives with respect to the numbers p in the formulas of observables, (n_p,).
    operators
        Derivatives with respect to the entries of `Observable.operator`, by number of the
        observable.
    """

    states: list[Array]
    numbers: Array
    operators: dict[int, Array]

    def contract(self, difference: Difference) -> float:
        """Return the derivative with respect to a parameter at constant states of the run."""
        result = float(self.numbers @ difference.along(lambda e: e.p))
        for k, by in self.operators.items():
            change = difference.along(lambda e, k=k: e.observables[k].operator)
            result += float(change.multiply(by).sum())
        return result


def differentiate_objective(weights: Mapping[Objective, float], solution: Solution) -> ColumnSeeds:
    """Return the derivatives of a weighted sum of objectives by the states of a run.

    The parts of the model are active during the whole run.
    """
    equations, trajectory = solution.equations, solution.trajectory
    n, m = equations.n, equations.m
    # By columns: most objectives depend on few of them, and only these need memory.
    states = [np.zeros((len(x.nodes), 2 * n + m), order="F") for x in trajectory.intervals]
    result = ColumnSeeds(states, np.zeros(len(equations.p)), {})
    grid, points_at = SampleGrid.of(trajectory), dict[tuple[bytes, bool], Any]()
    for term, factor in weights.items():
        times, (_, number, column) = term.sample_times(grid), locate_column(equations, term.column)
        is_elastic = number is not None and equations.observables[number].is_elastic
        key = times.tobytes(), is_elastic
        if key not in points_at:
            ((_, points),) = group_times(trajectory, times, is_elastic)
            joined = join_points(points, trajectory, limited=True)
            points_at[key] = solution.at_times(times), points, *joined
        run, points, rows, at = points_at[key]
        by_samples = factor * term.evaluate(read_column(run, term.column)[1], grid.weights)[1]
        by_values = np.concatenate(
            [
                by_samples[x.here] if x.weights is None else x.weights.T @ by_samples[x.here]
                for x in points
            ]
        )
        blocks: Any = [(np.array([column]), by_values[:, None])]
        if number is not None:
            blocks = _differentiate_observable(
                result, equations, number, column, rows, at, by_values
            )
        for columns, by_states in blocks:
            for x, part in zip(points, split_points(points, by_states), strict=True):
                interval, by_nodes = trajectory.intervals[x.interval], states[x.interval]
                if x.nodes is not None:
                    by_nodes[x.nodes[:, None], columns] += part
                    continue
                shares = interval.weights_at(x.times)
                of_kinds = shares.positions, shares.velocities, shares.reactions
                kind = min(int(columns[0]) // n, 2)
                by_nodes[:, columns] += of_kinds[kind].T @ part
                if kind == 0:
                    by_nodes[:, n + columns] += shares.positions_by_velocities.T @ part
    return result


def _differentiate_observable(
    seeds: ColumnSeeds,
    e: EquationsOfMotion,
    number: int,
    column: int,
    rows: Array,
    at: State,
    by: Array,
) -> Iterator[tuple[Array, Array]]:
    """Yield columns of (q, v, lam), (c,), and the derivatives by them, (states, c).

    Derivatives by the numbers are added to `seeds`; `by` are those by the values of a column of an
    observable, (states,).
    """
    o = e.observables[number]
    acting, operator = o.active_columns
    parts = differentiate_formula(o, e, rows, at)
    *by_motion, by_p, by_lam = (by[:, None] * part[..., column] for part in parts)
    seeds.numbers[o.data] += by_p.sum(axis=0)
    for first, part, x in zip((0, e.n), by_motion, (at.q, at.v), strict=True):
        # Most columns depend either on positions or on velocities.
        if part.any():
            by_operator = seeds.operators.setdefault(number, np.zeros(o.operator.shape))
            by_operator += part.T @ x
            yield first + acting, part @ operator
    if by_lam.size:
        yield 2 * e.n + np.arange(e.m)[o.rows], by_lam


# A vibration over 16 periods had derivatives with errors of 2 % with rtol=1e-3, 0.2 % with 1e-4
# and 0.02 % with 1e-5.
DEFAULT_METHOD = GeneralizedAlpha(rtol=1e-4)


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class Gradient:
    """Value and gradient of an objective; see `gradient`.

    Attributes
    ----------
    value
        Value of the objective.
    parameters
        Values of the parameters by name: floats, or tuples for lists of floats.
    derivatives
        Derivatives of the objective by name of the parameter, floats or arrays, in the unit of
        the objective per unit of the parameter.
    solution
        The run.
    warnings
        Warnings that the call issued.
    """

    value: float
    parameters: Mapping[str, Any]
    derivatives: Mapping[str, Any]
    solution: Solution
    _repeat: Callable[[Callable[[Any], Any], Any], Gradient] | None = None
    warnings: tuple[str, ...] = field(default=(), repr=False)

    def __getstate__(self) -> dict[str, Any]:
        # Model functions cannot always be pickled; errors that are known are kept.
        return {**vars(self), "_repeat": None}

    @cached_property
    def errors(self) -> Any:
        """Errors of the value and the derivatives, see `Errors`, by a refined repetition.

        Those of derivatives are relative to the largest derivative by relative changes.
        """
        return deferred.module("accuracy.derivatives").measure_gradient(self)

    def __repr__(self) -> str:
        by = ", ".join(self.derivatives)
        return f"<Gradient by {by}: value {self.value:.6g}, norm {np.linalg.norm(self.array):.3g}>"

    @property
    def array(self) -> Array:
        """All derivatives in one array (k,), in the order of `by`; lists are flattened."""
        return np.concatenate([np.ravel(x) for x in self.derivatives.values()])


@interruptible
@record_warnings
def gradient(
    model: Model,
    objective: Quantity,
    by: Sequence[str] | str,
    integrator: Integrator | None = None,
    t_end: float | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    start: Any = None,
    estimate_error: bool = True,
) -> Gradient:
    """Integrate a model and return the gradient of an objective of the run.

    The gradient is exact for the discrete solution, like `sensitivities`, but its cost hardly
    depends on the number of parameters: it comes from the transposed equations of the steps, solved
    backwards from the end of the run. With the residual F_k of step k in its unknowns x_k, the
    derivatives J_k of the objective with respect to x_k, and the numbers p in the equations,

        (dF_k/dx_k)^T y_k = J_k - sum over j > k of (dF_j/dx_k)^T y_j,
        dJ/dp = -sum over k of (dF_k/dp)^T y_k,

    with the step sequence of the run and its exact iteration matrices; cf. Sandu, Daescu &
    Carmichael, Atmos. Environ. 37 (2003) 5083, doi:10.1016/j.atmosenv.2003.08.019. The start of the
    run and the jumps of the derivatives at events, impacts and breakpoints that depend on
    parameters are transposed as well, see `sensitivities`. If an event stops the run, the
    derivatives include those of the end time, in contrast to `sensitivities`. Only the model
    function is differenced, because it is an arbitrary Python function: parameters that affect
    different numbers of the model, such as the thicknesses of a beam at different points, are
    changed together. Differences are of fourth order, with relative errors near 1e-12.

    Parameters
    ----------
    model
        Model function.
    objective
        `EndValue`, `TimeIntegral`, `SmoothMaximum`, `SquaredErrors`, a weighted sum of these, or
        `LargestOf` several.
    by
        Names of the parameters: floats, or tuples or lists of floats such as the coefficients of a
        thickness.
    integrator
        `GeneralizedAlpha` in the index-3 form, whose `newton_tolerance` is reduced to 1e-10, or
        `Radau`. `Auto` is replaced by `Radau`. Changes of adaptive steps are not differentiated.
        Defaults to `GeneralizedAlpha(rtol=1e-4)`.
    t_end
        End time [s]. Defaults to the model's end time. It does not depend on the parameters.
    parameters
        Values of the parameters of the model that differ from the defaults.
    start
        Start of the run, see `simulate`; not another run or its file.
    estimate_error
        True to measure `Gradient.errors` and those of the run, and warn of errors above 4 %, unless
        this takes more than 2 s and eight times the run. Pass False in loops such as optimizations.

    Returns
    -------
    Gradient
        Value, derivatives and the run.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the run does not reach its end, or the model cannot be
        differentiated; see `sensitivities`.
    Interrupted
        If Ctrl-C ends the call; `Interrupted.partial` contains the result if only the estimate of
        its error is missing.

    Warns
    -----
    BeamdaeWarning
        If the run has warnings, a parameter has no effect on the model, differences of the model
        function depend on their step, or the gradient has an error above 4 %.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=1.0)
    ... def oscillator(stiffness=40.0, speed=0.2):
    ...     mech = bd.Mechanism()
    ...     mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0), velocity=(speed, 0.0)))
    ...     mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), mass.point, stiffness))
    ...     mech.observe("mass", mass.point)
    ...     return mech
    >>> method = bd.GeneralizedAlpha(step=1e-3)
    >>> end = bd.quantities.EndValue("mass.x")
    >>> result = bd.gradient(oscillator, end, ["stiffness", "speed"], method)
    >>> print(f"{result.derivatives['stiffness']:.3e} m per N/m")
    2.481e-03 m per N/m
    """
    is_quantity = isinstance(objective, Quantity)
    if not (is_quantity and all(isinstance(x, Objective) for x in objective.leaves)):
        raise BeamdaeError(
            "gradient: objective must be an Objective such as EndValue('tip.y'), or a weighted sum "
            f"or LargestOf several, got {short_repr(objective)}."
        )
    flat = flatten_model("gradient", model, by, parameters)
    return assess_derivatives(
        estimate_error, lambda: _evaluate(flat, objective, integrator, t_end, start)
    )


def _evaluate(
    flat: FlatModel, objective: Quantity, integrator: Any, t_end: float | None, start: Any
) -> Gradient:
    """Return the result of `gradient` without a check of its errors."""
    method = require_differentiable_method(integrator, DEFAULT_METHOD)
    run = AdjointRun.of(flat, method, start, t_end=t_end)
    values = {x: x.evaluate_run(run.solution) for x in objective.leaves}
    value, weights = objective.differentiate(values)
    derivatives = run.gradient(weights)
    shaped = flat.unflatten(derivatives.tolist())

    def repeat(change: Callable[[Any], Any], method: Any) -> Gradient:
        changed = replace(flat, whole=transform_mechanisms(flat.whole, change))
        return _evaluate(changed, objective, method, t_end, start)

    return Gradient(
        value,
        flat.unflatten(flat.parameters.values()),
        {x: y if isinstance(y, float) else np.array(y) for x, y in shaped.items()},
        run.solution,
        repeat,
    )


@dataclass(eq=False)
class AdjointRun(DifferentiableRun):
    """Run of a model of numbers, from which gradients of several objectives can be computed.

    Raises
    ------
    BeamdaeError
        If the run does not reach its end, or its states need too much memory.
    """

    model: FlatModel

    def __post_init__(self) -> None:
        self.require_end()
        trajectory, equations = self.solution.trajectory, self.solution.equations
        if trajectory.end < self.solution.model["t_end"] and find_stop(self.solution) is None:
            raise BeamdaeError(
                f"{derivative_call()}: the run of {self.model.name} was "
                f"{self.solution.status.sentence}, not by an event of the model; choose an earlier "
                "t_end."
            )
        require_memory(
            derivative_call(),
            f"derivatives with respect to the states of {trajectory.steps} steps",
            COPIES_OF_ROWS * 8.0 * trajectory.steps * (3 * equations.n + equations.m),
            "use longer steps",
        )

    def gradient(self, weights: Mapping[Objective, float]) -> Array:
        """Return the gradient (k,) of a weighted sum of objectives."""
        names, equations = list(self.model.entries), self.solution.equations
        for term in weights:
            header, number, _ = locate_column(equations, term.column)
            if number is not None and equations.observables[number].has_accelerations:
                raise BeamdaeError(
                    f"gradient: the objective must not contain accelerations, got {header}; use a "
                    "velocity, a force or bd.sensitivities."
                )
        with single_threaded:
            result = self._transpose(weights, names) or self._contract(weights, names)
        return np.array([result[x] for x in names])

    def _transpose(
        self, weights: Mapping[Objective, float], names: list[str]
    ) -> dict[str, float] | None:
        """Return the gradient by one backward sweep; None if it does not apply.

        The sweep serves the numbers on which the equations depend through p and the requested start
        alone.
        """
        e = self.solution.equations
        if e.configurations is not None or e.redundant or find_stop(self.solution) is not None:
            return None
        solution = bound_reactions(self.solution)
        start, n, intervals = (
            StartDerivatives(ConsistencySolver(e)),
            e.n,
            solution.trajectory.intervals,
        )
        seeds, matrices = differentiate_objective(weights, solution), Matrices()
        # Between two intervals, a law has a breakpoint: positions and velocities are continuous.
        for k in reversed(range(len(intervals))):
            interval, by_nodes = intervals[k], seeds.states[k]
            by_start, by_p = transpose_steps(self.method, start, interval, by_nodes[1:], matrices)
            by_start[: 2 * n] += by_nodes[0, : 2 * n]
            by_start[3 * n :] += by_nodes[0, 2 * n :]
            v = intervals[k - 1].rows.v[-1] if k else interval.rows.v[0]
            first = node_state(interval, 0)
            by_state, by_numbers = start.gradient(start.start_map(*first, v), by_start)
            seeds.numbers += by_p + by_numbers
            if k:
                seeds.states[k - 1][-1, : 2 * n] += by_state[: 2 * n]
        regular = {name: x for name, x in self.difference(names).items() if is_regular(x, e)}
        first = node_state(self.solution.trajectory.intervals[0], 0)
        starts = differentiate_starts([*regular.values()], *first)
        result = {
            name: seeds.contract(x) + float(by_state[: 2 * n] @ np.hstack(along))
            for (name, x), along in zip(regular.items(), starts, strict=True)
        }
        if others := [x for x in names if x not in result]:
            result |= self._contract(weights, others)
        return result

    def _contract(
        self, weights: Mapping[Objective, float], names: Sequence[str]
    ) -> dict[str, float]:
        """Return the derivatives of a weighted sum of objectives along those of the run."""
        differences, derivatives = self.differentiate(names)
        solution = bound_reactions(self.solution)
        equations, trajectory = solution.equations, solution.trajectory
        along = {name: x.trajectory for name, x in derivatives.items()}
        # Times of restarts and of the end [s], and their derivatives by parameter.
        shifts = np.array([x.shifts for x in derivatives.values()])
        restarts = [float(x.t[0]) for x in trajectory.intervals]
        bounds = [(t, dt) for t, dt in zip(restarts, shifts.T, strict=True) if dt.any()]
        stop = find_stop(solution)
        if stop is not None:
            last = {name: x.intervals[-1] for name, x in along.items()}
            end, interval = trajectory.end, trajectory.intervals[-1]
            by_name = differentiate_event_time(equations, stop, interval, end, last, differences)
            bounds.append((end, np.array([by_name[name] for name in names])))
        grid, result = SampleGrid.of(trajectory), np.zeros(len(names))
        for term, factor in weights.items():
            times = term.sample_times(grid)
            _, number, column = locate_column(equations, term.column)
            values = read_column(solution.at_times(times), term.column)[1]
            value, by_values = term.evaluate(values, grid.weights)
            if number is None:
                states = {name: x.at(times)[1] for name, x in along.items()}
                rows = {name: np.hstack([x.q, x.v, x.lam]) for name, x in states.items()}
            else:
                rows = differentiate_run_columns(
                    equations, trajectory, times, along, differences, [number]
                )
            result += factor * np.array([by_values @ rows[name][:, column] for name in names])
            duration = trajectory.end - trajectory.start
            for t, dt in bounds:
                # The states are those at fixed times, so that at restarts only integrals of columns
                # that jump have a derivative.
                is_end = t == trajectory.end
                sides = np.array([t] if is_end else [t, np.nextafter(t, np.inf)])
                header, at_sides = read_column(solution.at_times(sides), term.column)
                rate = float(differentiate_column(solution, header, sides)[0]) if is_end else 0.0
                before, *after = (
                    term.end_derivative(value, y, rate, duration) for y in at_sides.tolist()
                )
                result += factor * (before - sum(after)) * dt
        return dict(zip(names, result.tolist(), strict=True))
