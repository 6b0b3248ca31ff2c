"""Corrections of positions in proportion to their tolerances.

Stabilized forms hold positions on the constraints by q' = v - G^T mu: by the smallest correction,
whatever its components are. Where a rotor of many turns is driven from a frame that hardly moves,
half of what the error test allows the angle of the rotor went to the frame, whose tolerance is a
thousandth of it: IDA could not double a step, tried after each one, and stayed at order 1. So
positions are corrected in proportion to their scales, q' = v - S G^T mu, S = diag(scales /
largest). S changes no solution: mu is zero where the constraints hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.formulations import FirstOrder
from beamdae.native.vectors import add_weighted, fill

Array = np.ndarray


@dataclass(slots=True)
class KinematicRows:
    """What makes rows q' - v + G^T mu of a first-order form into S^-1 (q' - v) + G^T mu.

    Attributes
    ----------
    n
        Number of rows; 0 where nothing corrects positions.
    rows, of
        (0, ..., n - 1) twice, and 0, ..., 2 n - 1.
    places
        Where the Jacobian has the derivatives of the rows by q' and by v.
    weights, factors
        S^-1 - 1 and 1 - S^-1, and what they are multiplied by in the Jacobian.
    """

    n: int
    rows: Array
    of: Array
    places: Array
    weights: Array
    factors: Array

    @classmethod
    def of_form(cls, form: FirstOrder, scales: Array) -> KinematicRows:
        """The rows of a form whose positions have these scales [m or rad]."""
        n = form.equations.n if form.formulation.stabilized else 0
        of = np.arange(2 * n)
        rows = of % max(n, 1)
        more = np.max(scales, initial=0.0) / scales[:n] - 1.0
        indices, starts = form.pattern.indices, form.pattern.indptr
        places = [
            starts[column] + np.searchsorted(indices[starts[column] : starts[column + 1]], row)
            for row, column in zip(rows, of, strict=True)
        ]
        weights = np.concatenate([more, -more])
        return cls(n, rows, of, np.array(places, np.int64), weights, np.ones(2 * n))


def weigh_residual(kinematic: KinematicRows, y: Array, yp: Array, result: Array) -> None:
    """Weigh q' - v in a residual."""
    n, rows, of = kinematic.n, kinematic.rows, kinematic.of
    add_weighted(result, rows, kinematic.weights, yp, of, 0, n)
    add_weighted(result, rows, kinematic.weights, y, of, n, 2 * n)


def weigh_jacobian(kinematic: KinematicRows, c: float, nonzeros: Array) -> None:
    """Weigh its derivatives, dR/dy + c dR/dy'."""
    n, factors = kinematic.n, kinematic.factors
    fill(factors[:n], c)
    add_weighted(nonzeros, kinematic.places, kinematic.weights, factors, kinematic.of, 0, 2 * n)
