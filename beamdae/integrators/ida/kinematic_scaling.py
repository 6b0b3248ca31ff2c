"""Scaling of the kinematic rows: position corrections in proportion to position scales.

Stabilized forms keep positions on the constraints by q' = v - G^T mu, the smallest correction in
the units of the coordinates. That failed where a rotor of many turns is driven from a frame that
hardly moves: half of what the error test allows for the angle of the rotor went to the frame, whose
tolerance is a thousandth of it. IDA could not double a step, tried after each one, and stayed at
order 1. Positions are therefore corrected in proportion to their scales, q' = v - S G^T mu with
S = diag(scales / largest scale). S does not change the solution: mu is zero where the constraints
hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.formulations.first_order import FirstOrderForm
from beamdae.native.loop_functions import add_weighted, fill

Array = np.ndarray


@dataclass(slots=True)
class KinematicRowScaling:
    """Indices and weights that turn rows q' - v + G^T mu into S^-1 (q' - v) + G^T mu.

    Attributes
    ----------
    n
        Number of rows; 0 if the form does not correct positions.
    rows
        Rows to scale, for q' and then for v: 0 to n - 1 twice.
    columns
        Entries of (q', v) that they contain: 0 to 2 n - 1.
    places
        Positions of their derivatives by q' and v among the non-zeros of the Jacobian.
    weights
        S^-1 - 1 for q', 1 - S^-1 for v: added to the rows as assembled.
    factors
        Derivatives of (q', v) in dR/dy + c dR/dy': c and 1.
    """

    n: int
    rows: Array
    columns: Array
    places: Array
    weights: Array
    factors: Array

    @classmethod
    def from_form(cls, form: FirstOrderForm, scales: Array) -> KinematicRowScaling:
        """Return the scaling for a form whose positions have these scales [m or rad], (n,)."""
        n = form.equations.n if form.formulation.stabilized else 0
        columns = np.arange(2 * n)
        rows = columns % max(n, 1)
        extra_weights = np.max(scales, initial=0.0) / scales[:n] - 1.0
        indices, starts = form.pattern.indices, form.pattern.indptr
        places = [
            starts[column] + np.searchsorted(indices[starts[column] : starts[column + 1]], row)
            for row, column in zip(rows, columns, strict=True)
        ]
        weights = np.concatenate([extra_weights, -extra_weights])
        return cls(n, rows, columns, np.array(places, np.int64), weights, np.ones(2 * n))


def scale_residual(scaling: KinematicRowScaling, y: Array, yp: Array, result: Array) -> None:
    """Scale q' - v in a residual."""
    n, rows, columns = scaling.n, scaling.rows, scaling.columns
    add_weighted(result, rows, scaling.weights, yp, columns, 0, n)
    add_weighted(result, rows, scaling.weights, y, columns, n, 2 * n)


def scale_jacobian(scaling: KinematicRowScaling, c: float, nonzeros: Array) -> None:
    """Scale its derivatives in the non-zeros of dR/dy + c dR/dy'."""
    n, factors, columns = scaling.n, scaling.factors, scaling.columns
    fill(factors[:n], c)
    add_weighted(nonzeros, scaling.places, scaling.weights, factors, columns, 0, 2 * n)
