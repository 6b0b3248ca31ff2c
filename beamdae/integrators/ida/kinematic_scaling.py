"""Scaling of the kinematic rows: position corrections in proportion to position scales.

Stabilized forms keep positions on the constraints by q' = v - P G^T mu; without deformations, this
is the smallest correction relative to the size of the mechanism. It failed for a rotor making many
revolutions, driven from a frame that hardly moved: half of the admissible error of the rotor angle
was assigned to the frame, whose tolerance was a thousand times smaller. IDA tried to double the
step after each step, failed, and stayed at order 1. Positions are therefore corrected in proportion
to their scales, q' = v - S P G^T mu with S = diag(scales / largest scale), where the scales of
lengths are relative to the size of the mechanism. S does not change the solution because mu is zero
if the constraints are satisfied.
"""

from __future__ import annotations

import numpy as np

from beamdae.core.tables import Workspace
from beamdae.equations.formulations.first_order import FirstOrderForm

Array = np.ndarray


def scale_kinematic_rows(form: FirstOrderForm, scales: Array) -> Workspace:
    """Return the `KinematicRowScaling` of a form for dimensionless position scales, (n,).

    Rows q' - v + P G^T mu become S^-1 (q' - v) + P G^T mu.
    """
    n = form.equations.n if form.formulation.stabilized else 0
    columns = np.arange(2 * n)
    rows = columns % max(n, 1)
    extra_weights = np.max(scales, initial=0.0) / scales[:n] - 1.0
    indices, starts = form.pattern.indices, form.pattern.indptr
    entry_indices = [
        starts[column] + np.searchsorted(indices[starts[column] : starts[column + 1]], row)
        for row, column in zip(rows, columns, strict=True)
    ]
    return Workspace(
        "KinematicRowScaling",
        n=n,
        rows=rows,
        columns=columns,
        entry_indices=np.array(entry_indices, np.intp),
        weights=np.concatenate([extra_weights, -extra_weights]),
        factors=np.ones(2 * n),
    )


def scale_residual(scaling: Workspace, y: Array, yp: Array, result: Array) -> None:
    """Multiply q' - v in the residual `result` by S^-1."""
    n = scaling.n
    result[:n] += scaling.weights[:n] * yp[:n] + scaling.weights[n:] * y[n : 2 * n]


def scale_jacobian(scaling: Workspace, c: float, nonzeros: Array) -> None:
    """Multiply the derivatives of q' - v in the non-zeros of dR/dy + c dR/dy' by S^-1."""
    factors = np.repeat([c, 1.0], scaling.n)
    nonzeros[scaling.entry_indices] += scaling.weights * factors
