"""Standard linear solid: creep, relaxation, complex modulus and section forces in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from conformance import integrators
from mechanisms import clamped_beam, rectangle
from numpy.testing import assert_allclose
from support import NumericEquations

import beamdae as bd

LENGTH, RATIO, TIME, RAMP, PLACE = 0.3, 0.6, 0.5, 0.1, 0.12
# Light, so that ramps excite vibrations of 1e-4 of the deflection only.
STRIP = rectangle(0.004, material=bd.Material(E=2e9, nu=0.4, rho=1.1))
# Damping of vibrations, which changes slow motions by 1e-4.
DAMPED = replace(STRIP, damping=2e-5)
COMPLIANCE = LENGTH**3 / (3.0 * STRIP.EI) + LENGTH / STRIP.GA


def cantilever(parts=((RATIO, TIME),), section=STRIP, **settings):
    mech, beam = clamped_beam(section, curve=LENGTH, **{"elements": 2} | settings)
    for k, (ratio, time) in enumerate(parts):
        solid = mech.add(bd.StandardLinearSolid(f"solid {k}", beam, ratio, time))
        mech.observe(f"share {k}", solid.section_forces(PLACE))
    mech.observe("elastic", beam.section_forces(PLACE))
    mech.observe("tip", beam.end)
    return mech


def ramp(value):
    """Return a law that increases smoothly from 0 to a value in the time RAMP."""
    return bd.piecewise((RAMP, lambda t: 0.5 * value * (1.0 - np.cos(np.pi * t / RAMP))), value)


def decay(t, time):
    """Return exp(-(t - s) / time), averaged over the steps at the times s of a `ramp`."""
    rate = np.pi / RAMP
    average = 0.5 * rate**2 * (1.0 + np.exp(RAMP / time)) / (time**-2 + rate**2)
    return average * np.exp(-t / time)


METHODS = integrators(rtol=1e-5, step=5e-4)


@METHODS
def test_creep_under_a_constant_load(integrator):
    load, mech = -0.02, cantilever(section=DAMPED)
    mech.add(bd.Force("load", mech.part("beam").end, (0.0, ramp(load))))
    run = bd.simulate(mech, integrator, t_end=2.0, output_step=0.1)
    late = run.t > 2.0 * RAMP
    t = run.t[late]
    share = RATIO / (1.0 + RATIO) * decay(t, (1.0 + RATIO) * TIME)
    assert_allclose(run["tip.y"][late], load * COMPLIANCE * (1.0 - share), rtol=5e-4)
    # Elastic forces and those of the solid are in equilibrium with the load.
    moment = load * (PLACE - LENGTH)
    elastic, total = run["elastic.M"][late], run["elastic.M"][late] + run["share 0.M"][late]
    assert_allclose(total, moment, rtol=5e-4)
    assert_allclose(elastic, moment * (1.0 - share), rtol=5e-4)
    forces = run.section_forces("beam", t[-1])
    assert np.max(forces.error[2]) < 1e-3 * np.max(np.abs(forces.M))
    assert_allclose(
        bd.equilibrium(mech, t=9.0).columns["tip.y [m]"][-1], load * COMPLIANCE, rtol=1e-5
    )


@METHODS
def test_relaxation_at_a_constant_deflection(integrator):
    deflection, mech = 1e-3, cantilever(section=DAMPED)
    beam = mech.part("beam")
    ends = mech.ground.at(LENGTH, 0.0), beam.end
    drive = mech.add(bd.TranslationalDriver("drive", *ends, ramp(deflection), (0.0, 1.0)))
    mech.observe("drive", drive.reaction)
    run = bd.simulate(mech, integrator, t_end=2.0, output_step=0.1)
    late = run.t > 2.0 * RAMP
    expected = deflection / COMPLIANCE * (1.0 + RATIO * decay(run.t[late], TIME))
    assert_allclose(np.abs(run["drive.F"][late]), expected, rtol=1e-3)


@pytest.mark.parametrize("parts", [((RATIO, 1e-3),), ((0.4, 1e-3), (0.7, 1e-2))], ids=len)
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_modes_have_the_complex_modulus(parts, formulation):
    """l^2 + w^2 E(l) / E = 0 with E(l) / E = 1 + sum of ratio l time / (1 + l time)."""
    undamped = bd.modes(cantilever((), formulation=formulation), n=3, damping=False)
    damped = bd.linearize(cantilever(parts, formulation=formulation)).poles
    for frequency in undamped.frequencies:
        denominator = np.poly1d([1.0])
        for _, time in parts:
            denominator *= np.poly1d([time, 1.0])
        modulus = denominator
        for ratio, time in parts:
            modulus += ratio * np.poly1d([time, 0.0]) * (denominator / np.poly1d([time, 1.0]))[0]
        roots = (
            np.poly1d([1.0, 0.0, 0.0]) * denominator + (2.0 * np.pi * frequency) ** 2 * modulus
        ).roots
        for root in roots:
            assert np.min(np.abs(damped - root)) < 1e-6 * abs(root)


def test_loss_factor_of_a_forced_vibration():
    """Far below the natural frequency, the deflection over the force is the complex compliance."""
    time = 0.1
    mech = cantilever(((RATIO, time),))
    push = mech.input("push", unit="N")
    mech.add(bd.Force("load", mech.part("beam").end, (0.0, push)))
    peak = 1.0 / (time * np.sqrt(1.0 + RATIO))
    model = bd.linearize(mech, inputs=["push"], outputs=["tip.y"])
    (response,) = model.frequency_response(np.array([peak / (2.0 * np.pi)])).ravel()
    loss = -response.imag / response.real
    assert_allclose(loss, RATIO / (2.0 * np.sqrt(1.0 + RATIO)), rtol=1e-4)


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_a_prestressed_beam_starts_relaxed(formulation):
    arc = bd.Arc(radius=1.0, length=LENGTH)
    settings = {"free_curve": arc, "formulation": formulation}
    with_solid, without = (NumericEquations(cantilever(x, **settings)) for x in (((1.0, 1.0),), ()))
    n = without.n
    assert np.max(np.abs(without.force())) > 0.1
    assert_allclose(with_solid.force()[:n], without.force(), atol=1e-9)
    assert_allclose(with_solid.force()[n:], 0.0, atol=1e-9)
