"""Analyses of a model at values of its parameters, with the derivatives of their quantities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

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
from beamdae.analysis.sensitivities.many_parameters import difference_models
from beamdae.analysis.sensitivities.modes import differentiate_modes
from beamdae.analysis.sensitivities.neighbors import (
    STENCILS,
    Difference,
    Neighbors,
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
from beamdae.simulation import as_equations

Array = np.ndarray

_NAME = "optimize"
# Free motions that are computed before the first vibration, at most.
_MAX_FREE_MOTIONS = 64

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


class Analysis:
    """One analysis of a model at values of its parameters; base class.

    Attributes
    ----------
    result
        Result of the analysis, None if there is none.
    """

    result: Any = None

    def value(self, quantity: Any) -> float:
        """Return the value of a quantity of the analysis."""
        raise NotImplementedError

    def maximum(self, quantity: Any) -> float:
        """Return the maximum over the run of a smooth maximum, and the value of others."""
        return self.value(quantity)

    def gradient(self, weights: Mapping[Any, float]) -> Array:
        """Return the gradient (k,) of a weighted sum of quantities."""
        raise NotImplementedError


class RunAnalysis(Analysis):
    """A run; gradients by the adjoint, one backward sweep per call."""

    def __init__(
        self, model: DesignModel, quantities: Sequence[Any], settings: RunSettings
    ) -> None:
        method = require_differentiable_method(settings.integrator, DEFAULT_METHOD)
        self._model = model
        self._run = AdjointRun.of(model.flat, method, settings.start, t_end=settings.t_end)
        self.result = self._run.solution

    def value(self, quantity: Objective) -> float:
        """See `Analysis`."""
        return quantity.evaluate_run(self.result)

    def maximum(self, quantity: Objective) -> float:
        """See `Analysis`."""
        if not isinstance(quantity, SmoothMaximum):
            return self.value(quantity)
        samples = self.result.at_times(SampleGrid.of(self.result.trajectory).t)
        return float(np.max(np.abs(read_column(samples, quantity.column)[1])))

    def gradient(self, weights: Mapping[Objective, float]) -> Array:
        """See `Analysis`."""
        if self.result.equations.start is None:
            self._run.neighbors |= self._model.differences
        return self._run.gradient(weights)


class PathAnalysis(Analysis):
    """An equilibrium path, see `equilibrium_sensitivities`."""

    def __init__(
        self, model: DesignModel, quantities: Sequence[EquilibriumQuantity], settings: RunSettings
    ) -> None:
        self._model, flat = model, model.flat
        path = equilibrium(model.mechanism, **quantities[0].path, start=settings.start)
        if not path.status.success:
            raise BeamdaeError(
                f"{_NAME}: the equilibrium path of {flat.name} did not reach its end "
                f"({path.status.sentence})."
            )
        self.result = replace(path, model={"name": flat.name, "parameters": flat.whole.parameters})
        self._quantities = quantities

    def value(self, quantity: EquilibriumQuantity) -> float:
        """See `Analysis`."""
        return self._read(quantity)[0]

    def gradient(self, weights: Mapping[EquilibriumQuantity, float]) -> Array:
        """See `Analysis`."""
        result, along = np.zeros(len(self._model.flat.entries)), self._sensitivities
        for quantity, weight in weights.items():
            _, rows, factors = self._read(quantity)
            for k, name in enumerate(self._model.flat.entries):
                if isinstance(quantity, CriticalLoad):
                    rates = np.sum(along.factors[name], axis=1)
                else:
                    rates = along.sensitivity(quantity.column, name).to_numpy()  # type: ignore[attr-defined]
                result[k] += weight * float(factors @ rates[rows])
        return result

    def _read(self, quantity: Any) -> tuple[float, Array, Array]:
        """Return a value, the rows of the path from which it is read, and its derivatives."""
        path = self.result
        if isinstance(quantity, CriticalLoad):
            if len(path.critical) < quantity.number:
                raise BeamdaeError(
                    f"{_NAME}: the equilibrium path of {self._model.flat.name} to load factor "
                    f"{path.factor:g} has {len(path.critical)} critical points, but "
                    f"{quantity.label} is requested; increase to=."
                )
            point = path.critical[quantity.number - 1]
            return float(point.factor), np.array([point.row]), np.ones(1)
        column = path[quantity.column]
        if column.ndim > 1:
            require_one_column(_NAME, quantity.column, list(column))
        if column.ndim != 1 or column.dtype == object:
            raise BeamdaeError(
                f"{_NAME}: {quantity.column!r} must name a single column of numbers of the "
                "equilibrium."
            )
        rows = np.array([len(path.q) - 1])
        if not isinstance(quantity, EquilibriumErrors):
            return float(column.to_numpy()[-1]), rows, np.ones(1)
        reached = path.factors[:, -1]
        if isinstance(quantity.to, Mapping):
            reached = path[next(iter(quantity.to))].to_numpy()
        rows = np.argmin(np.abs(reached[:, None] - quantity.targets), axis=0)
        errors = (column.to_numpy()[rows] - quantity.values) / quantity.sigma
        return float(errors @ errors), rows, 2.0 * errors / quantity.sigma

    @cached_property
    def _sensitivities(self) -> Any:
        rows = np.unique(np.concatenate([self._read(x)[1] for x in self._quantities])).tolist()
        names, known = list(self._model.flat.entries), self._model.differences
        return differentiate_path(self._model.flat, names, self.result, rows, known)


class ModeAnalysis(Analysis):
    """Natural modes without damping."""

    def __init__(
        self, model: DesignModel, quantities: Sequence[Frequency], settings: RunSettings
    ) -> None:
        self._flat, about = model.flat, quantities[0].about
        number = max(x.number for x in quantities)
        self._about = about or REFERENCE
        self.result = _compute_vibrations(model.mechanism, self._about, number)
        if about is None and not self._is_balanced:
            self._about = EQUILIBRIUM
            self.result = _compute_vibrations(model.mechanism, self._about, number)

    @property
    def _is_balanced(self) -> bool:
        """True if the loads of the model are balanced in the state of the modes."""
        return not self.result._linearization.zero_square > 0.0

    def _row(self, quantity: Frequency) -> int:
        vibrations = list_vibrations(self.result)
        if len(vibrations) < quantity.number:
            raise BeamdaeError(
                f"{_NAME}: {self._flat.name} has {len(vibrations)} natural frequencies above zero, "
                f"but {quantity.label} is requested."
            )
        return vibrations[quantity.number - 1]

    def value(self, quantity: Frequency) -> float:
        """See `Analysis`."""
        return float(self.result.frequencies[self._row(quantity)])

    def gradient(self, weights: Mapping[Frequency, float]) -> Array:
        """See `Analysis`."""
        rows, factors = [self._row(x) for x in weights], np.array(list(weights.values()))
        columns = (self._sensitivities.sensitivity("frequency", x) for x in self._flat.entries)
        return np.array([factors @ column.to_numpy()[rows] for column in columns])

    @cached_property
    def _sensitivities(self) -> Any:
        if not self._is_balanced:
            raise BeamdaeError(
                f"{_NAME}: frequencies about the {self._about} of {self._flat.name} cannot be "
                "differentiated, because its loads are not balanced there; use "
                "Frequency(number, about='equilibrium')."
            )
        names = list(self._flat.entries)
        return differentiate_modes(self._flat, names, self.result, self._about, False, 0.0)


class MassAnalysis(Analysis):
    """Mass of the model, from its mass matrix."""

    def __init__(
        self, model: DesignModel, quantities: Sequence[Mass], settings: RunSettings
    ) -> None:
        self._model = model

    def value(self, quantity: Mass) -> float:
        """See `Analysis`."""
        return compute_mass(self._model.equations)

    def gradient(self, weights: Mapping[Mass, float]) -> Array:
        """See `Analysis`."""
        rates = [x.along(compute_mass) for x in self._model.differences.values()]
        return sum(weights.values()) * np.array(rates)


class ParameterAnalysis(Analysis):
    """Functions of the parameters alone."""

    def __init__(
        self, model: DesignModel, quantities: Sequence[ParameterFunction], settings: RunSettings
    ) -> None:
        self._flat = model.flat

    def value(self, quantity: ParameterFunction) -> float:
        """See `Analysis`."""
        return self._evaluate(quantity, self._flat.whole.parameters)

    def gradient(self, weights: Mapping[ParameterFunction, float]) -> Array:
        """See `Analysis`; NaN where a function is not defined on either side."""
        result = np.full(len(self._flat.entries), np.nan)
        for k, (name, value) in enumerate(self._flat.parameters.items()):
            for stencil in STENCILS:
                near = Neighbors((), stencil, first_difference(value))
                with suppress(ValueError, ArithmeticError), np.errstate(all="ignore"):
                    moved = [self._flat.change({name: value + x}) for x in near.steps]
                    values = [
                        sum(w * self._evaluate(x, y) for x, w in weights.items()) for y in moved
                    ]
                    if np.all(np.isfinite(values)):
                        result[k] = near.combine(values)
                        break
        return result

    @staticmethod
    def _evaluate(quantity: ParameterFunction, parameters: Mapping[str, Any]) -> float:
        value = quantity.call(parameters)
        number = as_real(value)
        if number is None:
            raise BeamdaeError(
                f"{_NAME}: {quantity.label} must return a number, got {short_repr(value)}."
            )
        return number


ANALYSES: dict[str, type[Any]] = {
    RUN: RunAnalysis,
    EQUILIBRIUM_PATH: PathAnalysis,
    MODES: ModeAnalysis,
    MASS: MassAnalysis,
    PARAMETERS: ParameterAnalysis,
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
        if missing <= 0 or len(modes) < count or count > number + _MAX_FREE_MOTIONS:
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
