"""Displacements to first order in the loads."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import splu

import beamdae as bd
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.measures import ObservedRows

Array = np.ndarray

# Observed quantities are differentiated over displacements of this share of the mechanism.
_SMALL = 1e-5


def small_displacements(mech: bd.Mechanism) -> Array:
    """Change of the observed quantities from the drawing under all loads, to first order."""
    e = bd.equations_of_motion(mech)
    static = StaticEquations(e, np.zeros(2))
    lam = np.zeros(e.m)
    matrix, load = static.matrix(e.q0, lam), -static.residual(e.q0, lam)
    # Multipliers by the stiffest coordinate: pivots keep clear of the joints.
    scale = np.ones(static.size)
    scale[e.n :] = np.max(np.abs(matrix.diagonal()[: e.n]))
    scaled = (matrix * scale).multiply(scale[:, None]).tocsc()
    solver = splu(scaled)
    change = solver.solve(scale * load)
    change += solver.solve(scale * load - scaled @ change)
    moved = (scale * change)[: e.n]
    far = _SMALL * e.length / np.max(np.abs(moved))
    there, back = (_observed(e, e.q0 + sign * far * moved) for sign in (1.0, -1.0))
    return (there - back) / (2.0 * far)


def _observed(e: bd.EquationsOfMotion, q: Array) -> Array:
    still = np.zeros((1, e.n))
    rows = ObservedRows(e)(np.zeros((1, 2)), q[None], still, still, np.zeros((1, e.m)))
    return np.asarray(rows[0])
