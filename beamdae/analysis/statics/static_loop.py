"""Static equations with a load factor and one control equation.

    [[F_x, column], [row, corner]] solution = right

with F(x; mu) = C + U + mu (L - U): C are the forces and joints that the load factor does not
change, U and L those that are particular to the unloaded and to the loaded mechanism. The core
solves them: `statics.c`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.continuation.newton import Corrections
from beamdae.analysis.statics.pivot_signs import SaddlePoint
from beamdae.symbolic.sums.kernel_sums import Sum

Array = np.ndarray

# Tasks of `perform_task`, as in `core.h`.
EVALUATE_FORCES = 0
EVALUATE_TANGENT = 1
COUNT_SIGNS = 2
CORRECT = 3


@dataclass(slots=True)
class LoadPart:
    """One of the parts C, U and L of the static equations.

    Attributes
    ----------
    residual, tangent
        Sums of kernels; `tangent` evaluates non-zeros of the bordered matrix.
    forces, nonzeros
        Their last values.
    """

    residual: Sum
    tangent: Sum
    forces: Array
    nonzeros: Array


@dataclass(slots=True)
class StaticWorkspace:
    """Work arrays of `perform_task`.

    Attributes
    ----------
    common, unloaded, loaded
        Parts C, U and L.
    linear
        Linear solver of the bordered matrix.
    saddle
        Symmetric elimination of the tangent.
    nonzeros, scaled, products
        Non-zeros of the bordered matrix and a 1; in natural sizes; products of the sizes of their
        rows and columns.
    sizes
        Natural sizes of the unknowns, then 1, (n + m + 1,).
    inputs
        (q, 0, lam), with the zeros of velocities and accelerations.
    forces, by_factor
        F and F_mu, (n + m,).
    row, row_targets, counting
        Last row, (n + m + 1,): nonzeros[row_targets] = row; and 0, 1, 2, ...
    column_start
        Start of the last column, F_mu, in `nonzeros`.
    right
        Right-hand side, (n + m + 1,), and then the solution; after `CORRECT`, derivatives by the
        control.
    joint_count
        Number of multipliers of joints, g = 0; the others are compliant, g - lam = 0.
    remainder
        Multiples of g that the forces add to lam, (m,).
    added_targets, added
        Constants of the tangent: nonzeros[added_targets] += added. They are springs that hold
        coordinates in the tangent alone, and the compliances -1.
    weights
        Inverse natural sizes by which corrections are measured, (n + m,).
    corrections
        Corrections of `CORRECT`.
    deviation
        Value of the control minus its target.
    mu, center, scale
        Load factor; that of the parts U and L is (mu - center) * scale.
    task
        `EVALUATE_FORCES`; `EVALUATE_TANGENT` to evaluate also the tangent; `COUNT_SIGNS` to count
        also its negative pivots; `CORRECT` to correct the point by Newton's method until it is a
        solution or, if the control is not linear, once.
    is_linear
        1 if derivatives of the control are the same everywhere, else 0.
    has_forces, has_tangent
        1 if forces and tangent have been evaluated at `inputs` and `mu`, else 0.
    has_factors
        1 if the last factors are those of the tangent at the last point where it was evaluated and
        `row`, with F_mu as column, else 0.
    """

    common: LoadPart
    unloaded: LoadPart
    loaded: LoadPart
    linear: Any
    saddle: SaddlePoint
    nonzeros: Array
    scaled: Array
    products: Array
    sizes: Array
    inputs: Array
    forces: Array
    by_factor: Array
    row: Array
    row_targets: Array
    counting: Array
    right: Array
    remainder: Array
    added_targets: Array
    added: Array
    weights: Array
    corrections: Corrections
    column_start: int
    joint_count: int
    deviation: float = 0.0
    mu: float = 0.0
    center: float = 0.0
    scale: float = 1.0
    task: int = EVALUATE_FORCES
    is_linear: int = 1
    has_forces: int = 0
    has_tangent: int = 0
    has_factors: int = 0


def forget_point(run: StaticWorkspace) -> None:
    """Mark all values as those of another point."""
    run.has_forces = run.has_tangent = run.has_factors = 0
