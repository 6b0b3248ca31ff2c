"""Work arrays of the variational equations: linearized Radau steps for disturbances.

The steps, in `disturbances.c`, propagate a block of disturbances at a time, one per vector lane:
factors and matrices are read once per block. Vectors hold the first entry of all lanes, then the
second one; indices and `KinematicReduction` refer to such vectors.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from beamdae.core.tables import Workspace
from beamdae.equations.formulations.kinematic_reduction import KinematicReduction
from beamdae.integrators.radau.coefficients import TABLEAU

Array = np.ndarray


@dataclass(slots=True)
class VariationalWorkspace:
    """Work arrays of the variational equations for some steps of Radau IIA.

    Fields with names of `RadauWorkspace` are those of a block of disturbances; `yp` is zero.

    Attributes
    ----------
    form
        First-order form whose Jacobian has the parts of the reduced matrices, see
        `reduce_kinematics`.
    real_solver, complex_solver, reduction
        Linear solvers of the decoupled stage equations, see `radau.coefficients`; their unknowns
        and equations, with the indices of all lanes.
    step_size
        Its `last_step` is the last step [s], 0 before the first step.
    times, states, state_rates, h, branch
        Times [s], states and rates of the run at the stages, three rows per step; steps [s], and a
        time inside the interval [s].
    disturbances, ends, disturbances_w, ends_w
        Disturbances of y at the start and at the end of a step, one block per row, and W in the
        last and in the current step, three rows per block.
    scales, weights
        Reciprocal natural sizes of (q, v), and reciprocal errors of the stages of the block.
    jacobians, real_nonzeros, complex_nonzeros
        Parts of the reduced matrices, one row per stage, and non-zeros of both matrices.
    row_starts, entry_columns, entry_sources
        All parts side by side, by rows: starts of the rows, columns, and indices of the entries in
        a row of `jacobians`.
    residuals, unknowns
        Reduced residuals of the stages, and factors of the parts: reduced stage, reduced rates, and
        accelerations.
    tolerance, rate
        Error of the stages, relative to the disturbance at the start of the step, and largest rate
        of convergence in the current step.
    steps, next, count
        Number of steps, index of the next step, and number of blocks.
    tableau
        Coefficients of Radau IIA.
    """

    form: Workspace
    real_solver: Any
    complex_solver: Any
    reduction: KinematicReduction
    step_size: Workspace
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
    tableau: Workspace = field(default_factory=lambda: TABLEAU)
