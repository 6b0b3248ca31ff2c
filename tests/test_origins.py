"""Mechanisms remember the model function and the parameters that built them."""

import pytest
from mechanisms import EARTH

import beamdae as bd

ALPHA = bd.GeneralizedAlpha(step=0.05)


@bd.model(t_end=0.2)
def falling_ball(mass=2.0):
    """Return a ball in free fall."""
    mech = bd.Mechanism(gravity=EARTH)
    mech.add(bd.PointMass("ball", mass, at=(0.0, 2.0)))
    return mech


def test_a_mechanism_has_the_end_time_and_the_parameters_of_its_model():
    run = bd.simulate(falling_ball(mass=3.0), ALPHA)
    assert run.t[-1] == 0.2
    assert run.model == {"name": "falling_ball", "parameters": {"mass": 3.0}, "t_end": 0.2}
    assert "falling_ball by GeneralizedAlpha" in run._repr_html_()
    assert bd.simulate(falling_ball(mass=3.0), ALPHA, t_end=0.1).t[-1] == 0.1
    assert bd.simulate(falling_ball, ALPHA).model["parameters"] == {"mass": 2.0}
    assert bd.check(falling_ball(mass=3.0), predict=False).name == "falling_ball"


def test_resuming_a_run_requires_the_same_parameters():
    half = bd.simulate(falling_ball(mass=3.0), ALPHA, t_end=0.1)
    assert bd.simulate(falling_ball(mass=3.0), ALPHA, start=half).t[-1] == 0.2
    with pytest.raises(bd.BeamdaeError, match="mass"):
        bd.simulate(falling_ball, ALPHA, start=half)


def test_a_mechanism_without_a_model_has_no_end_time():
    with pytest.raises(bd.BeamdaeError, match="no end time; pass t_end="):
        bd.simulate(falling_ball.build(), ALPHA)
