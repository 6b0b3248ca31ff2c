"""From equations of motion to the residuals of first-order forms, see `first_order_sums`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.first_order_sums import (
    FIRST_ORDER,
    FORMULATIONS,
    Formulation,
    jacobian_sum,
    residual_plan,
)
from beamdae.equations.structure import once
from beamdae.errors import require_choice
from beamdae.native.vectors import combine, fill
from beamdae.symbolic.kernel_sums import Sum, SumPlan, evaluate

Array = np.ndarray


class State(NamedTuple):
    """Rows of a trajectory: coordinates, velocities, accelerations and multipliers."""

    q: Array
    v: Array
    a: Array
    lam: Array


@dataclass(frozen=True)
class FirstOrder:
    """Residual R(t, y, y') of a first-order form with its exact Jacobian.

    Attributes
    ----------
    pattern
        CSC pattern of the Jacobian.
    sums
        Of the residual and of the Jacobian, from (y, y').
    """

    equations: EquationsOfMotion
    formulation: Formulation
    pattern: sp.csc_array
    sums: tuple[SumPlan, SumPlan]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.pattern.shape[0]

    @property
    def _parts(self) -> tuple[slice, slice, slice]:
        n, m = self.equations.n, self.equations.m
        return slice(0, n), slice(n, 2 * n), slice(2 * n, 2 * n + m)

    def pack(self, state: State) -> tuple[Array, Array]:
        """Consistent (y, y') of a consistent state."""
        q, v, lam = self._parts
        y, yp = np.zeros(self.size), np.zeros(self.size)
        y[q], y[v], yp[q], yp[v] = state.q, state.v, state.v, state.a
        (yp if self.formulation.impulses else y)[lam] = state.lam
        return y, yp

    def unpack(self, y: Array, yp: Array) -> State:
        """State of (y, y'), for one row or many."""
        q, v, lam = self._parts
        multipliers = yp if self.formulation.impulses else y
        return State(y[..., q], y[..., v], yp[..., v], multipliers[..., lam])

    @cached_property
    def _own(self) -> FirstOrderSums:
        return self.buffers()

    def residual(self, time: Array, y: Array, yp: Array) -> Array:
        """R at time = (t, branch), for whoever needs it once; runs have `buffers` of their own."""
        result = np.zeros(self.size)
        t, branch = time
        first_order_residual(self._own, t, branch, y, yp, result)
        return result

    def jacobian(self, time: Array, y: Array, yp: Array, c: float) -> Array:
        """Non-zeros of dR/dy + c dR/dy' on `pattern`, likewise."""
        result = np.zeros(self.pattern.nnz)
        t, branch = time
        first_order_jacobian(self._own, t, branch, c, y, yp, result)
        return result

    @property
    def names(self) -> list[str]:
        """What the unknowns are, in words where they are not coordinates or multipliers."""
        q, lam = self.equations.q_names, self.equations.lam_names
        mu = lam if self.formulation.stabilized else ()
        return [*q, *(f"velocity of {x}" for x in q), *lam, *(f"correction of {x}" for x in mu)]

    @property
    def is_native(self) -> bool:
        """Whether it can be evaluated in machine code."""
        return all(total.is_native for total in self.sums)

    def buffers(self, native: bool = False) -> FirstOrderSums:
        """What a run evaluates R and its Jacobian with, for itself alone."""
        residual, jacobian = (total.sum(native, self.equations.p) for total in self.sums)
        return FirstOrderSums(
            self.equations.n, self.size, np.zeros(2 * self.size), residual, jacobian
        )


@dataclass(slots=True)
class FirstOrderSums:
    """Buffers of a first-order form with `n` coordinates and `size` unknowns, x = (y, y')."""

    n: int
    size: int
    x: Array
    residual: Sum
    jacobian: Sum


def first_order_residual(
    form: FirstOrderSums, t: float, branch: float, y: Array, yp: Array, result: Array
) -> None:
    """R(t, y, y'), into `result`."""
    _set_time(form, form.residual, t, branch, y, yp)
    evaluate(form.residual, form.x, result)
    n = form.n
    kinematic = result[:n]
    combine(kinematic, (1.0, 1.0, -1.0), (kinematic, yp[:n], y[n : 2 * n]))


def first_order_jacobian(
    form: FirstOrderSums, t: float, branch: float, c: float, y: Array, yp: Array, result: Array
) -> None:
    """The non-zeros of dR/dy + c dR/dy', into `result`."""
    _set_time(form, form.jacobian, t, branch, y, yp)
    shared = form.jacobian.shared
    # c_q, c_v, c_a, c_l, c_h, c_r as in MATRIX_SHARED.
    shared[2], shared[3], shared[4], shared[5], shared[6], shared[7] = 1.0, 1.0, c, c, 1.0, 1.0
    evaluate(form.jacobian, form.x, result)


def _set_time(
    form: FirstOrderSums, total: Sum, t: float, branch: float, y: Array, yp: Array
) -> None:
    combine(form.x[: form.size], (1.0,), (y,))
    combine(form.x[form.size :], (1.0,), (yp,))
    total.shared[0], total.shared[1] = t, branch


def first_order_parts(
    form: FirstOrderSums, t: float, branch: float, y: Array, yp: Array, result: Array
) -> None:
    """The non-zeros of dR/dy, then those of dR/dy', into `result`; `form` has them apart."""
    _set_time(form, form.jacobian, t, branch, y, yp)
    fill(form.jacobian.shared[2:], 1.0)
    evaluate(form.jacobian, form.x, result)


@once
def first_order(equations: EquationsOfMotion, name: str, apart: bool = False) -> FirstOrder:
    """A first-order form.

    Parameters
    ----------
    name
        One of `FIRST_ORDER`.
    apart
        Whether dR/dy and dR/dy' are evaluated one by one, see `first_order_parts`.
    """
    form = FORMULATIONS[require_choice("formulation", "name", name, FIRST_ORDER)]
    pattern, jacobian = jacobian_sum(equations.structure, name, apart)
    return FirstOrder(
        equations, form, pattern, (residual_plan(equations.structure, name), jacobian)
    )
