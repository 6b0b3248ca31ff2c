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

from dataclasses import dataclass

import numpy as np

from beamdae.equations.formulations.first_order import FirstOrderForm

Array = np.ndarray


@dataclass(slots=True)
class KinematicRowScaling:
    """Indices and weights that change rows q' - v + P G^T mu into S^-1 (q' - v) + P G^T mu.

    Attributes
    ----------
    n
        Number of these rows; 0 if the form does not correct positions.
    rows
        Row indices of the entries of q', then of v: 0 to n - 1, twice.
    columns
        Column indices of these entries in (q', v): 0 to 2 n - 1.
    entry_indices
        Indices of these entries in the non-zeros of the Jacobian.
    weights
        S^-1 - 1 for q', 1 - S^-1 for v; weighted entries are added to the assembled rows.
    factors
        Factors of q' and v in dR/dy + c dR/dy': c and 1.
    """

    n: int
    rows: Array
    columns: Array
    entry_indices: Array
    weights: Array
    factors: Array

    @classmethod
    def from_form(cls, form: FirstOrderForm, scales: Array) -> KinematicRowScaling:
        """Return the scaling of a form for dimensionless position scales, (n,)."""
        n = form.equations.n if form.formulation.stabilized else 0
        columns = np.arange(2 * n)
        rows = columns % max(n, 1)
        extra_weights = np.max(scales, initial=0.0) / scales[:n] - 1.0
        indices, starts = form.pattern.indices, form.pattern.indptr
        entry_indices = [
            starts[column] + np.searchsorted(indices[starts[column] : starts[column + 1]], row)
            for row, column in zip(rows, columns, strict=True)
        ]
        weights = np.concatenate([extra_weights, -extra_weights])
        return cls(n, rows, columns, np.array(entry_indices, np.intp), weights, np.ones(2 * n))


def scale_residual(scaling: KinematicRowScaling, y: Array, yp: Array, result: Array) -> None:
    """Multiply q' - v in the residual `result` by S^-1."""
    n = scaling.n
    result[:n] += scaling.weights[:n] * yp[:n] + scaling.weights[n:] * y[n : 2 * n]


def scale_jacobian(scaling: KinematicRowScaling, c: float, nonzeros: Array) -> None:
    """Multiply the derivatives of q' - v in the non-zeros of dR/dy + c dR/dy' by S^-1."""
    factors = np.repeat([c, 1.0], scaling.n)
    nonzeros[scaling.entry_indices] += scaling.weights * factors
