"""Equations linearized about a state: M x'' + C x' + K x + H mu = 0, J x + V x' = 0.

x and mu are increments of the coordinates and of the multipliers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import (
    FirstOrderForm,
    formulate_first_order,
    plan_residual,
)
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.symbolic.sums.kernel_sums import SumPlan, evaluate_sum, set_time
from beamdae.symbolic.sums.sum_derivatives import directional_plan

Array = np.ndarray


Convert = Callable[[EquationsOfMotion], EquationsOfMotion]


class Tangent(NamedTuple):
    """Derivatives of F + G^T lam and of the constraints at one state.

    Attributes
    ----------
    mass, damping, stiffness
        Derivatives of F + G^T lam with respect to a, v and q, sparse (n, n) each.
    reactions
        Derivative of F + G^T lam with respect to lam, (n, m): G^T, plus the dependence of friction
        on reactions.
    position_jacobian
        Derivative of g, or of a nonholonomic constraint, with respect to q, (m, n).
    velocity_jacobian
        Derivative of nonholonomic constraints with respect to v, (m, n); the rows of holonomic
        constraints are zero.
    residual
        F + G^T lam and the constraints, (n + m,).
    """

    mass: sp.csc_array
    damping: sp.csc_array
    stiffness: sp.csc_array
    reactions: sp.csc_array
    position_jacobian: sp.csc_array
    velocity_jacobian: sp.csc_array
    residual: Array

    def acceleration_jacobian(self, e: EquationsOfMotion) -> sp.csc_array:
        """Return the matrix (m, n) that multiplies a in the differentiated constraints.

        Holonomic constraints are differentiated twice, nonholonomic constraints once. `e` are the
        equations of the tangent.
        """
        holonomic = np.ones(e.m)
        holonomic[e.nonholonomic_rows] = 0.0
        return sp.csc_array(
            sp.diags_array(holonomic) @ self.position_jacobian + self.velocity_jacobian
        )


def compute_tangent(e: EquationsOfMotion, time: Array, state: State) -> Tangent:
    """Return the `Tangent` at a state and `time` = (t, branch), exact up to rounding."""
    form = _formulate(e)
    y, rates = form.pack(state)
    return _create_tangent(form, form.jacobian(time, y, rates), form.residual(time, y, rates))


def compute_residual(e: EquationsOfMotion, time: Array, state: State) -> Array:
    """Return the residual of the `Tangent`."""
    form = _formulate(e)
    return form.residual(time, *form.pack(state))[e.n :]


def tangent_of(
    e: EquationsOfMotion, time: Array, state: State, convert: Convert | None = None
) -> Tangent:
    """Return the `Tangent` of converted equations."""
    return compute_tangent(convert(e) if convert else e, time, state)


def differentiate_residual(e: EquationsOfMotion, time: Array, state: State, dp: Array) -> Array:
    """Return the derivative of the residual of the `Tangent` along a direction of p.

    It is exact up to rounding.
    """
    form, zeros = _formulate(e), State(*map(np.zeros_like, state))
    inputs, result = np.concatenate([*form.pack(state), *form.pack(zeros), dp]), np.zeros(form.size)
    total = _plan_directional_residual(e.structure).sum(False, e.p)
    set_time(total, *time)
    evaluate_sum(total, inputs, result)
    return result[e.n :]


def _formulate(e: EquationsOfMotion) -> FirstOrderForm:
    return formulate_first_order(e, "index3", apart=True)


@cache_on_owner
def _plan_directional_residual(structure: Structure) -> SumPlan:
    plan, size = plan_residual(structure, "index3"), 2 * (2 * structure.n + structure.m)
    return directional_plan(plan, size)


def _create_tangent(form: FirstOrderForm, nonzeros: Array, residual: Array) -> Tangent:
    """Return the matrices from the non-zeros of dR/dy and of dR/dy'."""
    e, pattern = form.equations, form.pattern
    by_y, by_rates = (
        sp.csc_array((x, pattern.indices, pattern.indptr), shape=pattern.shape).tocsr()
        for x in np.split(nonzeros, 2)
    )
    q, v, lam = slice(0, e.n), slice(e.n, 2 * e.n), slice(2 * e.n, form.size)
    return Tangent(
        mass=sp.csc_array(by_rates[v][:, v]),
        damping=sp.csc_array(by_y[v][:, v]),
        stiffness=sp.csc_array(by_y[v][:, q]),
        reactions=sp.csc_array(by_y[v][:, lam]),
        position_jacobian=sp.csc_array(by_y[lam][:, q]),
        velocity_jacobian=sp.csc_array(by_y[lam][:, v]),
        residual=residual[e.n :],
    )
