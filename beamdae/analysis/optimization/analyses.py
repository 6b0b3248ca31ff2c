"""Analyses of a model at values of its parameters, with the derivatives of their quantities."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.eigenproblems.eigensolution import RIGID
from beamdae.analysis.gradients.flat_model import FlatModel
from beamdae.analysis.gradients.gradients import DEFAULT_METHOD, AdjointRun
from beamdae.analysis.gradients.objectives import (
    RUN,
    AnalysisQuantity,
    Objective,
    SampleGrid,
    SmoothMaximum,
)
from beamdae.analysis.linear_dynamics.linearization import REFERENCE
from beamdae.analysis.linear_dynamics.natural_modes import Modes, compute_modes
from beamdae.analysis.optimization.quantities import (
    EQUILIBRIUM_PATH,
    MASS,
    MODES,
    PARAMETERS,
    CriticalLoad,
    EquilibriumErrors,
    EquilibriumQuantity,
    Frequency,
    Mass,
    ParameterFunction,
)
from beamdae.analysis.sensitivities.differentiable_run import require_differentiable_method
from beamdae.analysis.sensitivities.modes import differentiate_modes
from beamdae.analysis.sensitivities.neighbors import (
    STENCILS,
    Difference,
    Neighbors,
    difference_models,
    first_difference,
)
from beamdae.analysis.sensitivities.observable_derivatives import read_column
from beamdae.analysis.sensitivities.statics import differentiate_path
from beamdae.analysis.statics.static_equilibrium import equilibrium
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.equations.starts.steady_rotation import RotatingCoordinates
from beamdae.errors import BeamdaeError, as_real, short_repr
from beamdae.integrators import Integrator
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM
from beamdae.results.columns import require_one_column
from beamdae.results.equilibrium import Equilibrium
from beamdae.simulation import as_equations

Array = np.ndarray

_NAME = "optimize"

as_drawn = partial(as_equations, _NAME, start=AS_DRAWN)


@dataclass(frozen=True)
class RunSettings:
    """Arguments of all runs of an optimization; see `simulate`."""

    integrator: Integrator | None
    t_end: float | None
    start: Any


@dataclass(frozen=True, eq=False)
class DesignModel:
    """Model at values of its parameters, which the analyses of a design share.

    Attributes
    ----------
    flat
        The model as a function of single numbers.
    """

    flat: FlatModel

    @cached_property
    def mechanism(self) -> Any:
        """Mechanism that the model function returns."""
        return self.flat()

    @cached_property
    def equations(self) -> EquationsOfMotion:
        """Equations of the model as drawn."""
        return as_drawn(self.mechanism)

    @cached_property
    def differences(self) -> dict[str, Difference]:
        """Models around the value of each number, by its name."""
        return difference_models(self.flat, list(self.flat.entries), self.equations, as_drawn)


class Analysis(NamedTuple):
    """One analysis of a model at values of its parameters.

    Attributes
    ----------
    result
        Result of the analysis, None if there is none.
    values
        Values of its quantities.
    gradient
        Function that returns the gradient (k,) of a weighted sum of quantities.
    maxima
        Function that returns the values, with the maximum over the run for smooth maxima.
    """

    result: Any
    values: dict[Any, float]
    gradient: Callable[[Mapping[Any, float]], Array]
    maxima: Callable[[], dict[Any, float]] | None = None


def _analyze_run(
    model: DesignModel, quantities: Sequence[Objective], settings: RunSettings
) -> Analysis:
    """Integrate the model; gradients by the adjoint take one backward sweep per call."""
    method = require_differentiable_method(settings.integrator, DEFAULT_METHOD)
    run = AdjointRun.of(model.flat, method, settings.start, t_end=settings.t_end)
    solution = run.solution
    values = {x: x.evaluate_run(solution) for x in quantities}

    def differentiate(weights: Mapping[Objective, float]) -> Array:
        if solution.equations.start is None:
            run.neighbors |= model.differences
        return run.gradient(weights)

    def find_maxima() -> dict[Any, float]:
        smooth = [x for x in quantities if isinstance(x, SmoothMaximum)]
        samples = solution.at_times(SampleGrid.of(solution.trajectory).t)
        columns = {x: read_column(samples, x.column)[1] for x in smooth}
        return values | {x: float(np.max(np.abs(y))) for x, y in columns.items()}

    return Analysis(solution, values, differentiate, find_maxima)


def _analyze_path(
    model: DesignModel, quantities: Sequence[EquilibriumQuantity], settings: RunSettings
) -> Analysis:
    """Follow an equilibrium path, see `equilibrium_sensitivities`."""
    flat, names = model.flat, list(model.flat.entries)
    path = equilibrium(model.mechanism, **quantities[0].path, start=settings.start)
    if not path.status.success:
        raise BeamdaeError(
            f"{_NAME}: the equilibrium path of {flat.name} did not reach its end "
            f"({path.status.sentence})."
        )
    path = replace(path, model={"name": flat.name, "parameters": flat.whole.parameters})
    values, rows, factors = {}, {}, {}
    for quantity in quantities:
        values[quantity], rows[quantity], factors[quantity] = _read_path(path, quantity, flat.name)

    @cache
    def compute_sensitivities() -> Any:
        needed = np.unique(np.concatenate(list(rows.values()))).tolist()
        return differentiate_path(flat, names, path, needed, model.differences)

    def differentiate(weights: Mapping[Any, float]) -> Array:
        result, along = np.zeros(len(names)), compute_sensitivities()
        for quantity, weight in weights.items():
            for k, name in enumerate(names):
                if isinstance(quantity, CriticalLoad):
                    rates = np.sum(along.factors[name], axis=1)
                else:
                    rates = along.sensitivity(quantity.column, name).to_numpy()
                result[k] += weight * float(factors[quantity] @ rates[rows[quantity]])
        return result

    return Analysis(path, values, differentiate)


def _read_path(path: Equilibrium, quantity: Any, name: str) -> tuple[float, Array, Array]:
    """Return a value, the rows of the path from which it is read, and its derivatives."""
    if isinstance(quantity, CriticalLoad):
        if len(path.critical) < quantity.number:
            raise BeamdaeError(
                f"{_NAME}: the equilibrium path of {name} to load factor {path.factor:g} has "
                f"{len(path.critical)} critical points, but {quantity.label} is requested; "
                "increase to=."
            )
        point = path.critical[quantity.number - 1]
        return float(point.factor), np.array([point.row]), np.ones(1)
    column: Any = path[quantity.column]
    if column.ndim > 1:
        require_one_column(_NAME, quantity.column, list(column))
    if column.ndim != 1 or column.dtype == object:
        raise BeamdaeError(
            f"{_NAME}: {quantity.column!r} must name a single column of numbers of the equilibrium."
        )
    if not isinstance(quantity, EquilibriumErrors):
        return float(column.to_numpy()[-1]), np.array([len(path.q) - 1]), np.ones(1)
    reached = path.factors[:, -1]
    if isinstance(quantity.to, Mapping):
        reached = path[next(iter(quantity.to))].to_numpy()
    rows = np.argmin(np.abs(reached[:, None] - quantity.targets), axis=0)
    errors = (column.to_numpy()[rows] - quantity.values) / quantity.sigma
    return float(errors @ errors), rows, 2.0 * errors / quantity.sigma


def _analyze_modes(
    model: DesignModel, quantities: Sequence[Frequency], settings: RunSettings
) -> Analysis:
    """Compute natural modes without damping."""
    flat, number = model.flat, max(x.number for x in quantities)
    given = quantities[0].about
    for about in [given] if given else [REFERENCE, EQUILIBRIUM]:
        modes = _compute_vibrations(model.mechanism, about, number)
        # The loads of the model are balanced in the state of the modes.
        if is_balanced := not modes._linearization.zero_square > 0.0:
            break
    vibrations, values = list_vibrations(modes), {}
    for x in quantities:
        if len(vibrations) < x.number:
            raise BeamdaeError(
                f"{_NAME}: {flat.name} has {len(vibrations)} natural frequencies above zero, but "
                f"{x.label} is requested."
            )
        values[x] = float(modes.frequencies[vibrations[x.number - 1]])

    @cache
    def compute_sensitivities() -> Any:
        if not is_balanced:
            raise BeamdaeError(
                f"{_NAME}: frequencies about the {about} of {flat.name} cannot be differentiated, "
                "because its loads are not balanced there; use "
                "Frequency(number, about='equilibrium')."
            )
        return differentiate_modes(flat, list(flat.entries), modes, about, False, 0.0)

    def differentiate(weights: Mapping[Frequency, float]) -> Array:
        rows, factors = [vibrations[x.number - 1] for x in weights], np.array([*weights.values()])
        columns = (compute_sensitivities().sensitivity("frequency", x) for x in flat.entries)
        return np.array([factors @ column.to_numpy()[rows] for column in columns])

    return Analysis(modes, values, differentiate)


def _analyze_mass(
    model: DesignModel, quantities: Sequence[Mass], settings: RunSettings
) -> Analysis:
    """Compute the mass of the model from its mass matrix."""

    def differentiate(weights: Mapping[Mass, float]) -> Array:
        rates = [x.along(compute_mass) for x in model.differences.values()]
        return sum(weights.values()) * np.array(rates)

    mass = compute_mass(model.equations)
    return Analysis(None, dict.fromkeys(quantities, mass), differentiate)


def _analyze_parameters(
    model: DesignModel, quantities: Sequence[ParameterFunction], settings: RunSettings
) -> Analysis:
    """Evaluate functions of the parameters alone."""

    def evaluate(quantity: ParameterFunction, parameters: Mapping[str, Any]) -> float:
        value = quantity.call(parameters)
        number = as_real(value)
        if number is None:
            raise BeamdaeError(
                f"{_NAME}: {quantity.label} must return a number, got {short_repr(value)}."
            )
        return number

    def differentiate(weights: Mapping[ParameterFunction, float]) -> Array:
        """Return the gradient, NaN where a function is not defined on either side."""
        result = np.full(len(model.flat.entries), np.nan)
        for k, (name, value) in enumerate(model.flat.parameters.items()):
            for stencil in STENCILS:
                near = Neighbors((), stencil, first_difference(value))
                with suppress(ValueError, ArithmeticError), np.errstate(all="ignore"):
                    moved = [model.flat.change({name: value + x}) for x in near.steps]
                    values = [sum(w * evaluate(x, y) for x, w in weights.items()) for y in moved]
                    if np.all(np.isfinite(values)):
                        result[k] = near.combine(values)
                        break
        return result

    parameters = model.flat.whole.parameters
    return Analysis(None, {x: evaluate(x, parameters) for x in quantities}, differentiate)


ANALYSES: dict[str, Callable[..., Analysis]] = {
    RUN: _analyze_run,
    EQUILIBRIUM_PATH: _analyze_path,
    MODES: _analyze_modes,
    MASS: _analyze_mass,
    PARAMETERS: _analyze_parameters,
}


def create_analysis(
    model: DesignModel, quantities: Sequence[AnalysisQuantity], settings: RunSettings
) -> Analysis:
    """Perform the analysis of some quantities, which share it."""
    return ANALYSES[quantities[0].analysis[0]](model, quantities, settings)


def _compute_vibrations(mechanism: Any, about: str, number: int) -> Modes:
    """Return modes of which `number` are vibrations; fewer if there are no more."""
    count = number
    while True:
        modes = compute_modes(mechanism, about, count, damping=False)
        missing = number - len(list_vibrations(modes))
        if missing <= 0 or len(modes) < count:
            return modes
        count += missing


def list_vibrations(modes: Modes) -> list[int]:
    """Return the indices of the modes that are not free motions."""
    return [k for k, kind in enumerate(modes.kinds) if kind != RIGID]


def compute_mass(equations: EquationsOfMotion) -> float:
    """Return the mass of the moving parts [kg], r^T M r for a unit translation r."""
    translation = RotatingCoordinates.from_equations(equations).translations[:, 0]
    matrix = StateEvaluator(equations).mass_matrix(np.zeros(2), equations.q0)
    return float(translation @ (matrix @ translation))
