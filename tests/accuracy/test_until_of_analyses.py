"""Required accuracies of statics, modes, linear models and periodic motions, by closed forms."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from mechanisms import clamped_beam, mass_on_rail, rectangle
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.accuracy import until

LENGTH = 0.9
ALLOY = bd.Material(E=7.1e10, nu=0.33, rho=2750.0)
# Shear and rotary inertia change frequencies and loads by less than 1e-4.
STRIP = rectangle(0.002, 0.025, material=ALLOY)
# Euler-Bernoulli beams: roots of cos(b) cosh(b) = -1.
ROOTS = np.array([1.8751041, 4.6940911, 7.8547574])
FREQUENCIES = ROOTS**2 * np.sqrt(STRIP.EI / STRIP.rhoA) / (2.0 * np.pi * LENGTH**2)
ACCURACIES = (0.02, 5e-4)
MESHES = ({"elements": 1}, {})  # coarse, and chosen by the program


def cantilever(section=STRIP, **settings):
    mech, leaf = clamped_beam(section, curve=LENGTH, name="leaf", **settings)
    mech.observe("tip", leaf.end)
    return mech


def bent(**settings):
    """Return a cantilever that a moment bends into an arc of 1.2 rad."""
    mech = cantilever(**settings)
    mech.add(bd.Moment("moment", mech.part("leaf").end, 1.2 * STRIP.EI / LENGTH))
    return mech


def pressed(**settings):
    mech = cantilever(**settings)
    mech.add(bd.Force("press", mech.part("leaf").end, (-STRIP.EI, 0.0)))
    return mech


def pushed(law=0.0, **settings):
    mech = cantilever(replace(STRIP, damping=1e-3), **settings)
    mech.add(bd.Force("push", mech.part("leaf").end, (0.0, law)))
    return mech


@pytest.mark.slow(reason="several meshes")
@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("mesh", MESHES)
def test_equilibria_are_accurate(mesh, accuracy):
    path = bd.equilibrium(bent(**mesh), accuracy=accuracy)
    assert path.errors.status.success
    radius = LENGTH / 1.2
    exact = [radius * np.sin(1.2), radius * (1.0 - np.cos(1.2)), 1.2]
    moved = exact - np.array([LENGTH, 0.0, 0.0])
    end = [float(path[f"tip.{x}"].iloc[-1]) for x in ("x", "y", "angle")]
    assert np.all(np.abs((end - np.array(exact)) / moved) <= accuracy)


@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("mesh", MESHES)
def test_buckling_loads_are_accurate(mesh, accuracy):
    result = bd.buckling(pressed(**mesh), n=3, accuracy=accuracy)
    assert result.errors.status.success
    exact = ((np.arange(3) + 0.5) * np.pi / LENGTH) ** 2
    assert_allclose(result.factors, exact, rtol=accuracy)


@pytest.mark.slow(reason="several meshes")
@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("mesh", MESHES)
def test_modes_are_as_many_as_requested_and_accurate(mesh, accuracy):
    result = bd.modes(cantilever(**mesh), n=3, accuracy=accuracy)
    assert result.errors.status.success
    assert_allclose(result.frequencies, FREQUENCIES, rtol=accuracy)


def test_fewer_modes_need_fewer_elements():
    fewer, more = (
        bd.modes(cantilever(elements=1), n=6, accuracy=1e-3, accuracy_columns=columns)
        for columns in ("frequency 1", None)
    )
    counts = [x.mechanism.part("leaf").mesh.elements for x in (fewer, more)]
    assert counts[0] < counts[1]


@pytest.mark.slow(reason="several meshes")
@pytest.mark.parametrize("mesh", MESHES)
def test_frequency_responses_are_accurate(mesh):
    linear = bd.linearize(pushed(**mesh), inputs=["push.Fy"], outputs=["tip.y"])
    diagram = bd.bode(linear, between=(1.0, 1.2 * FREQUENCIES[2]), accuracy=1e-3)
    assert diagram.errors.status.success
    poles = np.unique(np.round(np.abs(diagram.model.poles) / (2.0 * np.pi), 9))
    assert_allclose(poles[:3], FREQUENCIES, rtol=1e-3)
    # The static response is L^3 / (3 EI).
    static = bd.bode(linear, frequencies=[1e-3], accuracy=1e-3).response[0, 0, 0]
    assert_allclose(abs(static), LENGTH**3 / (3.0 * STRIP.EI), rtol=1e-3)


@pytest.mark.parametrize("mesh", MESHES)
def test_linear_models_are_accurate(mesh):
    linear = bd.linearize(cantilever(**mesh), accuracy=1e-3)
    assert linear.errors.status.success
    poles = np.unique(np.round(np.abs(linear.poles) / (2.0 * np.pi), 9))
    assert_allclose(poles[:3], FREQUENCIES, rtol=1e-3)


@pytest.mark.slow(reason="periodic motions of several meshes")
@pytest.mark.parametrize("mesh", MESHES)
def test_periodic_motions_are_accurate(mesh):
    law = bd.sine(0.02, frequency=3.0)
    motion = bd.periodic(pushed(law, **mesh), 1.0 / 3.0, settle=1, accuracy=1e-3)
    assert motion.errors.status.success
    linear = bd.linearize(pushed(elements=8), inputs=["push.Fy"], outputs=["tip.y"])
    amplitude = 0.02 * abs(linear.frequency_response([3.0])[0, 0, 0])
    largest = 0.5 * np.ptp(motion["tip.y"].to_numpy())
    assert_allclose(largest, amplitude, rtol=2e-3)  # of small motions, at discrete times


@pytest.mark.slow(reason="several meshes")
def test_paths_over_a_parameter_refine_the_model():
    @bd.model(t_end=1.0)
    def loaded(moment=0.1):
        mech = cantilever(elements=1)
        mech.add(bd.Moment("moment", mech.part("leaf").end, moment))
        return mech

    moment = 0.4 * STRIP.EI / LENGTH
    path = bd.equilibrium(loaded, over="moment", to=moment, accuracy=1e-5)
    assert path.errors.status.success
    assert path.equations.mechanism.part("leaf").kinematics.strain == "exact"
    assert_allclose(path["tip.y"].iloc[-1], LENGTH / 0.4 * (1.0 - np.cos(0.4)), rtol=1e-5)
    assert path.model["name"] == "loaded"


@dataclass(frozen=True)
class Loose(bd.GeneralizedAlpha):
    """An integrator of somebody else."""


def oscillator():
    mech, bob = mass_on_rail(x=1.2, name="bob", spring=(100.0, 0.0, 1.0))
    mech.observe("bob", bob.point)
    return mech


@pytest.mark.parametrize(
    "integrator",
    [bd.Ida(1e-2), bd.Radau(1e-2), bd.GeneralizedAlpha(0.05), Loose(0.02), bd.Auto(1e-2)],
    ids=lambda x: type(x).__name__,
)
def test_every_integrator_is_refined_by_its_own_number(integrator):
    accuracy = 2e-3 if integrator.accuracy.name == "step" else 1e-5
    run = bd.simulate(oscillator(), integrator, t_end=2.0, accuracy=accuracy)
    assert run.errors.status.success
    # Steps are hardly smaller than necessary.
    assert integrator.accuracy.name == "rtol" or run.errors.largest > 0.2 * accuracy
    assert type(run.made_by) is type(integrator)
    assert run.made_by.accuracy.value < integrator.accuracy.value
    exact = 1.0 + 0.2 * np.cos(10.0 * run.t)
    assert_allclose(run["bob.x"].to_numpy(), exact, atol=2.0 * 0.2 * accuracy)


def test_an_accuracy_beyond_the_limits_is_stated(monkeypatch):
    monkeypatch.setattr(until, "_MAX_UNKNOWNS", 50)
    with pytest.warns(bd.BeamdaeWarning, match="accuracy: frequency .* has the largest error"):
        result = bd.modes(cantilever(elements=1), n=6, accuracy=1e-6)
    status = result.errors.status
    assert status.kind == "limited"
    assert "unknowns" in status.sentence


def test_states_of_other_meshes_and_wrong_columns_are_rejected():
    mech = bent(elements=1)
    path, run = bd.equilibrium(mech), bd.simulate(oscillator(), t_end=0.1)
    with pytest.raises(bd.BeamdaeError, match="modes: accuracy requires a state"):
        bd.modes(mech, about=path, accuracy=0.01)
    with pytest.raises(bd.BeamdaeError, match="modes: there is no column 'frequency 9'"):
        bd.modes(mech, n=2, accuracy=0.01, accuracy_columns="frequency 9")
    with pytest.raises(bd.BeamdaeError, match="simulate: accuracy requires a run that does not"):
        bd.simulate(oscillator(), t_end=0.2, start=run, accuracy=0.01)
    with pytest.raises(bd.BeamdaeError, match="equilibrium: accuracy cannot be combined"):
        bd.equilibrium(mech, start=path, accuracy=0.01)


def test_interrupts_keep_the_last_modes(monkeypatch):
    calls = []

    def interrupt(beam):
        calls.append(beam)
        if len(calls) > 4:
            raise KeyboardInterrupt
        return ()

    mech = cantilever(elements=1)
    monkeypatch.setattr(bd.Beam, "_with_exact_strains", lambda self: interrupt(self) or self)
    with pytest.raises(bd.Interrupted) as caught:
        bd.modes(mech, n=6, accuracy=1e-5)
    assert len(caught.value.partial) == 6
    assert caught.value.partial.errors.largest > 1e-5


@pytest.mark.parametrize(
    "analyze",
    [
        lambda **x: bd.simulate(pressed(), t_end=1e-3, **x),
        lambda **x: bd.equilibrium(pressed(), **x),
        lambda **x: bd.buckling(pressed(), n=1, **x),
        lambda **x: bd.modes(cantilever(), n=1, **x),
        lambda **x: bd.linearize(cantilever(), outputs=["tip"], **x),
        lambda **x: bd.bode(bd.linearize(cantilever(), outputs=["tip"]), [1.0], **x),
    ],
    ids=["simulate", "equilibrium", "buckling", "modes", "linearize", "bode"],
)
def test_columns_without_an_accuracy_are_rejected(analyze):
    with pytest.raises(bd.BeamdaeError, match="accuracy_columns requires accuracy"):
        analyze(accuracy_columns="tip")
