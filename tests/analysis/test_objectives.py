"""Objectives of gradients: values against closed forms, derivatives against differences."""

import numpy as np
import pytest
from mechanisms import free_ball

import beamdae as bd
from beamdae import quantities
from beamdae.analysis.gradients.objectives import SampleGrid

T = np.linspace(0.0, 2.0, 401)
Y = np.sin(3.0 * T) - 0.2
WEIGHTS = np.convolve(np.diff(T), [0.5, 0.5])  # trapezoidal rule
GRID = SampleGrid(T, WEIGHTS, 0.0, 2.0)
LEAVES = [
    quantities.EndValue("tip.y"),
    quantities.TimeIntegral("tip.y"),
    quantities.TimeIntegral("tip.y", 2),
    quantities.SmoothMaximum("tip.y", 12.0),
    quantities.SquaredErrors("tip.y", T[::50], np.cos(T[::50]), 0.3),
    quantities.SquaredErrors("tip.y", T[::50], np.where(T[::50] > 1.0, np.nan, 0.1), 0.1 + T[::50]),
]


@pytest.fixture(scope="module")
def falling():
    """A mass that falls freely from rest at y = 2 m: y = 2 - g t^2 / 2."""
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    return bd.simulate(mech, bd.GeneralizedAlpha(step=1e-3), t_end=0.5)


@pytest.mark.parametrize("term", LEAVES, ids=lambda x: type(x).__name__)
def test_derivatives_are_those_of_the_values(term):
    y = np.interp(term.sample_times(GRID), T, Y)
    _, derivative = term.evaluate(y, WEIGHTS)
    delta = 1e-6
    differences = [
        (term.evaluate(y + d, WEIGHTS)[0] - term.evaluate(y - d, WEIGHTS)[0]) / (2.0 * delta)
        for d in delta * np.eye(len(y))
    ]
    np.testing.assert_allclose(derivative, differences, rtol=1e-6, atol=1e-8)


def test_values_match_closed_forms(falling):
    """The errors of the trapezoidal rule with steps of 1 ms are below 1e-5."""
    t = 0.5
    assert quantities.EndValue("ball.y").value(falling) == pytest.approx(2.0 - 9.81 * t**2 / 2.0)
    assert quantities.TimeIntegral("ball.y").value(falling) == pytest.approx(
        2.0 * t - 9.81 * t**3 / 6.0, rel=1e-5
    )
    assert quantities.TimeIntegral("ball.y_dot", 2).value(falling) == pytest.approx(
        9.81**2 * t**3 / 3.0, rel=1e-5
    )
    # |y_dot| = g t: its p-norm is g T / (p + 1)^(1/p).
    assert quantities.SmoothMaximum("ball.y_dot", 3.0).value(falling) == pytest.approx(
        9.81 * t / 4.0 ** (1.0 / 3.0), rel=1e-5
    )
    times = [0.1, 0.2505]
    values = [2.0 - 9.81 * x**2 / 2.0 + 0.02 for x in times]
    assert quantities.SquaredErrors("ball.y", times, values, [0.01, 0.02]).value(
        falling
    ) == pytest.approx(5.0, rel=1e-6)


def test_sums_and_multiples(falling):
    end, integral = quantities.EndValue("ball.y"), quantities.TimeIntegral("ball.y", 2)
    total = (2.0 * end - integral / 4.0).value(falling)
    assert total == pytest.approx(2.0 * end.value(falling) - 0.25 * integral.value(falling))
    assert sum([end, integral]).value(falling) == (end + integral).value(falling)


def test_smooth_maximum_of_a_peak_is_below_the_maximum_by_the_stated_ratio():
    t, tau = np.linspace(-0.5, 0.5, 20001), 0.1
    peak = 3.0 * (1.0 - 0.5 * (t / tau) ** 2).clip(0.0)
    weights = np.convolve(np.diff(t), [0.5, 0.5])
    value, _ = quantities.SmoothMaximum("tip.y").evaluate(-peak, weights)
    ratio = (np.sqrt(2.0 * np.pi / 50.0) * tau) ** 0.02
    assert ratio == pytest.approx(0.935, abs=1e-3)
    assert value == pytest.approx(3.0 * ratio, rel=1e-3)
    assert quantities.SmoothMaximum("tip.y").evaluate(0.0 * t, weights)[0] == 0.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: quantities.EndValue(3), "column must be the name of a column, got 3"),
        (lambda: quantities.TimeIntegral("a", 3), "power must be one of 1, 2, got 3"),
        (
            lambda: quantities.SmoothMaximum("a", 0.5),
            "exponent must be between 1 and 1000, got 0.5",
        ),
        (lambda: quantities.SquaredErrors("a", [1.0, 0.5], [0.0, 0.0]), "ascending times"),
        (lambda: quantities.SquaredErrors("a", [0.5, 1.0], [0.0]), "got 1 values for 2 times"),
        (
            lambda: quantities.SquaredErrors("a", [0.5], ["b"]),
            "a value must be a number, got 'b'",
        ),
        (
            lambda: quantities.SquaredErrors("a", [0.5], [0.0], 0.0),
            "sigma must be positive, one number or one for each time .1., got 0.0",
        ),
        (lambda: quantities.EndValue("a") + 1.0, "[+] 1.0 is not supported"),
        (lambda: quantities.EndValue("a") * "b", "[*] 'b' is not supported"),
        (lambda: quantities.EndValue("a") / 0.0, "/ 0.0 is not supported"),
        (lambda: quantities.EndValue("a").value(3), "needs a Solution, got 3"),
    ],
)
def test_invalid_arguments_are_rejected(make, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        make()


def test_columns_and_times_must_exist_in_the_run(falling):
    with pytest.raises(bd.BeamdaeError, match="selects several columns"):
        quantities.EndValue("ball").value(falling)
    with pytest.raises(bd.BeamdaeError, match=r"there is no column .bal\.y"):
        quantities.EndValue("bal.y").value(falling)
    with pytest.raises(bd.BeamdaeError, match=r"times must lie within the run, 0 to 0\.5 s"):
        quantities.SquaredErrors("ball.y", [0.4, 0.6], [0.0, 0.0]).value(falling)
