"""Linearized equations as the eigenvalue solvers need them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.tangents import Tangent

Array = np.ndarray


@dataclass(frozen=True)
class LinearizedEquations:
    """Linearized equations M x'' + C x' + K x + H mu = 0, J x + V x' = 0.

    Attributes
    ----------
    equations
        Equations of the active parts with independent constraints.
    tangent
        Matrices of the linearized equations.
    zero_square
        Squared frequencies up to this magnitude [1/s^2] are treated as zero.
    has_differences
        True if the matrices contain errors of finite differences or of the transformation to a
        rotating frame, so that symmetry is tested with a larger tolerance.
    """

    equations: EquationsOfMotion
    tangent: Tangent
    zero_square: float = 0.0
    has_differences: bool = False

    @property
    def nonholonomic(self) -> Array:
        """Mask of the constraints on velocities, (m,)."""
        mask = np.zeros(self.equations.m, bool)
        mask[self.equations.nonholonomic_rows] = True
        return mask
