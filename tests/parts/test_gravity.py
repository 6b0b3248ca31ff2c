"""Gravity as a time law: weight is the work of a load."""

from __future__ import annotations

import numpy as np
from conformance import integrators
from numpy.testing import assert_allclose

import beamdae as bd


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
