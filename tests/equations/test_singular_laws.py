"""Time laws with poles and invalid breakpoints are rejected."""

import math

import numpy as np
import pytest

import beamdae as bd
from beamdae.equations.singular_laws import collect_unbounded_laws, require_no_pole


class FollowsLaw(bd.Part):
    """Part that consists of a law."""

    name = "ball"

    def __init__(self, law):
        self.law = law

    @property
    def laws(self):
        return (self.law,)


@pytest.mark.parametrize("breakpoint_time", [math.nan, math.inf])
def test_regression_breakpoints_that_are_not_finite_are_rejected(breakpoint_time):
    def build():
        law = bd.Law((lambda t: 1.0, lambda t: 2.0), (breakpoint_time,))
        mech = bd.Mechanism()
        ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
        mech.add(bd.Force("push", ball.point, (law, 0.0)))
        return bd.equations_of_motion(mech)

    with pytest.raises(bd.BeamdaeError, match="breakpoints"):
        build()


def check_poles(law, intervals=((0.0, 1.0),)):
    require_no_pole(collect_unbounded_laws([FollowsLaw(law)]), intervals)


@pytest.mark.slow(reason="half a second")
def test_poles_are_detected_at_any_time():
    for pole in np.random.default_rng(0).uniform(0.0, 1.0, 100):
        with pytest.raises(bd.BeamdaeError, match="ball: the law becomes infinite near t = 0"):
            check_poles(bd.Law((lambda t, pole=pole: 3.0 + 1.0 / (t - pole),)))


@pytest.mark.parametrize("pole", [0.0, 0.5, 1.0, 1.0 / 3.0])
@pytest.mark.parametrize("power", [1, 2, 3])
def test_poles_of_all_orders_are_detected_at_samples_and_between(pole, power):
    with pytest.raises(bd.BeamdaeError, match=rf"near t = {pole:g}"):
        check_poles(bd.Law((lambda t: 1.0 / (t - pole) ** power,)))


@pytest.mark.parametrize(
    "law",
    [
        lambda t: 1.0 / ((t - 0.3) ** 2 + 1e-10),
        lambda t: np.exp(-(((t - 0.3) / 1e-6) ** 2)),
        lambda t: np.sqrt(0.2 - t),
        lambda t: t**0.5,
        lambda t: np.exp(500.0 * t),
        lambda t: 0.0 * t,
    ],
)
def test_peaks_roots_and_growth_are_accepted(law):
    check_poles(bd.Law((law,)))


def test_regression_rounding_errors_of_tiny_values_are_accepted():
    """Runs of the published spin-up shorter than 1 ms were rejected."""

    def angle(t):
        # A quotient, because laws without divisions by time are not examined.
        omega = 2.0 * np.pi / 15.0
        return 0.4 * (0.5 * t**2 + (np.cos(omega * t) - 1.0) / omega**2) / (1.0 + t)

    laws = collect_unbounded_laws([FollowsLaw(bd.Law((angle,)))])
    assert laws
    for end in (1e-6, 1e-5, 3e-4, 1e-2):
        require_no_pole(laws, ((0.0, end),))


def test_only_laws_that_may_become_infinite_are_examined():
    finite = (
        bd.sine(2.0, 1.0),
        bd.run_up(3.0, 0.5),
        bd.Law((lambda t: np.sin(t) ** 2 / 3.0, lambda t: 1.0 - 2.0 * t), (0.5,)),
    )
    assert not collect_unbounded_laws([FollowsLaw(law) for law in finite])
    quotient = bd.Law((lambda t: 1.0, lambda t: 1.0 / (2.0 - t)), (0.5,))
    for law in (quotient, bd.Law((lambda t: np.tan(t),)), bd.Law((lambda t: t**-1.0,))):
        assert len(collect_unbounded_laws([FollowsLaw(law)])) == 1


def test_a_pole_outside_the_branch_in_use_is_accepted():
    law = bd.Law((lambda t: 1.0 / (t - 0.6), lambda t: 1.0 / (t - 0.3)), (0.5,))
    check_poles(law, ((0.0, 0.5), (0.5, 1.0)))
    with pytest.raises(bd.BeamdaeError, match=r"near t = 0\.3 s; .* from t = 0 s to 1 s"):
        check_poles(law, ((0.0, 0.1), (0.1, 0.2), (0.2, 1.0)))
