"""Forces on rigid bodies: moments of eccentric forces, energies and powers."""

import numpy as np
from numpy.testing import assert_allclose
from support import (
    NumericEquations,
)

import beamdae as bd


def test_an_eccentric_force_rotates_a_rigid_body():
    mech = bd.Mechanism(gravity=(0.0, -10.0))
    body = mech.add(bd.RigidBody("body", mass=2.0, inertia=0.3, center=(1.0, 1.0)))
    mech.add(bd.Force("push", body.at(1.5, 1.0), (0.0, 4.0)))
    mech.add(bd.Force("thrust", body.at(1.0, 3.0), (3.0, 0.0), axes="body"))
    numeric = NumericEquations(mech)
    quarter = np.array([1.0, 1.0, 0.5 * np.pi])
    # By hand: after a quarter revolution the push at the arm (0, 0.5) has no moment, and the
    # thrust points up at the arm (-2, 0).
    expected = -np.array([0.0, 4.0 + 3.0 - 20.0, -6.0])
    assert_allclose(numeric.force(quarter), expected, atol=1e-14)  # rounding
    assert_allclose(numeric.force(), -np.array([3.0, 4.0 - 20.0, 4.0 * 0.5 - 3.0 * 2.0]))
    assert_allclose(numeric.mass(), np.diag([2.0, 2.0, 0.3]), rtol=1e-15)
    v = np.array([0.3, -0.2, 5.0])
    kinetic, strain, gravity, power, dissipated = numeric.energies(v=v)
    assert_allclose(kinetic, 0.5 * (2.0 * 0.13 + 0.3 * 25.0), rtol=1e-14)
    assert_allclose(gravity, 20.0, rtol=1e-14)
    assert_allclose(power, 4.0 * (-0.2 + 5.0 * 0.5) + 3.0 * (0.3 - 5.0 * 2.0), rtol=1e-14)
    assert (strain, dissipated) == (0.0, 0.0)
