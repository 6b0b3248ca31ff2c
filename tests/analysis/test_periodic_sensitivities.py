"""Derivatives of periodic motions: closed forms, scaling laws and differences."""

import numpy as np
import pytest
from mechanisms import clamped_beam, free_ball, mass_on_rail, rectangle
from numpy.testing import assert_allclose

import beamdae as bd


@bd.model(t_end=1.0)
def shaker(stiffness=9.0, mass=1.0, damping=0.5, frequency=0.3, load=1.0):
    """Mass on a spring and a damper under a harmonic force."""
    mech, bob = mass_on_rail(mass, 1.0, name="bob")
    hook = mech.ground.at(0.0, 0.0)
    mech.add(bd.Spring("spring", hook, bob.point, stiffness, damping))
    mech.add(bd.Force("load", bob.point, (bd.sine(load, frequency=frequency), 0.0)))
    mech.observe("bob", bob.point)
    return mech


def response(t, stiffness, mass, damping, frequency, load):
    """Return the periodic displacement; analytic in all arguments."""
    rate = 2.0 * np.pi * frequency
    elastic, viscous = stiffness - mass * rate**2, damping * rate
    size = load / (elastic**2 + viscous**2)
    return size * (elastic * np.sin(rate * t) - viscous * np.cos(rate * t))


@pytest.mark.slow(reason="a quarter of a second")
def test_forced_oscillator_has_a_closed_form():
    names = ["stiffness", "mass", "damping", "load"]
    result = bd.periodic_sensitivities(shaker, names, period=1.0 / 0.3)
    values = dict(shaker.parameters)
    for name in names:
        step = {**values, name: values[name] * (1.0 + 1e-30j)}
        exact = response(result.motion.solution.t, **step).imag / (1e-30 * values[name])
        # The run has a relative tolerance of 1e-8.
        actual = result.sensitivity("bob.x", name)
        assert_allclose(actual, exact, rtol=0.0, atol=1e-8 * np.abs(exact).max())
        assert result.periods[name] == 0.0


@pytest.mark.slow(reason="half a second and more")
def test_parameter_that_changes_the_period_of_the_load():
    with pytest.raises(bd.BeamdaeError, match="frequency of shaker changes the period of loads"):
        bd.periodic_sensitivities(shaker, "frequency", period=1.0 / 0.3)
    result = bd.periodic_sensitivities(
        shaker, "frequency", period=lambda **values: 1.0 / values["frequency"]
    )
    assert result.periods["frequency"] == pytest.approx(-1.0 / 0.3**2, rel=1e-9)
    # At fixed phases, time is proportional to the period.
    phase = result.motion.solution.t * 0.3
    values = {**shaker.parameters, "frequency": 0.3 * (1.0 + 1e-30j)}
    exact = response(phase / values["frequency"], **values).imag / 0.3e-30
    actual = result.sensitivity("bob.x", "frequency")
    assert_allclose(actual, exact, rtol=0.0, atol=1e-7 * np.abs(exact).max())


@bd.model(t_end=60.0)
def van_der_pol(excitation=0.5, stiffness=1.0, size=1.0):
    mech, bob = mass_on_rail(x=5.0 + size, name="bob")

    def law(elongation, rate):
        return stiffness * elongation - excitation * (1.0 - (elongation / size) ** 2) * rate

    hook = mech.ground.at(0.0, 0.0)
    mech.add(bd.Spring("spring", hook, bob.point, law=law, free_length=5.0))
    mech.observe("bob", bob.point)
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_self_excited_motion_has_a_derivative_of_its_period():
    names = ["excitation", "stiffness", "size"]
    result = bd.periodic_sensitivities(van_der_pol, names, period_guess=6.3)
    period, rates = result.motion.period, result.periods
    # T = f(e / sqrt(k)) / sqrt(k) for the mass 1; the size does not matter.
    assert rates["stiffness"] == pytest.approx(-0.5 * period - 0.25 * rates["excitation"], rel=1e-7)
    assert rates["size"] == pytest.approx(0.0, abs=1e-7)
    # T = 2 pi (1 + e^2 / 16 - 5 e^4 / 3072 + ...), Buonomo, SIAM J. Appl. Math. 59 (1998) 156.
    series = 2.0 * np.pi * (0.5 / 8.0 - 20.0 * 0.5**3 / 3072.0)
    assert rates["excitation"] == pytest.approx(series, rel=5e-3)
    # The largest displacement, where phases do not matter, is proportional to the size.
    x = result.motion.solution.columns["bob.x [m]"] - 5.0
    largest = int(np.argmax(x))
    amplitude = result.sensitivity("bob.x", "size").iloc[largest]
    assert amplitude == pytest.approx(x[largest], rel=1e-3)


@bd.model(t_end=3.0)
def pendulum(length=1.0):
    mech, bob = free_ball((length, 0.0), name="bob", gravity=9.81)
    mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), bob.point))
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_refusals():
    # Free motions of all amplitudes are periodic.
    with pytest.raises(bd.BeamdaeError, match="neighboring motions of pendulum are periodic, too"):
        bd.periodic_sensitivities(pendulum, "length", period_guess=2.3)
    with pytest.raises(bd.BeamdaeError, match="integrator must be Radau"):
        bd.periodic_sensitivities(shaker, "mass", 1.0 / 0.3, bd.Ida())
    with pytest.raises(bd.BeamdaeError, match="no parameter 'mas'"):
        bd.periodic_sensitivities(shaker, "mas", 1.0 / 0.3)


@bd.model(t_end=1.0)
def strip(length=0.5, formulation="exact"):
    """Damped curved cantilever with a mass at its tip, which is shaken."""
    plastic = bd.Material(E=2e9, nu=0.35, rho=1200.0)
    section = rectangle(0.004, damping=2e-3, material=plastic)
    mech, beam = clamped_beam(
        section, 1, bd.Arc(1.25, length), name="strip", formulation=formulation
    )
    tip = mech.add(bd.PointMass("tip", 0.05, at=beam.end.point))
    mech.add(bd.Revolute("pin", beam.end, tip.point))
    mech.add(bd.Force("shake", tip.point, (0.0, bd.sine(0.2, frequency=2.0))))
    mech.observe("tip", beam.end)
    return mech


@pytest.mark.slow(reason="three periodic motions of a beam")
def test_shaken_strip_agrees_with_differences():
    # The length changes the operator of the joint at the tip.
    settings = {"period": 0.5, "settle": 1, "integrator": bd.Radau(1e-6)}
    values = {"formulation": "floating frame"}
    result = bd.periodic_sensitivities(strip, "length", **settings, parameters=values)
    delta = 5e-4
    last, first = (
        bd.periodic(strip(**values, length=0.5 + x), **settings).solution.columns["tip.y [m]"]
        for x in (delta, -delta)
    )
    expected = (last - first) / (2.0 * delta)
    error = np.abs(result.sensitivity("tip.y", "length") - expected)
    # Differences of second order for relative changes of 1e-3.
    assert error.max() <= 1e-4 * np.abs(expected).max()
