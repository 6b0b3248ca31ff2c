"""Runs that are differentiated, and their integrators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self, TypeVar

import numpy as np

from beamdae import deferred
from beamdae.analysis.sensitivities.neighbors import (
    Difference,
    NumericModel,
    derivative_call,
    difference_models,
)
from beamdae.analysis.sensitivities.run_chain import (
    RunDerivative,
    assemble_neighbors,
    differentiate_states,
)
from beamdae.errors import (
    BeamdaeError,
    require_choice,
    short_repr,
    warn_user,
    warnings_are_ignored,
)
from beamdae.integrators import Auto, GeneralizedAlpha, Integrator, Radau
from beamdae.interrupts import keep_result
from beamdae.parts.mechanism import AS_DRAWN, require_start
from beamdae.results.solution import Solution
from beamdae.simulation import as_equations, is_unchecked, simulate, unchecked

Array = np.ndarray

Result = TypeVar("Result")
# With the default tolerance of 1e-6, Newton errors of runs led to errors of derivatives of up to
# 1e-4; with this tolerance, they are limited by rounding errors.
_NEWTON_TOLERANCE = 1e-10
# Reason of interrupts after which only the estimate of the error is missing.
_INTERRUPTED_ESTIMATE = "interrupted while the error of the derivatives was estimated"
# Errors of derivatives are larger than those of the motion.
DERIVATIVE_METHOD = Radau(rtol=1e-5)


def require_differentiable_method(
    integrator: Any, default: GeneralizedAlpha | Radau = DERIVATIVE_METHOD
) -> GeneralizedAlpha | Radau:
    """Return the integrator of a run that is differentiated: Radau for Auto.

    Newton errors of generalized-alpha are reduced.

    Raises
    ------
    BeamdaeError
        If runs of the integrator cannot be differentiated.
    """
    method = default if integrator is None else integrator
    if isinstance(method, Auto):
        return Radau(**{x.name: getattr(method, x.name) for x in fields(method)})
    if isinstance(method, Radau):
        return method
    if not isinstance(method, GeneralizedAlpha):
        # A sequence of steps of variable order cannot be replayed.
        name = type(method).__name__ if isinstance(method, Integrator) else short_repr(method)
        raise BeamdaeError(
            f"{derivative_call()}: runs of {name} cannot be differentiated; use Radau or "
            "GeneralizedAlpha."
        )
    if method.formulation != "index3":
        raise BeamdaeError(
            f"{derivative_call()}: GeneralizedAlpha must have formulation='index3', got "
            f"{short_repr(method)}."
        )
    return replace(method, newton_tolerance=min(method.newton_tolerance, _NEWTON_TOLERANCE))


@dataclass(eq=False)
class DifferentiableRun:
    """Run of a model, and its derivatives by parameter as soon as they are needed.

    Attributes
    ----------
    model, method
        The model, and the integrator of the run.
    settings
        Further arguments of the run, see `simulate`.
    solution
        The run.
    neighbors
        Models around the values of parameters, as far as they are known.
    """

    model: NumericModel
    method: GeneralizedAlpha | Radau
    settings: dict[str, Any]
    solution: Solution
    neighbors: dict[str, Difference] = field(default_factory=dict, init=False)
    _along: dict[str, RunDerivative] = field(default_factory=dict, init=False)

    @classmethod
    def of(
        cls, model: Any, method: GeneralizedAlpha | Radau, start: Any = None, **settings: Any
    ) -> Self:
        """Integrate a model.

        Raises
        ------
        BeamdaeError
            If the start is a result, or the model has a sampled controller.
        """
        mechanism = model()
        start = None if start is None else require_start(derivative_call(), start)
        # Rejects sampled controllers; the run computes the start, such as an equilibrium.
        as_equations(derivative_call(), mechanism, AS_DRAWN)
        settings |= {"start": start, "keep_steps": True}
        return cls(model, method, settings, simulate(mechanism, method, **settings))

    def repeat(self, model: Any, method: GeneralizedAlpha | Radau) -> Self:
        """Return the run of another model by another integrator."""
        return self.of(model, method, **self.settings | {"progress": None, "partial": "raise"})

    def require_end(self) -> None:
        """Reject a run that did not reach its end."""
        status = self.solution.status
        if not status.success:
            raise BeamdaeError(
                f"{derivative_call()}: the run of {self.model.name} did not reach its end "
                f"({status.sentence}); differentiate a shorter run, or change the integrator."
            )

    def differentiate(
        self, names: Sequence[str]
    ) -> tuple[dict[str, Difference], dict[str, RunDerivative]]:
        """Return the models around the values of parameters, and the derivatives of the run."""
        self.require_end()
        differences = self.difference(names)
        missing = {name: x for name, x in differences.items() if name not in self._along}
        if missing:
            self._along |= differentiate_states(self.solution, self.method, missing)
        return differences, {x: self._along[x] for x in names}

    def difference(self, names: Sequence[str]) -> dict[str, Difference]:
        """Return the models around the values of parameters."""
        equations = self.solution.equations
        if missing := [x for x in names if x not in self.neighbors]:
            assemble = assemble_neighbors(equations, self.settings["start"])
            self.neighbors |= difference_models(self.model, missing, equations, assemble)
        return {x: self.neighbors[x] for x in names}


def assess_derivatives(estimate_error: Any, compute: Callable[[], Result]) -> Result:
    """Return derivatives, and issue warnings of their errors unless these are not estimated.

    Raises
    ------
    Interrupted
        With the derivatives, if only the estimate was interrupted.
    """
    call = derivative_call()
    require_choice(call, "estimate_error", estimate_error, (True, False))
    with nullcontext() if estimate_error else unchecked():
        result = compute()
    if estimate_error:
        with keep_result(result, call, _INTERRUPTED_ESTIMATE):
            warn_of_errors(result)
    return result


def warn_of_errors(result: Any) -> None:
    """Measure the errors of `Sensitivities` or a `Gradient`, unless this takes long, and warn."""
    if is_unchecked() or warnings_are_ignored():
        return
    for sentence in deferred.module("accuracy.runs").check_errors(result, result.solution):
        warn_user(f"{derivative_call()}: {sentence}")
