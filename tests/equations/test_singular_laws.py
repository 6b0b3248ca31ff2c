"""Time laws with poles and invalid breakpoints are rejected."""

import math

import numpy as np
import pytest
from mechanisms import free_ball

import beamdae as bd


@pytest.mark.parametrize("breakpoint_time", [math.nan, math.inf])
def test_regression_breakpoints_that_are_not_finite_are_rejected(breakpoint_time):
    def build():
        law = bd.results.Law((lambda t: 1.0, lambda t: 2.0), (breakpoint_time,))
        mech, ball = free_ball()
        mech.add(bd.Force("push", ball.point, (law, 0.0)))
        return bd.equations_of_motion(mech)

    with pytest.raises(bd.BeamdaeError, match="breakpoints"):
        build()


def run(law, t_end=1.0):
    mech, ball = free_ball()
    mech.add(bd.Force("push", ball.point, (law, 0.0)))
    return bd.simulate(mech, bd.GeneralizedAlpha(0.1 * t_end), t_end)


@pytest.mark.parametrize("pole", [0.5, 1.0, 1.0 / 3.0, 0.8142])
@pytest.mark.parametrize("power", [1, 2, 3])
def test_poles_of_all_orders_are_detected_at_samples_and_between(pole, power):
    with pytest.raises(bd.BeamdaeError, match=rf"the law becomes infinite near t = {pole:.4g}"):
        run(lambda t: 1.0 / (t - pole) ** power)


def test_a_pole_outside_its_piece_is_accepted():
    pieces = (lambda t: 1.0 / (t - 0.6), lambda t: 1.0 / (t - 0.3))
    assert run(bd.piecewise((0.5, pieces[0]), pieces[1])).status.success
    with pytest.raises(bd.BeamdaeError, match=r"near t = 0\.6 s"):
        run(bd.piecewise((0.7, pieces[0]), pieces[1]))


def angle(t):
    """Return a quotient of the published spin-up, whose tiny values are rounding errors."""
    omega = 2.0 * np.pi / 15.0
    return 0.4 * (0.5 * t**2 + (np.cos(omega * t) - 1.0) / omega**2) / (1.0 + t)


@pytest.mark.parametrize(
    ("law", "t_end"),
    [
        (lambda t: 1.0 / ((t - 0.3) ** 2 + 1e-4), 1.0),
        (lambda t: np.exp(-(((t - 0.3) / 1e-3) ** 2)), 1.0),
        (lambda t: np.sqrt(1.0 - t), 1.0),
        (lambda t: t**0.5, 1.0),
        (lambda t: np.exp(50.0 * t), 1.0),
        (angle, 1e-6),
        (angle, 1e-2),
    ],
)
def test_peaks_roots_and_growth_are_accepted(law, t_end):
    assert run(law, t_end).status.success
