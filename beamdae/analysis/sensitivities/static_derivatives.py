"""Derivatives of static equations of a load stage along directions and along a parameter.

The equations are R(x; mu, p) = (1 - mu) R_unloaded(x, p) + mu R_loaded(x, p) with x = (q, lam).
They depend on a parameter through the numbers p of both parts. Only these numbers are differenced;
the residual and its tangent are differentiated exactly, by directional derivatives of the kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.sensitivities.model_differences import (
    Difference,
    derivative_call,
    forms_of,
    with_structure,
)
from beamdae.analysis.sensitivities.operator_changes import (
    directional_plan_along,
    moves_operators,
)
from beamdae.analysis.statics.load_scaling import LoadedEquations, interpolate_tangents
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.static_equations import StaticEquations, plan_static_sums
from beamdae.equations.formulations.tangents import (
    Tangent,
    differentiate_tangent,
    plan_tangent,
)
from beamdae.equations.structure import Structure, cache_on_owner, has_same_patterns
from beamdae.errors import BeamdaeError
from beamdae.symbolic.sums.directional_sums import directional_plan
from beamdae.symbolic.sums.kernel_sums import (
    Sum,
    SumPlan,
    evaluate_sum,
    set_matrix_factors,
    set_time,
)

Array = np.ndarray


@cache_on_owner
def _plan_directional_sums(structure: Structure) -> tuple[SumPlan, SumPlan]:
    """Return the directional derivatives of the static residual and of its tangent."""
    sums, size = plan_static_sums(structure), 2 * structure.n + structure.m
    return directional_plan(sums.residual, size), directional_plan(sums.tangent, size)


@dataclass(frozen=True)
class _DirectionalStatics:
    """Directional derivatives of static equations without a load factor.

    `difference` contains the same equations at neighboring values of the parameter; None for
    directions of x alone.
    """

    static: StaticEquations
    difference: Difference | None

    @cached_property
    def numbers(self) -> Array:
        """Derivatives of p, (n_p,)."""
        if self.difference is None:
            return np.zeros_like(self.static.equations.p)
        return np.asarray(self.difference.derivative(lambda e: e.p))

    @cached_property
    def _plans(self) -> tuple[SumPlan, SumPlan]:
        e = self.static.equations
        if self.difference is None or not moves_operators(self.difference):
            return _plan_directional_sums(e.structure)
        size = 2 * e.n + e.m
        return (
            directional_plan_along(
                self.difference, lambda e: plan_static_sums(e.structure).residual, size
            ),
            directional_plan_along(
                self.difference, lambda e: plan_static_sums(e.structure).tangent, size
            ),
        )

    @cached_property
    def _motion_plans(self) -> tuple[SumPlan, SumPlan] | None:
        return plan_tangent_along(self.difference)

    @cached_property
    def _residual(self) -> Sum:
        return self._plans[0].sum(False, self.static.equations.p)

    @cached_property
    def _tangent(self) -> Sum:
        total = self._plans[1].sum(False, self.static.equations.p)
        set_matrix_factors(total, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
        return total

    def residual(self, x: Array, dx: Array) -> Array:
        return self._evaluate(self._residual, x, dx, self.static.size)

    def tangent(self, x: Array, dx: Array) -> sp.csc_array:
        pattern = self.static.pattern
        nonzeros = self._evaluate(self._tangent, x, dx, pattern.nnz)
        return sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)

    def motion_tangent(self, x: Array, dx: Array) -> Tangent:
        e = self.static.equations
        at, along = (State(y[: e.n], np.zeros(e.n), np.zeros(e.n), y[e.n :]) for y in (x, dx))
        return differentiate_tangent(
            e, self.static.time, at, along, self.numbers, self._motion_plans
        )

    def _evaluate(self, total: Sum, x: Array, dx: Array, size: int) -> Array:
        n, result = self.static.equations.n, np.zeros(size)
        velocities = np.zeros(n)
        set_time(total, *self.static.time)
        inputs = [x[:n], velocities, x[n:], dx[:n], velocities, dx[n:], self.numbers]
        evaluate_sum(total, np.concatenate(inputs), result)
        return result


@dataclass(frozen=True)
class LoadDerivatives:
    """Derivatives of the static equations of one load stage with respect to one parameter.

    Attributes
    ----------
    system
        The equations.
    differences
        Equations without and with the loads of the stage at neighboring values of the parameter;
        None for directions of x alone.
    """

    system: LoadedEquations
    differences: tuple[Difference | None, Difference | None] = (None, None)

    @classmethod
    def of(
        cls,
        difference: Difference,
        system: LoadedEquations,
        neighbors: Sequence[LoadedEquations],
    ) -> LoadDerivatives:
        """Return the derivatives, given the equations `neighbors` for the models of `difference`.

        Raises
        ------
        BeamdaeError
            If the parameter changes the structure of the equations.
        """
        unloaded = select_equations(
            difference, system.unloaded.equations, [x.unloaded.equations for x in neighbors]
        )
        loaded = unloaded
        if system.has_scaled_loads:
            loaded = select_equations(
                difference, system.loaded.equations, [x.loaded.equations for x in neighbors]
            )
        is_same = unloaded.base is system.unloaded.equations
        if not (is_same and loaded.base is system.loaded.equations):
            first, last = (StaticEquations(x.base, system.loaded.time) for x in (unloaded, loaded))
            system = LoadedEquations(first, last if system.has_scaled_loads else first)
        return cls(system, (unloaded, loaded))

    @cached_property
    def _parts(self) -> tuple[_DirectionalStatics, _DirectionalStatics]:
        unloaded, loaded = self.differences
        return (
            _DirectionalStatics(self.system.unloaded, unloaded),
            _DirectionalStatics(self.system.loaded, loaded),
        )

    def residual(self, x: Array, mu: float) -> tuple[Array, Array]:
        """Return dR/dparameter at constant x, and its derivative with respect to mu, (n + m,)."""
        unloaded, loaded = (part.residual(x, np.zeros_like(x)) for part in self._parts)
        return (1.0 - mu) * unloaded + mu * loaded, loaded - unloaded

    def tangent(self, x: Array, mu: float, dx: Array) -> sp.csc_array:
        """Return the change of the tangent R_x along dx and the parameter at constant mu."""
        unloaded, loaded = (part.tangent(x, dx) for part in self._parts)
        return sp.csc_array((1.0 - mu) * unloaded + mu * loaded)

    def motion_tangent(self, x: Array, mu: float, dx: Array) -> Tangent:
        """Return the change of `LoadedEquations.motion_tangent` along dx and the parameter."""
        unloaded, loaded = (part.motion_tangent(x, dx) for part in self._parts)
        return interpolate_tangents(unloaded, loaded, mu)

    def tangent_by_factor(self, x: Array) -> sp.csc_array:
        """Return the derivative of the tangent with respect to mu."""
        unloaded, loaded = (
            part.matrix(*np.split(x, [part.equations.n]))
            for part in (self.system.unloaded, self.system.loaded)
        )
        return sp.csc_array(loaded - unloaded)


def plan_tangent_along(difference: Difference | None) -> tuple[SumPlan, SumPlan] | None:
    """Return the plans for `differentiate_tangent` if the parameter moves operators of joints."""
    if difference is None or not moves_operators(difference):
        return None
    size = 2 * (2 * difference.base.n + difference.base.m)
    return (
        directional_plan_along(difference, lambda e: plan_tangent(e.structure)[0], size),
        directional_plan_along(difference, lambda e: plan_tangent(e.structure)[1], size),
    )


def select_equations(
    difference: Difference, base: EquationsOfMotion, neighbors: Sequence[EquationsOfMotion]
) -> Difference:
    """Return the difference of equations of some of the parts of the models of `difference`.

    Its base contains all forces of the neighboring models.

    Raises
    ------
    BeamdaeError
        If the parameter changes the structure of the equations.
    """
    first, part = neighbors[0], replace(difference, base=base, equations=tuple(neighbors))
    is_moved = any(e.structure != first.structure for e in neighbors)
    is_possible = all(e.lam_names == base.lam_names for e in neighbors)
    if is_moved and is_possible:
        is_possible = all(
            has_same_patterns(e.structure, first.structure) for e in (base, *neighbors)
        )
    if not is_possible:
        raise BeamdaeError(
            f"{derivative_call()}: {difference.name} changes the structure of the equations; use "
            "differences of results for this parameter."
        )
    is_changed = base.structure != first.structure or forms_of(base) != forms_of(first)
    if not is_moved and is_changed:
        part = replace(part, base=with_structure(base, neighbors, part.steps))
    return part
