"""Work arrays of IDA's callbacks and of its steps, which `ida.c` takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.formulations.first_order import FirstOrderBuffers
from beamdae.integrators.ida.kinematic_scaling import KinematicRowScaling

Array = np.ndarray


@dataclass(slots=True)
class NewtonState:
    """Equations and linear algebra of IDA's Newton iteration.

    Attributes
    ----------
    form
        Residual and Jacobian of the first-order form.
    linear
        Linear solver with the factors of the Jacobian.
    raw_residual
        Last residual before premultiplication.
    nonzeros
        Non-zeros of the Jacobian.
    kinematic
        Scaling of the kinematic rows.
    correction_fraction
        Fraction of each Newton correction that is applied; see `stepper`.
    branch
        Time [s] inside the smooth interval.
    has_factors
        1 if the Jacobian has been factorized.
    c, age
        Coefficient c of dR/dy + c dR/dy' in the factors, and number of steps since the factors were
        computed.
    renew_address
        Address of a C function that sets new pivots and returns 1 on success.
    residuals, jacobians
        Numbers of evaluations of the residual and the Jacobian.
    """

    form: FirstOrderBuffers
    linear: Any
    raw_residual: Array
    nonzeros: Array
    kinematic: KinematicRowScaling
    correction_fraction: float = 1.0
    branch: float = 0.0
    has_factors: int = 0
    c: float = 0.0
    age: int = 0
    renew_address: int = 0
    residuals: int = 0
    jacobians: int = 0


@dataclass(slots=True)
class SundialsFunctions:
    """Addresses of SUNDIALS functions."""

    IDASolve: int
    IDASetStopTime: int
    IDAGetLastOrder: int
    IDAGetEstLocalErrors: int
    N_VGetArrayPointer: int
    SUNBandMatrix_Data: int


@dataclass(slots=True)
class IdaWorkspace:
    """Work arrays of an IDA run.

    Attributes
    ----------
    newton, sundials
        Newton iteration, and SUNDIALS functions.
    has_impulses
        1 if the unknowns include time integrals of the multipliers; see `Formulation.impulses`.
    rows
        Rows (t, q, v, a, lam) of the steps taken.
    orders
        Number of steps of each order.
    limiting_counts
        Number of steps in which each unknown had the largest error.
    weights
        Error weights that determine the largest error.
    t, y, yp, order, errors
        Arrays in which IDA returns its results.
    t_address, order_address
        Addresses of `t` and `order`.
    y_vector, yp_vector, errors_vector
        Addresses of the SUNDIALS vectors of these arrays.
    memory
        Address of IDA's memory.
    residual_vector
        Address of the SUNDIALS vector that received the last residual.
    end
        End of the smooth interval [s].
    filled, most
        Number of filled rows, and maximum number of rows to fill.
    """

    newton: NewtonState
    sundials: SundialsFunctions
    has_impulses: int
    rows: Array
    orders: Array
    limiting_counts: Array
    weights: Array
    t: Array
    y: Array
    yp: Array
    order: Array
    errors: Array
    t_address: int
    order_address: int
    y_vector: int = 0
    yp_vector: int = 0
    errors_vector: int = 0
    memory: int = 0
    residual_vector: int = 0
    end: float = 0.0
    filled: int = 0
    most: int = 0
