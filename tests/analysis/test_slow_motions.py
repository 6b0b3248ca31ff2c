"""Slowest motions with compliant constraints."""

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

from beamdae.analysis.eigenproblems.eigensolution import solve_eigenproblem
from beamdae.analysis.eigenproblems.linearized_equations import (
    CoordinateSubset,
    LinearizedEquations,
)
from beamdae.equations.formulations.tangents import Tangent


def strip(elements, slenderness, damping=0.0, is_clamped=True, load=0.0, follower=0.0):
    """Return a straight strip whose axial and shear resultants are multipliers.

    Two-node elements with linear displacements and rotation, EI = rho A = length = 1.
    """
    h, n = 1.0 / elements, 3 * (elements + 1)
    stiffness, mass, rows, compliance = np.zeros((n, n)), np.zeros((n, n)), [], []
    for k in range(elements):
        u = 3 * k + np.arange(6)
        bending = np.array([0.0, 0.0, -1.0, 0.0, 0.0, 1.0])
        turning = np.array([0.0, -1.0, 0.0, 0.0, 1.0, 0.0])
        block = np.outer(bending, bending) - load * np.outer(turning, turning)
        stiffness[np.ix_(u, u)] += block / h
        for i, inertia_ in enumerate((1.0, 1.0, 1.0 / 12.0 / slenderness**2)):
            pair = u[[i, i + 3]]
            mass[np.ix_(pair, pair)] += inertia_ * h / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        for strain in ([-1.0, 0.0, 0.0, 1.0, 0.0, 0.0], [0.0, -1.0, -h / 2, 0.0, 1.0, -h / 2]):
            row = np.zeros(n)
            row[u] = strain
            rows.append(row)
        compliance += [h / (12.0 * slenderness**2), h * 3.12 / (12.0 * slenderness**2)]
    if is_clamped:
        rows, compliance = [*rows, *np.eye(n)[:3]], [*compliance, 0.0, 0.0, 0.0]
    m = len(rows)
    material = damping * stiffness
    stiffness[n - 2, n - 1] += follower
    gradients = sp.csc_array(np.array(rows))
    tangent = Tangent(
        mass=sp.csc_array(mass),
        damping=sp.csc_array(material),
        stiffness=sp.csc_array(stiffness),
        reactions=sp.csc_array(gradients.T),
        position_jacobian=gradients,
        velocity_jacobian=sp.csc_array((m, n)),
        residual=np.zeros(n + m),
        compliance=np.array(compliance),
    )
    names = tuple(f"q{k}" for k in range(n))
    none = np.zeros(0, int)
    return LinearizedEquations(CoordinateSubset(names, np.ones(n), none, none, m), tangent)


@pytest.mark.parametrize("is_clamped", [True, False])
@pytest.mark.parametrize("damping", [0.0, 1e-3])
@pytest.mark.parametrize(
    "elements", [8, pytest.param(120, marks=pytest.mark.slow(reason="sparse matrices"))]
)
@pytest.mark.parametrize("follower", [0.0, 5.0])
def test_slenderness_does_not_enter_rounding(elements, damping, is_clamped, follower):
    """Shear and rotary inertia change frequencies by less than 1e-9 beyond L/h = 1e6."""
    if follower and not is_clamped:
        return
    values = [
        solve_eigenproblem(strip(elements, x, damping, is_clamped, 0.0, follower), 6).values
        for x in (1e6, 1e7)
    ]
    assert_allclose(values[1], values[0], rtol=2e-9)
    assert np.sum(values[0] == 0.0) == (0 if is_clamped else 3)
    if not damping and not follower and is_clamped:
        # Roots of cos(x) cosh(x) = -1; the error of linear elements is of second order.
        expected = np.array([1.8751040687, 4.6940911330]) ** 2
        assert_allclose(values[0][:2].imag, expected, rtol=5.0 / elements**2)
