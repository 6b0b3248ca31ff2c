"""Periodic motions and their multipliers, against closed forms."""

import numpy as np
import pytest

import beamdae as bd

MASS, STIFFNESS, DAMPING = 2.0, 18.0, 1.0


def oscillator(load, stiffness=STIFFNESS, damping=DAMPING):
    """A mass on a rail, on a spring and a damper."""
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", MASS, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(1.0, 0.0), mass.point, (1.0, 0.0)))
    mech.add(bd.SpringDamper("spring", mech.ground.at(0.0, 0.0), mass.point, stiffness, damping))
    mech.add(bd.Force("load", mass.point, (load, 0.0)))
    mech.observe("mass", mass.point)
    return mech


@pytest.mark.parametrize("frequency", [0.2, 0.45, 3.0])
def test_a_damped_oscillator_under_a_sine(frequency):
    motion = bd.periodic(oscillator(bd.sine(1.0, frequency)), 1.0 / frequency)
    omega = 2.0 * np.pi * frequency
    amplitude = 1.0 / np.hypot(STIFFNESS - MASS * omega**2, DAMPING * omega)
    assert motion.status.success
    assert motion.amplitudes().loc["mass.x [m]", "half range"] == pytest.approx(amplitude, rel=1e-6)
    rate = 0.5 * DAMPING / MASS
    natural = np.emath.sqrt(STIFFNESS / MASS - rate**2)
    multiplier = np.exp((-rate + 1j * natural) / frequency)
    # As exact as the run they are linearized along.
    np.testing.assert_allclose(
        np.sort_complex(motion.multipliers),
        np.sort_complex([multiplier, multiplier.conj()]),
        rtol=1e-6,
    )
    assert motion.stable
