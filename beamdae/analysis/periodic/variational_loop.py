"""Work arrays of the variational equations: linearized Radau steps for disturbances.

The steps, in `disturbances.c`, propagate a block of disturbances at a time, one per vector lane:
factors and matrices are read once per block. Vectors hold the first entry of all lanes, then the
second one; indices and `KinematicReduction` refer to such vectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.formulations.first_order import FirstOrderBuffers
from beamdae.equations.formulations.kinematic_reduction import KinematicReduction
from beamdae.integrators.radau.workspace import TABLEAU, StepSizeState, Tableau

Array = np.ndarray


@dataclass(slots=True)
class VariationalWorkspace:
    """Work arrays of the variational equations for some steps of Radau IIA.

    Attributes
    ----------
    form
        First-order form whose Jacobian has the parts of the reduced matrices, see
        `reduce_kinematics`.
    real_solver, complex_solver
        Linear solvers of the decoupled stage equations; see `radau.coefficients`.
    reduction
        Unknowns and equations of these systems, with the indices of all lanes.
    step_size
        Its `last_step` is the last step [s], 0 before the first step.
    times, states, state_rates
        Times [s], states and rates of the run at the stages, three rows per step.
    h
        Steps [s].
    branch
        A time inside the interval [s].
    disturbances, ends
        Disturbances of y at the start and at the end of a step, one block per row.
    disturbances_w, ends_w
        W of the disturbances in the last and in the current step, three rows per block.
    scales
        Reciprocal natural sizes of (q, v).
    weights
        Reciprocal errors of the stages of the current block.
    jacobians
        Parts of the reduced matrices, one row per stage.
    real_nonzeros, complex_nonzeros
        Non-zeros of the real and the complex matrix.
    row_starts, entry_columns, entry_sources
        All parts side by side, by rows: starts of the rows,
        columns, and indices of the entries in a row of `jacobians`.
    y, yp, w, last_w, stages, rates, right, complex_right, extrapolation, velocities
        As in `RadauWorkspace`, for a block of disturbances; `yp` is zero.
    real_change, complex_change, complex_real, complex_imaginary
        As in `RadauWorkspace`.
    residuals
        Reduced residuals of the stages.
    unknowns
        Factors of the parts: reduced stage, reduced rates, and accelerations.
    tolerance
        Error of the stages, relative to the disturbance at the start of the step.
    rate
        Largest rate of convergence in the current step.
    steps, next
        Number of steps, and index of the next step.
    count
        Number of blocks.
    tableau
        Coefficients of Radau IIA.
    """

    form: FirstOrderBuffers
    real_solver: Any
    complex_solver: Any
    reduction: KinematicReduction
    step_size: StepSizeState
    times: Array
    states: Array
    state_rates: Array
    h: Array
    disturbances: Array
    ends: Array
    disturbances_w: Array
    ends_w: Array
    scales: Array
    weights: Array
    jacobians: Array
    real_nonzeros: Array
    complex_nonzeros: Array
    row_starts: Array
    entry_columns: Array
    entry_sources: Array
    y: Array
    yp: Array
    w: Array
    last_w: Array
    stages: Array
    rates: Array
    right: Array
    complex_right: Array
    extrapolation: Array
    velocities: Array
    real_change: Array
    complex_change: Array
    complex_real: Array
    complex_imaginary: Array
    residuals: Array
    unknowns: Array
    tolerance: float = 0.0
    rate: float = 0.0
    branch: float = 0.0
    steps: int = 0
    next: int = 0
    count: int = 0
    tableau: Tableau = TABLEAU
