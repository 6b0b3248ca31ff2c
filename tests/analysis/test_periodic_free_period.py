"""Periodic motions of unknown period: self-excited and free motions."""

import casadi as ca
import numpy as np
import pytest
from mechanisms import EARTH, mass_on_rail
from scipy.special import ellipk

import beamdae as bd

# Period of van der Pol's oscillator at mu = 1; also Andersen & Geer, SIAM J. Appl. Math. 42 (1982)
# 678. Digits of scipy's DOP853 at rtol = 1e-13.
VAN_DER_POL_PERIOD = 6.6632868593


def van_der_pol(mu, start=0.5):
    """Return x'' = mu (1 - x^2) x' - x as equations."""
    t, x, v = (ca.SX.sym(name) for name in "txv")
    force = mu * (1.0 - x**2) * v - x
    return bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[start], v0=[0.0])


@bd.model(t_end=40.0)
def self_excited(length=1.0):
    """Return a mass on a spring with negative damping at small elongations, in units of length."""
    mech, mass = mass_on_rail(2.0, velocity=(0.1 * length, 0.0))

    def pull(x, rate):
        return 2.0 * x + 2.0 * ((x / length) ** 2 - 1.0) * rate

    # The spring is anchored far away, since its direction reverses at the anchor.
    anchor = mech.ground.at(-10.0 * length, 0.0)
    mech.add(bd.Spring("spring", anchor, mass.point, law=pull))
    mech.observe("mass", mass.point)
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("guess", [5.0, 6.8, 9.0])
def test_period_of_a_self_excited_motion_is_found(guess):
    motion = bd.periodic(van_der_pol(1.0), period_guess=guess)
    assert motion.status.success
    assert motion.stable
    assert motion.period == pytest.approx(VAN_DER_POL_PERIOD, rel=1e-8)
    # Disturbances along the motion persist; Liouville's formula determines the other multiplier.
    trajectory = motion.solution.trajectory
    t = np.linspace(0.0, motion.period, 2001)
    x = trajectory.at(t)[1].q[:, 0]
    expected = np.exp(motion.period * np.mean(1.0 - x[1:] ** 2))
    np.testing.assert_allclose(motion.multipliers.real, [1.0, expected], atol=1e-6)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("length", [1.0, 1000.0])
def test_period_is_estimated_from_the_run_of_the_model(length):
    motion = bd.periodic(self_excited(length=length))
    assert motion.period == pytest.approx(VAN_DER_POL_PERIOD, rel=1e-7)
    # The amplitude 2.00862 of van der Pol's oscillator at mu = 1.
    half = motion.amplitudes().loc["mass.x [m]", "half range"]
    assert half == pytest.approx(2.00862 * length, rel=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_periods_of_free_motions_are_found_from_any_guess(seed):
    """Pendulums and Duffing oscillators of any amplitude, from guesses within 8 %."""
    rng = np.random.default_rng(seed)
    amplitude, settle = rng.uniform(0.05, 2.3), int(rng.integers(0, 6))
    t, x, v = (ca.SX.sym(name) for name in "txv")
    is_pendulum = seed % 2 == 0
    force = -ca.sin(x) if is_pendulum else -x - x**3

    def find_period(energy):
        """Return the period at an energy above the one at rest."""
        if is_pendulum:
            return 4.0 * ellipk(0.5 * energy)
        square = np.sqrt(1.0 + 4.0 * energy) - 1.0  # of the amplitude
        return 4.0 * ellipk(0.5 * square / (1.0 + square)) / np.sqrt(1.0 + square)

    def find_energy(x, v):
        return 0.5 * v**2 + (1.0 - np.cos(x) if is_pendulum else 0.5 * x**2 + 0.25 * x**4)

    system = bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[amplitude], v0=[0.0])
    guess = find_period(find_energy(amplitude, 0.0)) * rng.uniform(0.92, 1.08)
    rtol = 10.0 ** rng.uniform(-10.0, -6.0)
    motion = bd.periodic(system, period_guess=guess, settle=settle, integrator=bd.Radau(rtol))
    assert motion.status.success
    state = motion.solution.trajectory.at(np.array([0.0]))[1]
    energy = find_energy(state.q[0, 0], state.v[0, 0])
    assert motion.period == pytest.approx(find_period(energy), rel=max(1e-8, 30.0 * rtol))
    # The motion is one near the start.
    assert np.max(np.abs(motion.solution.q)) == pytest.approx(amplitude, rel=0.1)
    assert motion.stable


@pytest.mark.slow(reason="several searches")
def test_arguments_and_failures():
    with pytest.raises(bd.BeamdaeError, match="period and period_guess are mutually exclusive"):
        bd.periodic(van_der_pol(1.0), 6.0, period_guess=6.0)
    with pytest.raises(bd.BeamdaeError, match="no end time from which to estimate the period"):
        bd.periodic(van_der_pol(1.0))
    with pytest.raises(bd.BeamdaeError, match="period_guess must be positive"):
        bd.periodic(van_der_pol(1.0), period_guess=-1.0)
    t, x, v = (ca.SX.sym(name) for name in "txv")
    forced = bd.ConstrainedSystem(t, x, v, mass=[1.0], force=ca.sin(t) - x - v, q0=[1.0], v0=[0.0])
    with pytest.raises(bd.BeamdaeError, match="loads or drivers depend on time; pass their period"):
        bd.periodic(forced, period_guess=6.0)
    for damping in (0.05, 0.5):
        with pytest.warns(
            bd.BeamdaeWarning, match="state of rest; change start= or increase settle="
        ):
            bd.periodic(van_der_pol(-damping), period_guess=6.5, settle=0)
    # Motions near the limit cycle, and parts of motions that are far from it, are no rest.
    for start in (0.5, 30.0):
        with pytest.warns(bd.BeamdaeWarning, match="iterations the end of the period differs"):
            bd.periodic(van_der_pol(1.0, start), period_guess=6.5, settle=0)
    # A period given two per cent too long is kept, and the reason names the remedy.
    with pytest.warns(bd.BeamdaeWarning, match="omit period= to find the period"):
        bd.periodic(van_der_pol(1.0), 6.8)


def test_motion_that_does_not_recur():
    @bd.model(t_end=2.0)
    def falling():
        mech = bd.Mechanism(gravity=EARTH)
        mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
        return mech

    with pytest.raises(bd.BeamdaeError, match="does not recur within 2 s; pass period_guess="):
        bd.periodic(falling)
