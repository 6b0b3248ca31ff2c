"""Gravity as a time law: weight is the work of a load."""

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


def shock_spectrum(frequency, duration):
    """Return the peak of the absolute acceleration of an undamped oscillator, per peak of the base.

    The exact response to a half sine: forced vibration during the pulse, then free vibration.
    """
    w, pulse = 2.0 * np.pi * frequency, np.pi / duration
    t = np.linspace(0.0, duration, 100_001)
    factor = w / (w**2 - pulse**2)
    inside = factor * (w * np.sin(pulse * t) - pulse * np.sin(w * t))
    rate = factor * w * pulse * (np.cos(pulse * t) - np.cos(w * t))
    return max(np.max(np.abs(inside)), np.hypot(inside[-1], rate[-1] / w))


@integrators(rtol=1e-7, step=2e-5)
def test_a_shock_of_the_base_has_the_exact_shock_spectrum(integrator):
    duration, peak = 0.011, 30.0 * 9.81
    mech = bd.Mechanism(gravity=(0.0, -9.81 + bd.half_sine(-peak, duration)))
    frequencies = (25.0, 74.0, 180.0)
    for k, frequency in enumerate(frequencies):
        foot = mech.ground.at(float(k), 0.0)
        mass = mech.add(bd.PointMass(f"mass {k}", 0.5, at=(float(k), 0.2)))
        mech.add(bd.PointOnLine(f"guide {k}", foot, mass.point, (0.0, 1.0)))
        stiffness = 0.5 * (2.0 * np.pi * frequency) ** 2
        spring = mech.add(bd.Spring(f"spring {k}", foot, mass.point, stiffness))
        mech.observe(f"force {k}", spring.force)
        mech.observe(f"mass {k}", bd.acceleration(mass.point))
    run = bd.simulate(mech, integrator, t_end=0.06, start="equilibrium", output_step=5e-5)
    for k, frequency in enumerate(frequencies):
        dynamic = -run[f"force {k}"].to_numpy() / 0.5 - 9.81
        # Rows are 5e-5 s apart, 0.06 rad of the fastest oscillation: 5e-4 of a peak.
        assert_allclose(
            np.abs(dynamic).max() / peak, shock_spectrum(frequency, duration), rtol=1e-3
        )
        # Acceleration relative to the base plus that of the base.
        base = [bd.half_sine(peak, duration).at(t) for t in run.t]
        # Between steps, accelerations are interpolated.
        assert_allclose(run[f"mass {k}.ay"] + base, dynamic, atol=1e-3 * peak)
