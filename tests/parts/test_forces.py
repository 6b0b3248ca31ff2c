"""Loads, weights and point masses: generalized forces are derivatives of their work."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose
from support import (
    ARC,
    UNEVEN_ELEMENTS,
    VARIANTS,
    NumericEquations,
    finite_differences,
    parametrize_variants,
    random_state,
)

import beamdae as bd

# Loads depend on the motion of a section alone, not on strain, quadrature and damping.
every_variant = parametrize_variants(
    v for v in VARIANTS if v.strain == "nonlinear" and v.quadrature == "reduced" and v.damping > 0.0
)


@every_variant
def test_point_mass_on_a_beam_has_the_inertia_and_weight_of_its_point(variant):
    mass, gravity = 0.8, np.array([0.5, -2.0])
    numerics = []
    for loaded in (True, False):
        mech = bd.Mechanism(gravity=tuple(gravity))
        # A given mesh, so that the load does not change the coordinates.
        beam = mech.add(variant.beam(ARC, UNEVEN_ELEMENTS))
        if loaded:
            mech.add(bd.PointMass("tip mass", mass, on=beam.end))
        mech.observe("tip", beam.end)
        numerics.append(NumericEquations(mech))
    loaded, bare = numerics
    q, v, a = random_state(loaded, seed=4)

    def place(t):
        return loaded.observed("tip", q=q + t * v + 0.5 * t**2 * a)[:2]

    h = 1e-3
    near = place(h) - 2.0 * place(0.0) + place(-h)
    far = place(2 * h) - 2.0 * place(0.0) + place(-2 * h)
    acceleration = (16.0 * near - far) / (12.0 * h**2)
    lever = finite_differences(lambda x: loaded.observed("tip", q=x)[:2], q)
    expected = mass * (acceleration - gravity) @ lever
    # Rounding error of second differences, 1e-16 / step^2.
    assert_allclose(loaded.force(q, v, a) - bare.force(q, v, a), expected, atol=1e-8)
    energy = loaded.energies(q, v) - bare.energies(q, v)
    assert_allclose(energy[0], 0.5 * mass * np.sum((lever @ v) ** 2), rtol=1e-10)
    assert_allclose(energy[2], -mass * gravity @ place(0.0), rtol=1e-12)


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
