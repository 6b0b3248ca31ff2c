"""Steps do not pass short pulses of loads without a trace."""

import math

import numpy as np
import pytest
from mechanisms import free_ball

import beamdae as bd

# Shapes of pulses of unit height and width about zero, with their integrals.
SHAPES = {
    "gauss": (lambda x: np.exp(-(x**2)), math.sqrt(math.pi)),
    "sech^2": (lambda x: 1.0 - np.tanh(x) ** 2, 2.0),
    "flat top": (lambda x: 0.5 * (np.tanh(5.0 * (x + 1.0)) - np.tanh(5.0 * (x - 1.0))), 2.0),
    "exponentials": (lambda x: 1.0 / (np.exp(x) + np.exp(-x)), 0.5 * math.pi),
}
METHODS = {
    "radau": bd.Radau(1e-6),
    "ida": bd.Ida(1e-7),
    "alpha": bd.GeneralizedAlpha(rtol=1e-6),
    "auto": bd.Auto(),
}


@bd.model(t_end=1.0)
def struck_mass(shape="gauss", width=1e-4, at=0.41237, height=1000.0, base=0.0):
    """A mass of 2 kg that a short pulse accelerates."""
    pulse, _ = SHAPES[shape]
    mech, mass = free_ball(mass=2.0, name="mass")
    force = lambda t: base + height * pulse((t - at) / width)  # noqa: E731
    mech.add(bd.Force("blow", mass.point, (0.0, force)))
    return mech


def final_velocity(**values):
    """Return the velocity at the end by the impulse [m/s]."""
    values = struck_mass.parameters | values
    impulse = values["height"] * values["width"] * SHAPES[values["shape"]][1]
    return (impulse + values["base"]) / 2.0


@pytest.mark.parametrize("width", [1e-2, 1e-3, 1e-4, 2e-5])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("method", METHODS)
def test_regression_short_pulses_have_their_impulse(method, shape, width):
    """Blows of 0.1 ms had no effect at all, without a warning."""
    run = bd.simulate(struck_mass(shape=shape, width=width), METHODS[method])
    velocity = run["mass.y_dot"].to_numpy()
    assert velocity[-1] == pytest.approx(final_velocity(shape=shape, width=width), rel=1e-3)


@pytest.mark.parametrize(
    "values",
    [
        {"height": -1000.0},
        {"base": 50.0},
        {"at": 0.5},
        {"at": 0.9},
        {"at": 0.0371, "width": 4e-6},
        {"at": 0.7193, "width": 4e-6},
        {"at": 0.2718, "width": 2e-5, "base": 50.0},  # beside which rounding hides its tails
    ],
)
def test_signs_offsets_and_times_of_pulses_do_not_matter(values):
    run = bd.simulate(struck_mass(**values), bd.Radau(1e-6))
    assert run["mass.y_dot"].iloc[-1] == pytest.approx(final_velocity(**values), rel=1e-3)


@pytest.mark.slow(reason="a fifth of a second")
def test_each_pulse_of_a_train_has_its_impulse():
    mech = struck_mass(height=0.0)
    times = (0.103, 0.35, 0.353, 0.9)
    train = lambda t: 1e3 * sum(np.exp(-(((t - x) / 1e-5) ** 2)) for x in times)  # noqa: E731
    mech.add(bd.Force("train", mech.part("mass").point, (0.0, train)))
    speed = bd.simulate(mech, bd.Radau(1e-6), t_end=1.0)["mass.y_dot"].iloc[-1]
    assert speed == pytest.approx(4.0 * final_velocity(width=1e-5), rel=1e-3)


@pytest.mark.slow(reason="differentiates runs")
@pytest.mark.parametrize("method", [bd.Radau(1e-8), bd.GeneralizedAlpha(rtol=1e-6)])
def test_derivatives_by_height_and_width_of_a_pulse(method):
    by = ["height", "width"]
    forward = bd.sensitivities(struck_mass, by, method, estimate_error=False)
    adjoint = bd.gradient(
        struck_mass, bd.quantities.EndValue("mass.y_dot"), by, method, estimate_error=False
    )
    velocity = final_velocity()
    for name, value in (("height", 1000.0), ("width", 1e-4)):
        expected = velocity / value  # The runs have errors of 1e-3.
        actual = forward.sensitivity("mass.y_dot", name).iloc[-1]
        assert actual == pytest.approx(expected, rel=3e-3)
        assert adjoint.derivatives[name] == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("duration", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("start", [0.0, 0.41237])
def test_pulses_that_vanish_at_both_ends_have_their_impulse(method, duration, start):
    """The first step of IDA ended at the end of the pulse, so the mass stayed at rest."""
    mech, mass = free_ball(mass=2.0, name="mass")
    law = bd.half_sine(1000.0, duration, start)
    mech.add(bd.Force("blow", mass.point, (0.0, law)))
    velocity = bd.simulate(mech, METHODS[method], t_end=1.0)["mass.y_dot"].iloc[-1]
    assert velocity == pytest.approx(1000.0 * duration / np.pi, rel=1e-3)
