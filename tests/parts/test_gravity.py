"""Gravity as a time law: weight is the work of a load."""

from __future__ import annotations

import numpy as np
import pytest
from conformance import integrators
from numpy.testing import assert_allclose
from support import ARC, VARIANTS, NumericEquations

import beamdae as bd


def mechanism(gravity):
    mech = bd.Mechanism(gravity=gravity)
    beam = mech.add(VARIANTS[2].beam(ARC))
    disk = mech.add(bd.RigidBody("disk", 1.3, 0.7, center=(0.5, 0.4)))
    mech.add(bd.PointMass("bob", 0.4, at=(1.0, 2.0)))
    mech.add(bd.PointMass("tip", 0.2, on=beam.end))
    mech.add(bd.PointMass("rim", 0.3, on=disk.at(1.0, 0.4)))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "law", [lambda t: -3.0 * np.cos(t), bd.piecewise((0.5, -3.0 * np.cos(0.3)), 7.0)]
)
def test_weights_equal_those_under_the_constant_gravity_of_that_time(law):
    changing = NumericEquations(mechanism((0.4, law)), time=(0.3, 0.3))
    constant = NumericEquations(mechanism((0.4, -3.0 * np.cos(0.3))))
    bare = NumericEquations(mechanism((0.0, 0.0)))
    rng = np.random.default_rng(0)
    q = changing.equations.q0 + 0.1 * rng.standard_normal(changing.n)
    v, a = rng.standard_normal((2, changing.n))
    assert_allclose(changing.force(q, v, a), constant.force(q, v, a), rtol=1e-12, atol=1e-12)
    assert_allclose(changing.stiffness(q, v, a), constant.stiffness(q, v, a), atol=1e-11)
    energies, still = changing.energies(q, v), bare.energies(q, v)
    assert_allclose(energies[:3], still[:3], rtol=1e-13, atol=1e-13)
    work = (bare.force(q, v) - constant.force(q, v)) @ v
    assert_allclose(energies[3], work, rtol=1e-11)
    assert_allclose(energies[4], still[4], rtol=1e-13)


@integrators(rtol=1e-7, step=1e-3)
def test_a_pendulum_rotates_uniformly_after_gravity_ends(integrator):
    mech = bd.Mechanism(gravity=(0.0, bd.piecewise((0.6, -9.81), 0.0)))
    body = mech.add(bd.RigidBody("body", 2.0, 0.5, center=(1.0, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
    solution = bd.simulate(mech, integrator, t_end=1.2, output_step=0.1)
    assert solution.status.success, solution.status.sentence
    rate = solution.v[:, 2]
    assert_allclose(rate[7:], rate[6], rtol=1e-5)
    # Energy gained until then: work of the weight.
    fall = 2.0 * 9.81 * np.sin(-solution.q[6, 2])
    assert_allclose(0.5 * 2.5 * rate[6] ** 2, fall, rtol=1e-4)
    assert_allclose(solution.energies["energy.work_of_loads [J]"].iloc[-1], fall, rtol=1e-4)
    assert solution.quality.energy_imbalance < 1e-4
