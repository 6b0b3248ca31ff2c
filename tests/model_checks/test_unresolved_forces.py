"""Fixed steps warn about forces that change within steps."""

import warnings

import casadi as ca
import numpy as np
import pytest

import beamdae as bd

WIDTH = 0.01
PLACE = 0.5123
SHAPES = {
    "gauss": lambda x: ca.exp(-((x / WIDTH) ** 2)) / (np.sqrt(np.pi) * WIDTH),
    "box": lambda x: ca.if_else(ca.fabs(x) < WIDTH, 1.0, 0.0) / (2.0 * WIDTH),
    "tent": lambda x: ca.fmax(0.0, 1.0 - ca.fabs(x) / WIDTH) / WIDTH,
}


def build_ball(shape, place=PLACE):
    """Return a ball with the speed 1 m/s, which a force pushes sideways at one place."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(1.0, 0.0)))
    mech.observe("ball", ball.point)
    x = mech.sensor("x", ball.point, "x")
    push = mech.add(bd.Force("push", ball.point, (0.0, SHAPES[shape](x - place))))
    return mech, push


def simulate(mech, step):
    """Return the error of the sideways speed, and the warning of missed impulses or ""."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        run = bd.simulate(mech, bd.GeneralizedAlpha(step), 1.0)
    error = abs(run["ball.y_dot"].iloc[-1] - 1.0)
    return error, "".join(x for x in run.warnings if "the impulse of this force" in x)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("step", [0.1, 0.04, 0.02, 0.01, 0.002])
def test_regression_pulses_that_fixed_steps_miss_have_a_warning(shape, step):
    """The impulse was wrong by up to 100 %, without a word for 7 of 60 random pulses."""
    error, warning = simulate(build_ball(shape)[0], step)
    assert error <= 0.01 or warning.startswith(f"push: with steps of {step:.2g} s")


@pytest.mark.slow(reason="a fifth of a second")
def test_resolved_forces_have_no_warning():
    for shape, step in (("gauss", 0.0087), ("box", 1e-4), ("tent", 1e-3)):
        error, warning = simulate(build_ball(shape)[0], step)
        assert error < 0.005
        assert warning == ""


def test_pulses_of_time_are_named_with_their_time_and_share():
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(0.1, 0.0)))
    x = mech.sensor("x", ball.point, "x")
    mech.add(bd.Force("spring", ball.point, (-ca.sin(x), 0.0)))
    mech.add(bd.Force("blow", ball.point, (0.0, lambda t: SHAPES["gauss"](t - 0.455))))
    mech.observe("ball", ball.point)
    warning = simulate(mech, 0.05)[1]
    assert warning.startswith("blow: with steps of 0.05 s, the impulse of this force is wrong by 1")
    assert "mostly at t = 0.425 s" in warning


@pytest.mark.slow(reason="half a second")
def test_inactive_forces_are_not_checked():
    for threshold, expected in ((0.2, ""), (0.8, "push: with steps of 0.04 s")):
        mech, push = build_ball("tent")
        mech.when("ball.x", threshold, "up", bd.deactivate(push))
        assert simulate(mech, 0.04)[1][:26] == expected


@pytest.mark.parametrize("width", [0.01, 0.2])
def test_regression_rates_of_states_are_checked_without_the_derivative(width):
    """The row x' - rate, zero but for errors, was taken for a force that changes within steps."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(1.0, 0.0)))
    x = mech.sensor("x", ball.point, "x")
    mech.state("count", ca.exp(-(((x - PLACE) / width) ** 2)))
    bd.low_pass(mech, "slow", ca.sin(9.0 * x), 0.05)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        found = bd.simulate(mech, bd.GeneralizedAlpha(0.02), 1.0).warnings
    if width == 0.2:
        assert found == ()
    else:
        (warning,) = (x for x in found if "with steps of" in x)
        assert warning.startswith("count: with steps of 0.02 s, the change of this state is wrong")
        assert "because its rate changes within steps" in warning
